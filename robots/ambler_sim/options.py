"""The options of a walk. Each program of a walk gets all of them and uses those that concern it."""

import argparse
from enum import StrEnum
from pathlib import Path
from typing import Literal, get_args

from robots.ambler_sim.vocabulary import KINDS, TERRAINS
from robots.options import add_without, number_between, show_parser

FARTHEST = 1500.0
"""The longest walk in metres; hills reach a little further."""

Backend = Literal["auto", "pybullet", "kinematic", "graphical"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)

LAYERS = tuple(
    sorted(
        file.stem.replace("_", " ") for file in Path(__file__).with_name("layers").glob("[!_]*.py")
    )
)
"""Programs that check moves and recover from failures. The other programs do not know them."""


class Mode(StrEnum):
    """How much runs at the same time."""

    SEQUENTIAL = "sequential"
    AHEAD = "ahead"
    CONCURRENT = "concurrent"


def walk_options(program: str = "", description: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of a walk's options or, with *program*, of the same options for that
    program.
    """
    parser = show_parser(f"ambler_sim{program}", description, out="walk")
    add = parser.add_argument
    add(
        "--distance",
        dest="metres",
        type=number_between(0.1, FARTHEST, "the distance"),
        default=6.0,
        metavar="METRES",
        help="how far to walk",
    )
    add("--arcs", type=int, help="the number of arcs; by default two or more, each of about 10 m")
    add(
        "--mode",
        type=Mode,
        choices=list(Mode),
        default=Mode.CONCURRENT,
        help="how much runs beside the walking: nothing; planning one step ahead; perception, too",
    )
    add("--backend", choices=BACKENDS, default="auto")
    add("--gui", action="store_true", help="show physics in PyBullet's own window")
    add("--pace", type=float, default=10.0, help="times real time; 0 is as fast as possible")
    add("--seed", type=int, default=1, help="which hills")
    add("--slope", type=float, default=0.30, help="steepest rise per run of hills")
    add("--terrain", choices=TERRAINS, default="rolling", help="what kind of ground")
    add(
        "--rock",
        nargs=4,
        type=float,
        action="append",
        default=[],
        metavar=("X", "Y", "RADIUS", "HEIGHT"),
        help="a rock that the scanner does not see; may be given several times",
    )
    add(
        "--rocks",
        type=int,
        default=0,
        help="how many rocks lie on the way; the scanner does not see them",
    )
    add(
        "--faults",
        type=parse_kinds,
        default=(),
        metavar="all|KIND,...",
        help=f"faults that occur at random: {', '.join(KINDS)}",
    )
    add(
        "--fault",
        type=parse_fault,
        action="append",
        default=[],
        metavar="KIND@STEP",
        help="one fault with that leg move (1, 2, ...); may be repeated",
    )
    add_without(parser, LAYERS)
    add("--bare", action="store_true", help="without layers and without error recovery")
    add(
        "--film",
        type=Path,
        metavar="FILE",
        help="an animated picture of the walk: .webp, .gif or .png",
    )
    add("--film-from", type=int, default=0, metavar="STEP", help="film from that footstep on")
    add(
        "--between-arcs",
        choices=("swap", "ask"),
        help="swap: stop the controller and start another; ask: wait for Enter",
    )
    add("--swap-to", choices=BACKENDS[1:], help="the other controller of --between-arcs swap")
    return parser


def parse_kinds(text: str) -> tuple[str, ...]:
    """Parse "all" or a list with commas. Raises ArgumentTypeError for an unknown kind."""
    kinds = KINDS if text == "all" else tuple(filter(None, text.split(",")))
    if unknown := [kind for kind in kinds if kind not in KINDS]:
        raise argparse.ArgumentTypeError(
            f"unknown kind of fault {unknown[0]!r}: use {', '.join(KINDS)}"
        )
    return kinds


def parse_fault(text: str) -> tuple[str, int]:
    """Parse KIND@STEP: a kind of fault, and the number of the leg move with which it comes."""
    kind, _, number = text.partition("@")
    if kind not in KINDS or not number.isdecimal():
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a fault: give KIND@STEP, where KIND is one of {', '.join(KINDS)}"
        )
    return kind, int(number)
