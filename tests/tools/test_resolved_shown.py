"""A run of five programs that fails: a failure that was only observed, and two that were resolved, in every tool."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from central.player import Player
from tools.deliveries import written
from tools.runs import OPENED, checked

from tca_tools.check import rules
from tca_tools.gantt.build import chart
from tca_tools.gantt.chart import Ending
from tca_tools.journal.fold import History
from tca_tools.journal.lives import life_of
from tca_tools.journal.outcomes import outcome_of
from tca_tools.journal.records import TaskState
from tca_tools.tasktree_viz.dot import FILLS
from tca_tools.tasktree_viz.text import COLOURS
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.vocabulary import Condition, Outcome

RESOLVED, FAILED, KILLED, ACHIEVED = TaskState.RESOLVED, TaskState.FAILED, TaskState.KILLED, TaskState.ACHIEVED


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    """A walk whose step was mended, a step of the user's that was, and a walk whose step somebody only looked at."""
    robot = Player.of(
        "planner: goal walk", "legs: command step, command swing", "expert: exception handler mend",
        "watcher: exception handler look", "safety: command check", "user",
    )  # fmt: skip
    robot.receive("user", headers.Attach(robot.number("user"), Attachment("", "look")))
    robot.receive("safety/1", headers.Tap(robot.number("safety/1"), Condition.BEFORE_HANDLING, "check", "step"))
    mend = [Attachment("slip", "mend")]
    for is_in_walk, is_mended in ((True, True), (False, True), (True, False)):
        under = robot.task("user", "walk") if is_in_walk else 0
        robot.task("planner/1" if is_in_walk else "user", "step", under=under, attachments=mend if is_mended else [])
        if is_in_walk:
            robot.task("planner/1", "swing", under=under)
            robot.reply("planner/1")
        robot.reply("safety/1")
        robot.fail("legs/1", "slip")
        if is_mended:
            robot.resolve("expert/1")
        robot.reply("expert/1" if is_mended else "watcher/1")
        if is_in_walk and is_mended:
            robot.reply("legs/1")
    return [OPENED, *robot.entries]


@pytest.fixture(scope="module")
def run(entries: list[Entry]) -> History:
    return History.until(entries, None)


@pytest.fixture
def path(entries: list[Entry], tmp_path: Path) -> Path:
    return written(entries, tmp_path / "run")


def states(run: History, name: str) -> list[TaskState]:
    return [task.state for task in run.tasks.values() if task.name == name]


def test_states_are_green_only_where_all_went_well(run: History) -> None:
    assert states(run, "step") == [RESOLVED, RESOLVED, FAILED]
    assert states(run, "walk") == [ACHIEVED, KILLED]
    assert states(run, "swing") == [ACHIEVED, KILLED]
    assert [bar.ending for bar in chart(run).bars() if bar.name == "step" and bar.ending] == [
        Ending.RESOLVED,
        Ending.RESOLVED,
        Ending.FAILED,
    ]
    ends = [[*life_of(run, task)][-1] for task in run.tasks.values() if task.name == "step"]
    assert [one.transition for one in ends] == [Outcome.RESOLVED, Outcome.RESOLVED, "failed"]
    for looks in (COLOURS, FILLS):
        assert len({looks[state] for state in (ACHIEVED, RESOLVED, FAILED)}) == 3


def test_outcome_counts_a_resolved_top_level_task_apart(entries: list[Entry]) -> None:
    assert outcome_of(entries).top == {ACHIEVED: 1, RESOLVED: 1, KILLED: 1}


def test_every_tool_says_done_after_a_failure(path: Path, tca: Any) -> None:
    for command in ("tree", "gantt", "stats"):
        assert Outcome.RESOLVED in tca(command, path).stdout, command
    tree = [line for line in tca("tree", path).stdout.splitlines() if "step {" in line]
    assert [str(state) in line for state, line in zip((RESOLVED, RESOLVED, FAILED), tree, strict=True)] == [True] * 3
    page = path.parent / "report.html"
    assert not tca("report", path, "-o", page).exit_code
    assert "s-resolved" in page.read_text()
    assert "returned without dealing with the failure" in page.read_text()
    kinds = [line.split()[1] for line in tca("log", "show", path).stdout.splitlines()]
    assert (kinds.count("resolved"), kinds.count("recovered"), kinds.count("not")) == (2, 2, 1)


def changed(entries: list[Entry], kind: type, becomes: Any) -> Iterator[Entry]:
    """The journal with the facts of one kind as others, or without them."""
    for entry in entries:
        kept = [becomes(fact) if isinstance(fact, kind) else fact for fact in entry.facts]
        yield msgspec.structs.replace(entry, facts=[fact for fact in kept if fact is not None])


def test_check_finds_what_was_only_observed_and_recovered(entries: list[Entry]) -> None:
    assert checked(entries) == []
    unsaid = checked(changed(entries, facts.Resolved, lambda _: None))
    assert {one.rule for one in unsaid} == {rules.RESOLVED.text}
    green = checked(changed(entries, facts.NotResolved, lambda fact: facts.Recovered(fact.task, fact.handler)))
    assert rules.RESOLVED.text in {one.rule for one in green}
