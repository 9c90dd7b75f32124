"""Long runs: ``make soak``."""

from pathlib import Path

import pytest
from integration.programs import central
from integration.test_walk import walk

from tca_module import Goal, Module, Outcome, Task
from tca_tools.run.fold import History
from tca_tools.run.journals import open_log

pytestmark = pytest.mark.soak


def test_the_ambler_walks_thirty_metres_of_steeper_hills(tmp_path: Path) -> None:
    pytest.importorskip("pybullet")
    done = walk(tmp_path / "walk", "--distance", "30", "--arcs", "3", "--slope", "0.2", "--pace", "0")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "30.0 of 30.0 m" in done.stdout


def resident(process: int) -> int:
    """Memory of a process in bytes."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * 4096


def test_central_does_not_grow_with_the_tasks_that_have_ended(tmp_path: Path) -> None:
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
