"""What things cost here."""

import argparse
from collections.abc import Callable


def rounds_of(measure: Callable[[float], dict[str, float]], about: str) -> list[dict[str, float]]:
    """What several rounds of measuring gave; how many, and of how many seconds each, is said on the command line."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=1.0)
    options = parser.parse_args()
    return [measure(options.seconds) for _ in range(options.rounds)]
