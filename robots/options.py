"""What the command lines of robots share. Light: programs of a robot import it, too."""

import argparse
from collections.abc import Callable
from pathlib import Path


def parser_of(program: str, description: str | None, out: str) -> argparse.ArgumentParser:
    """The command line of `python -m robots.<program>`, with the option that all shows have."""
    parser = argparse.ArgumentParser(prog=f"python -m robots.{program}", description=description)
    parser.add_argument(
        "--out", type=Path, default=Path(out), help="folder of its files (%(default)s)"
    )
    return parser


def forwarded(options: argparse.Namespace, *names: str) -> list[str]:
    """These options as the command line of another program has them."""
    return [f"--{name}={getattr(options, name)}" for name in names]


def between(least: float, most: float, what: str) -> Callable[[str], float]:
    """The type of an option that is a number in these bounds."""

    def number(text: str) -> float:
        if not least <= float(text) <= most:
            raise argparse.ArgumentTypeError(
                f"{what} is a number from {least:g} to {most:,g}, not {text}"
            )
        return float(text)

    return number
