"""The benchmarks of this machine."""

import argparse
from collections.abc import Callable


def rounds_of(measure: Callable[[float], dict[str, float]], about: str) -> list[dict[str, float]]:
    """The results of several rounds of measuring; the command line sets their number, and the seconds of each."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    return [measure(options.seconds) for _ in range(options.rounds)]
