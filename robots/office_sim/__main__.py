"""Show the robot that keeps a lab floor free of cups.

Cups fall, and people pick some of them up. The robot collects the others, and charges its battery
in between.
"""

import argparse
import sys
from typing import Any

from robots.office_sim.drawing import describe_result, draw
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
from robots.options import add_number, add_without, forwarded_arguments, show_parser
from robots.show import draw_history, run_show, save_picture
from tca_module import Client, Message, SentTask, connect
from tca_tools.supervise.programs import START_TIME, Programs, central_in

ProgramTable = dict[str, Message[Any, Any]]
"""Programs of the robot, each with one message that it handles. Once that message has a handler,
all that the program attaches is in force.
"""

MODULES: ProgramTable = {
    "vision": CUPS_IN_VIEW,
    "controller": FOLLOW_PATH,
    "planner": NAVIGATE,
    "task manager": KEEP_FLOOR_FREE,
}
LAYERS: ProgramTable = {"vanished cups": IS_GONE, "battery": IS_LOW, "grasps": GRASP_AGAIN}

PATIENCE = 900.0
"""Seconds of the lab's time after the shift. Then the show ends, even if cups are left."""


def main() -> int:
    """Run the command line. Returns the exit code."""
    parser = show_parser("office_sim", __doc__, out="runs/office")
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of the lab, the cups and the people (%(default)s)"
    )
    add_number(parser, "pace", (0.1, 100.0), 16.0, "how fast the lab's time passes")
    add_number(parser, "shift", (1.0, 36000.0), 240.0, "seconds in which cups fall")
    add_without(parser, LAYERS)
    return run_show(parser, _show)


def _show(options: argparse.Namespace) -> int:
    title, folder = f"seed {options.seed}", options.out
    scene, keeping = _run_shift(options)
    print(f"{title}: {describe_result(scene)}")
    for path in (*save_picture(folder / "lab", draw(scene, title)), *draw_history(folder)):
        print("made", path)
    keeping.result()
    return 0


def _run_shift(options: argparse.Namespace) -> tuple[LabScene, SentTask[None]]:
    """Run the shift, each program as a process. Returns the lab at the end, and the ended goal."""
    layers = {name: handled for name, handled in LAYERS.items() if name not in options.without}
    pace = forwarded_arguments(options, "pace")
    with central_in(options.out) as (address, programs):
        world = forwarded_arguments(options, "seed", "shift")
        programs.start_module("simulator", "robots.office_sim.modules.simulator", *pace, *world)
        started = {name: f"modules.{name}" for name in MODULES}
        started |= {f"{name} layer": f"layers.{name}" for name in layers}
        for name, module in started.items():
            programs.start_module(name, f"robots.office_sim.{module.replace(' ', '_')}", *pace)
        with connect("user", address, START_TIME) as user:
            programs.wait_until_handled(user, OPEN_LAB, *MODULES.values(), *layers.values())
            user.inform(OPEN_LAB)
            return _watch(user, programs, options.shift + PATIENCE)


def _watch(user: Client, programs: Programs, last_call: float) -> tuple[LabScene, SentTask[None]]:
    """Print the events until the goal ends. Sends CALL_IT_A_DAY when no cup is left or to come, at
    the latest at the lab's time *last_call*.
    """
    keeping = user.goal(KEEP_FLOOR_FREE)
    printed, has_called = 0, False
    for is_over in programs.watch(keeping):
        scene = user.query(SCENE)
        for line in scene.happened[printed:]:
            print(line, flush=True)
        printed = len(scene.happened)
        is_done = all(cup.state in (CupState.BIN, CupState.TAKEN) for cup in scene.cups)
        if not (is_over or has_called) and (is_done or scene.time > last_call):
            user.inform(CALL_IT_A_DAY)
            has_called = True
    return scene, keeping


if __name__ == "__main__":
    sys.exit(main())
