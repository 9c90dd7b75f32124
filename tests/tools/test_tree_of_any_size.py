"""Task trees of any size and shape, on terminals of any width; the cost of tools for long runs."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from click import unstyle
from click.testing import Result
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sampling import every
from tools.story import COMMAND, GOAL, Story, stumbling

from dev.benchmarks.long_runs import SHAPES, TOOLS, make
from tca_tools.analysis.backwards import Causes
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.journal.lives import life_at
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_tools.replay.growth import growth_lines
from tca_tools.replay.recording import Recording
from tca_tools.tasktree_viz.outline import excerpt, outline, whole_outline
from tca_tools.tasktree_viz.text import ASCII, UNICODE, story_lines, tree_lines
from tca_tools.terminal import columns_of
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass

Tca = Callable[..., Result]
Leaf = tuple[int, str, int]
NAMES = ("a", "", "take steps", "机器人" * 9, "pour concrete with a really long name" * 2)
WHY = "slip: on very thin ice, because it was cold\nTraceback\n  line 3"
FATES: tuple[Callable[[Story, int], object], ...] = (
    lambda story, number: story.reached(number, *Moment),
    lambda story, number: story.say(facts.Failed(number, "slip", WHY)),
    lambda story, number: story.say(facts.Killed(TaskId(number), WHY)).reached(number, *Moment),
    lambda story, number: story.queued(number, "legs"),
    lambda story, number: story.say(facts.SuspendedOrResumed(TaskId(number), True, "user")),
    lambda story, number: story.delivered(number, "legs"),
)
TASKS = st.tuples(st.integers(0, 8), st.sampled_from(NAMES), st.sampled_from(range(len(FATES))))


def grown(tasks: list[Leaf]) -> Story:
    """Return a story of tasks. Each task is below the previous task, or the given number of levels
    further up.
    """
    story, path = Story().at(1.0), list[int]()
    kinds = [GOAL, COMMAND, MessageClass.POLLING_MONITOR]
    for place, (up, name, _) in enumerate(tasks):
        del path[max(len(path) - up, 0) :]
        path.append(
            story.received(
                name, kinds[place % 3], "user", path[-1] if path else 0, data={"at": place}
            )
        )
    for number in range(len(tasks), 0, -1):
        FATES[tasks[number - 1][2]](story.at(story.entries[-1].time + 900.0), number)
    return story


FLAT = [(0, "walk", 5), *[(1, "step", 0)] * 349]
DEEP = [(0 if place % 20 else 19, "take steps", 5 if place > 390 else 0) for place in range(400)]


@settings(max_examples=30)
@example(FLAT, 30, False)
@example(DEEP, 80, False)
@given(st.lists(TASKS, min_size=1, max_size=60), st.integers(20, 200), st.booleans())
def test_text_tree_is_never_wider_than_the_terminal(
    tasks: list[Leaf], width: int, with_data: bool
) -> None:
    story = grown(tasks)
    at = RunAt(story.fold())
    for rows in (outline(at), outline(at, 5, 3), whole_outline(at)):
        for guides in (UNICODE, ASCII):
            lines = tree_lines(at, rows, width=width, guides=guides, with_data=with_data)
            assert max(columns_of(unstyle(line)) for line in lines) <= width
    if len(tasks) < len(FLAT):
        others = [
            *growth_lines(Recording(story.entries), 0.0, width),
            *story_lines(at.run, len(tasks), width),
        ]
        assert max(columns_of(unstyle(line)) for line in others) <= width


@settings(max_examples=30)
@example(FLAT, 30)
@example(DEEP, 80)
@given(st.lists(TASKS, min_size=1, max_size=60), st.integers(2, 40))
def test_excerpt_counts_every_task_within_its_row_limit(tasks: list[Leaf], at_most: int) -> None:
    at = RunAt(grown(tasks).fold())
    rows = excerpt(at, outline(at), at_most)
    assert len(rows) <= at_most + 1
    assert sum(row.folded or 1 for row in rows) == len(at.tasks)
    assert [row.number for row in rows] == list(range(len(rows)))
    for row in rows:
        assert row.is_rest or (
            row.parent < row.number
            and row.depth == (rows[row.parent].depth + 1 if row.parent >= 0 else 0)
        )
        assert row.is_rest or row.folded == sum(row.states.values())


def test_headings_align_with_columns_late_in_a_long_run(tca: Tca, tmp_path: Path) -> None:
    story = Story().module("planner", "walk").at(12_000.0)
    walk = story.goal("walk", "user", to="planner", begins=True)
    story.at(13_000.0).returned(walk).reached(walk, Moment.END_PLANNING).at(13_500.0).reached(
        walk, Moment.END_ACHIEVING
    )
    _, headings, line = tca(
        "tree", story.write(tmp_path / "run"), COLUMNS="100"
    ).stdout.splitlines()
    assert line.split() == ["walk", "{1}", "achieved", "12000.00-13000.00", "12000.00-13500.00"]
    assert headings.index("planning") == line.index("12000.00-13000")
    assert headings.index("achieving") == line.index("12000.00-13500")


@pytest.mark.parametrize(
    ("columns", "headings"), [(80, []), (90, ["achieving"]), (100, ["planning", "achieving"])]
)
def test_narrow_tree_drops_times_before_reasons(
    tca: Tca, tmp_path: Path, columns: int, headings: list[str]
) -> None:
    lines = tca(
        "tree", stumbling().write(tmp_path / "fall"), COLUMNS=str(columns)
    ).stdout.splitlines()
    assert lines[1].split() == ["task", "state", *headings]
    assert "failure 'terrain collision' of move" in lines[2]


# --- linear work: executed lines of the tca packages ----------------------------------------------


SIZES = 1, 20, 40, 80
TRACED = [
    *((shape, tool) for shape in SHAPES for tool in ("replay --text", "view", "export csv")),
    *(
        ("retries", tool)
        for tool in ("report", "gantt svg", "check", "stats", "export mcap", "export perfetto")
    ),
]


def lines_of(tool: Callable[[], object]) -> int:
    """Return the number of executed lines of the tca packages."""
    count = 0

    def line(_frame: FrameType, event: str, _: Any) -> Any:
        nonlocal count
        count += event == "line"
        return line

    def call(frame: FrameType, _event: str, _: Any) -> Any:
        return line if "/tca_" in frame.f_code.co_filename else None

    sys.settrace(call)
    try:
        tool()
    finally:
        sys.settrace(None)
    return count


@pytest.fixture(scope="module")
def journals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    folder = tmp_path_factory.mktemp("journals")
    made: dict[str, list[Path]] = {
        shape: [folder / f"{shape}{size}.tcaj" for size in SIZES] for shape in SHAPES
    }
    for shape, paths in made.items():
        for size, path in zip(SIZES, paths, strict=True):
            make(shape, size, path)
    return made


@pytest.mark.parametrize(("shape", "tool"), every(5, TRACED))
def test_tool_work_is_linear_in_the_journal(
    journals: dict[str, list[Path]], shape: str, tool: str
) -> None:
    warm, *paths = journals[shape]
    TOOLS[tool](warm)  # fills caches, imports modules
    few, twice, most = (lines_of(partial(TOOLS[tool], path)) for path in paths)
    linear = max(twice - few, few // 4)
    assert most - twice <= 2.6 * linear  # 2 if linear, 4 if quadratic


def causes_of(run: Run, task: Task) -> None:
    assert list(Causes(run).back_from(task.time_of(Moment.END_ACHIEVING), task.id))


@pytest.mark.parametrize("answer", [life_at, causes_of])
def test_work_for_one_task_is_linear_in_its_retries(
    journals: dict[str, list[Path]], answer: Callable[[Run, Task], object]
) -> None:
    counts = []
    for path in journals["retries"][1:]:
        run = folded(open_log(path))
        retried = max(run.tasks.values(), key=lambda task: len(task.retries))
        answer(run, retried)  # fills caches
        counts.append(lines_of(partial(answer, run, retried)))
    few, twice, most = counts
    assert most - twice <= 2.6 * (twice - few)
