"""What the tools do for a run grows as its journal does: lines of ours that are executed are counted, not seconds."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from dev.benchmarks.long_runs import SHAPES, TOOLS, make
from tca_tools.analysis.backwards import Causes
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.journal.lives import life_at
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import Moment

SIZES = 1, 30, 60, 120
TRACED = [
    *((shape, tool) for shape in SHAPES for tool in ("replay --text", "view", "export csv")),
    *(("retries", tool) for tool in ("report", "gantt svg", "check", "stats", "export mcap", "export perfetto")),
]


def lines_of(tool: Callable[[], object]) -> int:
    """How many lines of our packages it executes."""
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
    made: dict[str, list[Path]] = {shape: [folder / f"{shape}{size}.tcaj" for size in SIZES] for shape in SHAPES}
    for shape, paths in made.items():
        for size, path in zip(SIZES, paths, strict=True):
            make(shape, size, path)
    return made


@pytest.mark.parametrize(("shape", "tool"), TRACED)
def test_work_grows_as_the_journal(journals: dict[str, list[Path]], shape: str, tool: str) -> None:
    warm, *paths = journals[shape]
    TOOLS[tool](warm)  # imports, and what is kept
    few, twice, most = (lines_of(partial(TOOLS[tool], path)) for path in paths)
    linear = max(twice - few, few // 4)
    assert most - twice <= 2.6 * linear  # it is 2 if all is linear, 4 if all is quadratic


def causes_of(run: Run, task: Task) -> None:
    assert list(Causes(run).back_from(task.time_of(Moment.END_ACHIEVING), task.id))


@pytest.mark.parametrize("answer", [life_at, causes_of])
def test_work_for_one_task_grows_as_its_retries(
    journals: dict[str, list[Path]], answer: Callable[[Run, Task], object]
) -> None:
    counts = []
    for path in journals["retries"][1:]:
        run = folded(open_log(path))
        retried = max(run.tasks.values(), key=lambda task: len(task.retries))
        answer(run, retried)  # what is kept
        counts.append(lines_of(partial(answer, run, retried)))
    few, twice, most = counts
    assert most - twice <= 2.6 * (twice - few)
