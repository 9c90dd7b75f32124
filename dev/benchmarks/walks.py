"""Run walks of the Ambler in turn and print a table of them.

python -m dev.benchmarks.walks seeds --distance 500 --terrain hills --faults all
python -m dev.benchmarks.walks modes --distance 12 --terrain hills --pace 20

Options that this program does not know are passed to the walks.
"""

import argparse
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import msgspec

from robots.ambler_sim.messages import ACQUIRE_IMAGE, MOVE_BODY, MOVE_LEG, TAKE_STEPS, UPDATE_MAP
from robots.ambler_sim.options import Mode
from robots.ambler_sim.run.figures import Figures
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_wire.points import Moment

SEED_TITLES = (
    "seed",
    "way",
    "footsteps",
    "steepest",
    "faults recovered",
    "kinds",
    "operator",
    "greatest tilt",
    "least margin",
    "error",
    "rules",
    "time",
    "processor",
    "memory of central and all",
)
MODE_TITLES = "mode", "speed", "a step", "something moves", "something plans", "busiest"

WAITING = (TAKE_STEPS.name, ACQUIRE_IMAGE.name)
"""Handlers that mostly wait for other handlers."""


def walk(folder: Path, options: list[str]) -> tuple[bool, Figures | None]:
    """Run a walk; return whether it was completed, and its figures; None if the walk was killed."""
    command = [sys.executable, "-m", "robots.ambler_sim", "--out", str(folder), *options]
    code = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
    written = folder / "figures.json"
    if not written.exists():
        return code == 0, None
    return code == 0, msgspec.json.decode(written.read_bytes(), type=Figures)


def row_of_seed(has_arrived: bool, figures: Figures) -> list[str]:
    """Return the row of a walk."""
    injected = sum(each.injected for each in figures.faults.values())
    recovered = sum(each.recovered for each in figures.faults.values())
    return [
        f"{figures.way:.0f} m" + ("" if has_arrived else ", given up"),
        f"{figures.footsteps:,}",
        f"{figures.steepest:.1%}",
        f"{recovered} of {injected}",
        f"{len(figures.faults)}",
        f"{figures.operator_calls}",
        f"{figures.most_tilt:.2f}\N{DEGREE SIGN}",
        f"{figures.least_margin:.2f} m",
        f"{figures.error:.2f} m",
        f"{figures.rules}",
        f"{figures.wall:.0f} s",
        f"{figures.cpu:.0f} s",
        f"{figures.memory}",
    ]


def row_of_mode(history: History, footsteps: int) -> list[str]:
    """Return the row of a mode.

    Its columns: metres a minute, seconds a step, shares of the time between first and last move,
    and the program with the greatest share.
    """
    tasks = history.tasks.values()
    moving_tasks = [task for task in tasks if task.name in (MOVE_LEG.name, MOVE_BODY.name)]
    moves = [handling for task in moving_tasks for handling in task.handlings]
    first, last = min(move.start for move in moves), max(move.until for move in moves)
    span = last - first
    moving = sum(move.until - move.start for move in moves)
    plans = [task.reached for task in tasks if task.name in (TAKE_STEPS.name, UPDATE_MAP.name)]
    planning = sum(
        plan[Moment.END_HANDLING] - plan[Moment.START_HANDLING]
        for plan in plans
        if plan[Moment.END_HANDLING] <= last
    )
    busy: defaultdict[str, float] = defaultdict(float)
    for handling in history.handlings:
        if handling.until <= last and handling.name not in WAITING:
            busy[handling.module] += handling.until - handling.start
    name = max(busy, key=lambda each: busy[each])
    return [
        f"{footsteps / 2 / span * 60:.1f} m/min",
        f"{span / footsteps:.2f} s",
        f"{moving / span:.0%}",
        f"{planning / span:.0%}",
        f"{name}, {busy[name] / span:.0%}",
    ]


def show(*cells: str) -> None:
    """Print a line of a table."""
    print(f"| {' | '.join(cells)} |", flush=True)


def walk_over_seeds(seeds: list[int], out: Path, options: list[str]) -> bool:
    """Walk over the hills of several seeds; return whether the robot has arrived each time."""
    arrivals = []
    for seed in seeds:
        folder = out / f"seed-{seed}"
        has_arrived, figures = walk(folder, ["--seed", str(seed), "--pace", "0", *options])
        arrivals.append(has_arrived)
        row = row_of_seed(has_arrived, figures) if figures else [f"no figures: see {folder}"]
        show(str(seed), *row)
    return all(arrivals)


def walk_in_modes(out: Path, options: list[str]) -> bool:
    """Walk with sense, plan, act; with planning one step ahead; with concurrent perception, too."""
    for mode in Mode:
        _, figures = walk(out / mode, ["--mode", mode, *options])
        if figures is None:
            return False
        show(mode, *row_of_mode(History.until(open_log(out / mode / "journal")), figures.footsteps))
    return True


def main() -> int:
    """Run the command line. Exit code 1 if a walk was given up."""
    parser = argparse.ArgumentParser(prog="python -m dev.benchmarks.walks", description=__doc__)
    parser.add_argument("table", choices=("seeds", "modes"))
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=list(range(1, 11)), help="the hills of the table"
    )
    parser.add_argument("--out", type=Path, default=Path("walks"), help="folder for the walks")
    known, options = parser.parse_known_args()
    known.out.mkdir(parents=True, exist_ok=True)
    titles = SEED_TITLES if known.table == "seeds" else MODE_TITLES
    show(*titles)
    show(*("---" for _ in titles))
    if known.table == "seeds":
        return 0 if walk_over_seeds(known.seeds, known.out, options) else 1
    return 0 if walk_in_modes(known.out, options) else 1


if __name__ == "__main__":
    sys.exit(main())
