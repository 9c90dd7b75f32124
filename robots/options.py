"""Command-line options that robots share. Robots' programs import this file: it stays light."""

import argparse
from collections.abc import Callable
from pathlib import Path


def parser_of(program: str, description: str | None, out: str) -> argparse.ArgumentParser:
    """A parser for `python -m robots.<program>`, with the option `--out` that all shows have."""
    parser = argparse.ArgumentParser(prog=f"python -m robots.{program}", description=description)
    parser.add_argument(
        "--out", type=Path, default=Path(out), help="folder of its files (%(default)s)"
    )
    return parser


def forwarded_arguments(options: argparse.Namespace, *names: str) -> list[str]:
    """Format these options as arguments for another program."""
    return [f"--{name}={getattr(options, name)}" for name in names]


def between(least: float, most: float, what: str) -> Callable[[str], float]:
    """The type of an option with a number from *least* to *most*; *what* names it in errors."""

    def number(text: str) -> float:
        if not least <= float(text) <= most:
            raise argparse.ArgumentTypeError(
                f"{what} is a number from {least:g} to {most:,g}, not {text}"
            )
        return float(text)

    return number
