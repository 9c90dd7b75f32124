"""Command-line options that robots share. Robots' programs import this file, so it stays light."""

import argparse
from collections.abc import Callable, Collection
from pathlib import Path


def program_parser(program: str, description: str | None) -> argparse.ArgumentParser:
    """Return a parser for the command line `python -m robots.<program>`."""
    return argparse.ArgumentParser(prog=f"python -m robots.{program}", description=description)


def show_parser(program: str, description: str | None, out: str) -> argparse.ArgumentParser:
    """Return a ``program_parser`` with the option `--out`, which all shows have. *out* is its
    default.
    """
    parser = program_parser(program, description)
    parser.add_argument(
        "--out", type=Path, default=Path(out), help="folder of its files (%(default)s)"
    )
    return parser


def forwarded_arguments(options: argparse.Namespace, *names: str) -> list[str]:
    """Format these options as arguments for another program."""
    return [f"--{name}={getattr(options, name)}" for name in names]


def add_number(
    parser: argparse.ArgumentParser,
    name: str,
    limits: tuple[float, float],
    default: float,
    text: str,
) -> None:
    """Add the option `--<name>`, a number within *limits*. *text* is its help."""
    parser.add_argument(
        f"--{name}",
        type=number_between(*limits, f"the {name}"),
        default=default,
        help=f"{text} (%(default)s)",
    )


def add_without(parser: argparse.ArgumentParser, layers: Collection[str]) -> None:
    """Add the option `--without`, which may be repeated."""
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        choices=layers,
        metavar="LAYER",
        help=f"leave out a layer: {', '.join(layers)}",
    )


def number_between(least: float, most: float, what: str) -> Callable[[str], float]:
    """Return the type of an option with a number from *least* to *most*. Errors call the option
    *what*.
    """

    def number(text: str) -> float:
        if not least <= float(text) <= most:
            raise argparse.ArgumentTypeError(
                f"{what} is a number from {least:g} to {most:,g}, not {text}"
            )
        return float(text)

    return number
