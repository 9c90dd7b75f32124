"""The command line of each program of the robot."""

import argparse
from collections.abc import Callable

from tca_module import Module


def run(make_module: Callable[[float], Module]) -> None:
    """Make the module, with the pace of the command line, and run it."""
    parser = argparse.ArgumentParser(
        description="One program of the robot that keeps a floor free of cups."
    )
    parser.add_argument(
        "--pace", type=float, default=1.0, help="how fast the robot's time passes (%(default)s)"
    )
    make_module(parser.parse_args().pace).run()
