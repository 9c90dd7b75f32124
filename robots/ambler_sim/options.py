"""The options of a walk. Its programs are started with all of them, and each takes what concerns
it.
"""

import argparse
from enum import StrEnum
from pathlib import Path
from typing import Literal, get_args

from robots.ambler_sim.vocabulary import KINDS, TERRAINS
from robots.options import between, parser_of

FARTHEST = 1500.0
"""Metres of a walk; hills go on for a little more."""

Backend = Literal["auto", "pybullet", "kinematic", "graphical"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)

LAYERS = tuple(
    sorted(
        file.stem.replace("_", " ") for file in Path(__file__).with_name("layers").glob("[!_]*.py")
    )
)
"""Programs that the others have never heard of: checks before and after moves, and what is done
about failures.
"""


class Mode(StrEnum):
    """How much goes on at once."""

    SEQUENTIAL = "sequential"
    AHEAD = "ahead"
    CONCURRENT = "concurrent"


def walk_options(program: str = "", description: str | None = None) -> argparse.ArgumentParser:
    """The command line of a walk, or of a program of it: of *program* in this package."""
    parser = parser_of(f"ambler_sim{program}", description, out="walk")
    add = parser.add_argument
    add(
        "--distance",
        dest="metres",
        type=between(0.1, FARTHEST, "the distance"),
        default=6.0,
        metavar="METRES",
        help="how far to walk",
    )
    add("--arcs", type=int, help="in how many arcs; by default two or more, of about 10 m")
    add(
        "--mode",
        type=Mode,
        choices=list(Mode),
        default=Mode.CONCURRENT,
        help="how much goes on at once: nothing; planning one step ahead; perception, too",
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
        help="how many rocks lie on the way, which the scanner does not see",
    )
    add(
        "--faults",
        type=kinds_of,
        default=(),
        metavar="all|KIND,...",
        help=f"what goes wrong at random: {', '.join(KINDS)}",
    )
    add(
        "--fault",
        type=fault_at,
        action="append",
        default=[],
        metavar="KIND@STEP",
        help="one fault with that leg move (1, 2, ...); may be repeated",
    )
    add(
        "--without",
        action="append",
        default=[],
        choices=LAYERS,
        metavar="LAYER",
        help=f"leave out a layer: {', '.join(LAYERS)}",
    )
    add("--bare", action="store_true", help="without any layer, and without error recovery")
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


def kinds_of(text: str) -> tuple[str, ...]:
    """From "all" or a list with commas. Raises ArgumentTypeError for a kind that there is not."""
    kinds = KINDS if text == "all" else tuple(filter(None, text.split(",")))
    if wrong := [kind for kind in kinds if kind not in KINDS]:
        raise argparse.ArgumentTypeError(
            f"there are no faults of kind {wrong[0]!r}: there are {', '.join(KINDS)}"
        )
    return kinds


def fault_at(text: str) -> tuple[str, int]:
    """A kind of fault, and the number of the leg move with which it comes."""
    kind, _, number = text.partition("@")
    if kind not in KINDS or not number.isdecimal():
        raise argparse.ArgumentTypeError(
            f"{text!r} is no fault: give KIND@STEP, with a kind of {', '.join(KINDS)}"
        )
    return kind, int(number)
