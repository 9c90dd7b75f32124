"""The same walk three times: as sense, plan, act; with planning one step ahead; with perception concurrent as well."""

import argparse
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from robots.ambler_sim.messages import ACQUIRE_IMAGE, MOVE_BODY, MOVE_LEG, TAKE_STEPS, UPDATE_MAP
from robots.ambler_sim.run.figures import read_footsteps
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_wire.points import Moment

WAITING = (TAKE_STEPS.name, ACQUIRE_IMAGE.name)
"""Handlers that mostly wait for others."""

MODES = ("sequential", "ahead", "concurrent")


class ModeFigures(NamedTuple):
    """Of one walk, from its journal: metres a minute, seconds a step, shares of the time from its first move to its
    last, and the program that was busy for the greatest share.
    """

    speed: float
    step: float
    moving: float
    planning: float
    bottleneck: str
    busy: float

    def row(self, mode: str) -> str:
        """A line of the table."""
        return (
            f"| {mode} | {self.speed:.1f} m/min | {self.step:.2f} s | {self.moving:.0%} | {self.planning:.0%}"
            f" | {self.bottleneck}, {self.busy:.0%} |"
        )


def walk(mode: str, folder: Path, options: list[str]) -> ModeFigures:
    """One walk, and what its journal says."""
    command = [sys.executable, "-m", "robots.ambler_sim", "--mode", mode, "--out", str(folder), *options]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    history = History.until(open_log(folder / "journal"))
    return mode_figures(history, len(read_footsteps(folder / "footsteps.jsonl")))


def mode_figures(history: History, footsteps: int) -> ModeFigures:
    """How the time of a walk was used."""
    moves = [handling for task in history.tasks.values() if task.name in (MOVE_LEG.name, MOVE_BODY.name)
             for handling in task.handlings]  # fmt: skip
    first, last = min(move.start for move in moves), max(move.until for move in moves)
    span = last - first
    plans = [task.reached for task in history.tasks.values() if task.name in (TAKE_STEPS.name, UPDATE_MAP.name)]
    planning = sum(
        plan[Moment.END_HANDLING] - plan[Moment.START_HANDLING] for plan in plans if plan[Moment.END_HANDLING] <= last
    )
    busy: defaultdict[str, float] = defaultdict(float)
    for handling in history.handlings:
        if handling.until <= last and handling.name not in WAITING:
            busy[handling.module] += handling.until - handling.start
    name = max(busy, key=lambda each: busy[each])
    moving = sum(move.until - move.start for move in moves)
    return ModeFigures(
        footsteps / 2 / span * 60, span / footsteps, moving / span, planning / span, name, busy[name] / span
    )


def main() -> None:
    """The command line; options that it does not know are the walks'."""
    parser = argparse.ArgumentParser(prog="python -m robots.ambler_sim.run.modes", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("modes"), help="folder for the three walks")
    known, options = parser.parse_known_args()
    known.out.mkdir(parents=True, exist_ok=True)
    print("| mode | speed | a step | something moves | something plans | busiest |\n|---|---|---|---|---|---|")
    for mode in MODES:
        print(walk(mode, known.out / mode, options).row(mode), flush=True)


if __name__ == "__main__":
    main()
