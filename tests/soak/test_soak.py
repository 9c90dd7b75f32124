"""Long runs: ``make soak``."""

from pathlib import Path

import msgspec
import pytest
from integration.test_walk import walk
from processes import central

from robots.ambler_sim.run.figures import Figures
from tca_module import Goal, Module, Outcome, Task
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log

pytestmark = pytest.mark.soak

MOST_HARMLESS = 2
"""Faults in 500 m without an effect: a rock beside the leg's path, a rock at the last footstep."""

MOST_GROWTH = 10.0
"""The greatest growth of memory, in MB per 100 m. A heap may grow once by 20 MB; a leak in each
step grows more.
"""


def test_ambler_walks_500_m_of_steep_hills_with_all_faults(
    tmp_path: Path,
) -> None:
    pytest.importorskip("pybullet")
    options = (
        "--distance",
        "500",
        "--terrain",
        "hills",
        "--faults",
        "all",
        "--seed",
        "11",
        "--pace",
        "0",
    )
    done = walk(tmp_path / "walk", *options, timeout=3600)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = msgspec.json.decode((tmp_path / "walk" / "figures.json").read_bytes(), type=Figures)
    assert figures.way >= 500
    assert figures.footsteps >= 1000
    assert 0.28 <= figures.steepest <= 0.3
    assert figures.most_tilt <= 2
    assert figures.error <= 0.02 * figures.way
    assert (figures.checked_before, figures.checked_after) == (1.0, 1.0)
    assert (figures.rules.kept, figures.rules.others) == (figures.rules.number, ())
    assert len(figures.faults) >= 6
    injected, recovered = (
        sum(getattr(kind, name) for kind in figures.faults.values())
        for name in ("injected", "recovered")
    )
    assert recovered >= max(50, injected - MOST_HARMLESS)
    assert figures.memory.growth is not None
    assert figures.memory.growth < MOST_GROWTH


def test_ambler_seed_gives_the_same_footsteps(tmp_path: Path) -> None:
    losses = [
        text for step in (5, 9, 14, 20, 26, 33, 40) for text in ("--fault", f"lost module@{step}")
    ]
    options = (
        *losses,
        "--backend",
        "kinematic",
        "--distance",
        "30",
        "--terrain",
        "hills",
        "--faults",
        "all",
        "--pace",
        "0",
    )
    for name in ("first", "again"):
        assert walk(tmp_path / name, *options).returncode == 0
    first, again = (
        (tmp_path / name / "footsteps.jsonl").read_bytes() for name in ("first", "again")
    )
    assert first == again


def resident(process: int) -> int:
    """Resident memory of a process in bytes."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * 4096


def test_central_does_not_grow_with_ended_tasks(tmp_path: Path) -> None:
    walk_goal = Goal("walk", int)
    with central(tmp_path, "--quiet") as daemon:
        robot = Module("robot", daemon.address)

        @robot.handles(walk_goal)
        def handle(_: Task, _number: int) -> None:
            pass

        sizes = []
        with robot.running():
            for _ in range(4):
                for number in range(5_000):
                    last = robot.goal(walk_goal, number)
                assert last.wait(timeout=60) is Outcome.DONE
                sizes.append(resident(daemon.process.pid))
    assert sizes[-1] - sizes[0] < 8 << 20, sizes
    assert len(History.until(open_log(daemon.journal)).tasks) == 20_000
