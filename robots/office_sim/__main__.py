"""Shows the robot that keeps a lab floor free of cups: cups fall, people take some of them away,
the robot collects the others, and charges its battery in between.
"""

import argparse
import sys
from typing import Any

from robots.office_sim.drawing import draw, in_words
from robots.office_sim.layers.battery import IS_LOW
from robots.office_sim.layers.grasps import GRASP_AGAIN
from robots.office_sim.layers.vanished_cups import IS_GONE
from robots.office_sim.messages import (
    CALL_IT_A_DAY,
    CUPS_IN_VIEW,
    FOLLOW_PATH,
    KEEP_FLOOR_FREE,
    NAVIGATE,
    OPEN_LAB,
    SCENE,
)
from robots.office_sim.vocabulary import CupState, LabScene
from robots.options import between, forwarded, parser_of
from robots.show import history, save_picture, shown
from tca_module import Client, Message, SentTask, connect
from tca_tools.supervise.programs import START_TIME, Programs, central_in

ProgramTable = dict[str, Message[Any, Any]]
"""Beside each program is a message that it handles: once it does, all that it attaches is in
force.
"""

MODULES: ProgramTable = {
    "vision": CUPS_IN_VIEW,
    "controller": FOLLOW_PATH,
    "planner": NAVIGATE,
    "task manager": KEEP_FLOOR_FREE,
}
LAYERS: ProgramTable = {"vanished cups": IS_GONE, "battery": IS_LOW, "grasps": GRASP_AGAIN}

PATIENCE = 900.0
"""Seconds of the lab within which no cup must be left after the last has fallen; else some stay
there.
"""


def main() -> int:
    """The command line; the exit code."""
    parser = parser_of("office_sim", __doc__, out="runs/office")
    parser.add_argument(
        "--seed", type=int, default=1, help="which lab, which cups and people (%(default)s)"
    )
    parser.add_argument(
        "--pace",
        type=between(0.1, 100.0, "the pace"),
        default=16.0,
        help="how fast the lab's time passes (%(default)s)",
    )
    parser.add_argument(
        "--shift",
        type=between(1.0, 36000.0, "the shift"),
        default=240.0,
        help="seconds in which cups fall (%(default)s)",
    )
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        choices=LAYERS,
        metavar="LAYER",
        help=f"leave out a layer: {', '.join(LAYERS)}",
    )
    return shown(parser, _show)


def _show(options: argparse.Namespace) -> int:
    title, folder = f"seed {options.seed}", options.out
    scene, keeping = _shift(options)
    print(f"{title}: {in_words(scene)}")
    for path in (*save_picture(folder / "lab", draw(scene, title)), *history(folder)):
        print("made", path)
    keeping.result()
    return 0


def _shift(options: argparse.Namespace) -> tuple[LabScene, SentTask[None]]:
    """Have the floor kept free by programs of their own; the lab at the end, and the goal, which
    has ended.
    """
    layers = {name: handled for name, handled in LAYERS.items() if name not in options.without}
    pace = forwarded(options, "pace")
    with central_in(options.out) as (address, programs):
        world = forwarded(options, "seed", "shift")
        programs.start_module("simulator", "robots.office_sim.modules.simulator", *pace, *world)
        for name in MODULES:
            programs.start_module(
                name, f"robots.office_sim.modules.{name.replace(' ', '_')}", *pace
            )
        for name in layers:
            programs.start_module(
                f"{name} layer", f"robots.office_sim.layers.{name.replace(' ', '_')}", *pace
            )
        with connect("user", address, START_TIME) as user:
            programs.wait_until_handled(user, OPEN_LAB, *MODULES.values(), *layers.values())
            user.inform(OPEN_LAB)
            return _watch(user, programs, options.shift + PATIENCE)


def _watch(user: Client, programs: Programs, latest: float) -> tuple[LabScene, SentTask[None]]:
    """Say what happens, and call it a day when all cups have fallen and none is left."""
    keeping = user.goal(KEEP_FLOOR_FREE)
    told, has_called = 0, False
    for is_over in programs.looks(keeping):
        scene = user.query(SCENE)
        for line in scene.happened[told:]:
            print(line, flush=True)
        told = len(scene.happened)
        is_free = all(cup.state in (CupState.BIN, CupState.TAKEN) for cup in scene.cups)
        if not (is_over or has_called) and (is_free or scene.time > latest):
            user.inform(CALL_IT_A_DAY)
            has_called = True
    return scene, keeping


if __name__ == "__main__":
    sys.exit(main())
