"""The Ambler's walk on real processes, judged by its journal."""

import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner

from tca_tools.check.__main__ import check
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_wire.points import Moment

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]

UNUSED_LAYERS = (
    "hardware",
    "lost module",
    "planners",
    "sensors",
    "terrain contact",
    "tip over",
)
"""Layers with nothing to do in a walk without faults. Each is a process. The soak has them."""


def walk(folder: Path, *options: str, timeout: float = 150.0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "robots.ambler_sim", "--out", str(folder), *options]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=timeout, check=False
    )


@pytest.fixture(
    scope="module", params=["kinematic", pytest.param("pybullet", marks=pytest.mark.soak)]
)
def walked(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path]:
    if request.param == "pybullet":
        pytest.importorskip("pybullet")
    folder = tmp_path_factory.mktemp(request.param) / "walk"
    layers = UNUSED_LAYERS if request.param == "kinematic" else ()
    without = [word for layer in layers for word in ("--without", layer)]
    options = ("--backend", request.param, "--distance", "4", "--pace", "15")
    done = walk(folder, *options, "--between-arcs", "swap", *without)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout, folder


@pytest.fixture(scope="module")
def history(walked: tuple[str, Path]) -> History:
    return History.until(open_log(walked[1] / "journal"))


def tasks(history: History, name: str) -> list[int]:
    return sorted(task.id for task in history.tasks.values() if task.name == name)


def test_robot_walks_four_metres_and_names_its_pictures(
    walked: tuple[str, Path],
) -> None:
    output, folder = walked
    assert "4.0 of 4.0 m" in output
    for title, suffix in (
        ("the robot", r"\.(png|svg)"),
        ("task tree", r"\.(svg|txt)"),
        ("Gantt chart", r"\.svg"),
    ):
        written = re.search(rf"{title}\s+(\S+{suffix})", output)
        assert written, output
        assert Path(written[1]).stat().st_size > 1000
    assert (folder / "robot.json").exists()


def test_task_tree_of_the_walk_matches_figure_2(history: History) -> None:
    (path,) = tasks(history, "traverse path")
    arcs = tasks(history, "traverse arc")
    assert [history.tasks[arc].parent for arc in arcs] == [path, path]
    for arc in arcs:
        assert child_names(history, arc) == ["acquire image", "take steps"]
        for number, steps in enumerate(chain := steps_of(history, arc)):
            names = [name for name in child_names(history, steps) if name != "acquire image"]
            assert names[:3] == ["move leg", "move body", "achieved position?"]
            assert names[3:] == (["take steps"] if number + 1 < len(chain) else [])


def child_names(history: History, task: int) -> list[str]:
    return [history.tasks[child].name for child in history.tasks[task].children]


def test_next_step_is_planned_while_walking_the_current_one(history: History) -> None:
    for arc in tasks(history, "traverse arc"):
        chain = steps_of(history, arc)
        assert len(chain) >= 4
        for now, following in pairwise(chain):
            body = history.tasks[
                history.tasks[now].children[child_names(history, now).index("move body")]
            ].reached
            started, planned = (
                history.tasks[now].reached[Moment.START_ACHIEVING],
                history.tasks[following].reached,
            )
            assert (
                started
                <= planned[Moment.START_HANDLING]
                < planned[Moment.END_HANDLING]
                < body[Moment.END_HANDLING]
            )


def test_walk_keeps_all_rules_and_properties(walked: tuple[str, Path]) -> None:
    """The journal is of real processes, and a module was replaced during the walk."""
    wanted = [
        "at most 1 planned ahead of take steps",
        "at most 2 handled by controller",
        "move leg achieved before move body achieved",
        "never stuck",
    ]
    options = [option for text in wanted for option in ("--property", text)]
    found = CliRunner().invoke(check, [str(walked[1] / "journal"), *options])
    assert found.exit_code == 0, found.output
    broken = CliRunner().invoke(
        check, [str(walked[1] / "journal"), "--property", "never planned ahead of take steps"]
    )
    assert broken.exit_code == 1
    assert "the story of take steps {" in broken.output


def test_next_arc_is_planned_after_the_previous_is_walked(history: History) -> None:
    first, second = (history.tasks[arc].reached for arc in tasks(history, "traverse arc"))
    assert second[Moment.START_PLANNING] >= first[Moment.END_ACHIEVING]


def test_walk_continues_after_controller_replacement(
    walked: tuple[str, Path], history: History
) -> None:
    assert "the controller ended (0); starting another" in walked[0]
    first, second = history.modules["controller"].joined
    assert first[1] is not None
    moved = [
        history.tasks[task].reached[Moment.START_HANDLING] for task in tasks(history, "move leg")
    ]
    assert min(moved) < first[1] < second[0] < max(moved)


def steps_of(history: History, arc: int) -> list[int]:
    """Return the take-steps tasks of an arc, outermost first."""
    chain = [arc]
    while below := [
        child
        for child in history.tasks[chain[-1]].children
        if history.tasks[child].name == "take steps"
    ]:
        chain += below
    return chain[1:]


def test_walk_refuses_a_folder_with_other_files(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    done = walk(tmp_path)
    assert done.returncode == 1
    assert "holds files that are not a walk's: name another folder with --out" in done.stderr
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
