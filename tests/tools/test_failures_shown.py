"""Failures in all tools: handled or not, their origin, and their data."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from central.player import Player
from click.testing import Result
from tools.deliveries import written
from tools.runs import OPENED, checked
from tools.story import Story, made, stumbling

from tca_tools.analysis.summary import summary
from tca_tools.check import rules
from tca_tools.export.trace.tracks import of_handling, of_task
from tca_tools.gantt.build import chart
from tca_tools.gantt.chart import Ending
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import HANDLED
from tca_tools.journal.fold import History
from tca_tools.journal.journals import open_log
from tca_tools.journal.outcomes import outcome_of
from tca_tools.journal.records import TaskState
from tca_tools.replay.growth import growth_lines
from tca_tools.replay.panes import colour_of
from tca_tools.replay.recording import Recording
from tca_tools.report.tree import tree
from tca_tools.tasktree_viz.dot import FILLS, dot_source
from tca_tools.tasktree_viz.outline import whole_outline
from tca_tools.tasktree_viz.outline_svg import outline_svg
from tca_tools.tasktree_viz.text import COLOURS, story_lines, tree_lines
from tca_tools.tasktree_viz.words import summary as title
from tca_tools.view.answers import message_answer
from tca_tools.view.reading import Reading
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import TaskId
from tca_wire.vocabulary import Condition, MessageClass, Outcome

Tca = Callable[..., Result]
STEP = TaskId(2)
YELLOW, RED = "\x1b[33m", "\x1b[31m"


@pytest.mark.parametrize("top_fails", [False, True])
def test_failure_is_amber_if_handled_and_red_if_not(*, top_fails: bool) -> None:
    story = made("not_replaced" if top_fails else "replaced")
    run, word, colour = (
        story.fold(),
        "failed" if top_fails else HANDLED,
        RED if top_fails else YELLOW,
    )
    at, rows = RunAt(run), whole_outline(RunAt(run))
    assert at.tasks[STEP].standing == word
    assert title(at).endswith(f"{1 + top_fails} {word}")
    assert summary(run).tasks[word] == 1 + top_fails
    assert [line for line in tree_lines(at, rows) if f"step {{2}}  {colour}{word}" in line]
    assert next(story_lines(run, STEP)) == f"step {{2}}: {colour}{word}\x1b[0m"
    grown = growth_lines(Recording(story.entries), 0.0, None)  # its fate was unknown when it failed
    assert [line for line in grown if f"{RED}failed\x1b[0m, blind" in line]
    assert colour_of(word) == ("red" if top_fails else "yellow")
    for picture in (dot_source(at, rows, ""), outline_svg(at, rows, "")):
        assert FILLS[word] in picture
        assert word in picture
        assert FILLS["failed" if word == HANDLED else HANDLED] not in picture
    assert [row.task.standing for some in tree(run).below.values() for row in some if row.task] == [
        word if top_fails else "achieved",
        word,
    ]


def test_report_counts_handled_failures_as_handled(tca: Tca, tmp_path: Path) -> None:
    out = tmp_path / "run.html"
    assert not tca("report", made("replaced").write(tmp_path / "walk"), "-o", out).exit_code
    assert '<span class="r-tag s-handled">1 failed (handled)</span>' in out.read_text()


def test_recovering_task_names_its_exception_handler_and_wait(tca: Tca, tmp_path: Path) -> None:
    folder = made("in_recovery").write(tmp_path / "walk")
    line = tca("tree", folder).stdout.splitlines()[2]
    assert line.endswith(
        "slip: on ice; waits until recover {3} has dealt with its failure, for 1.5 s"
    )
    assert (
        tca("tree", folder, "--at", 2.5)
        .stdout.splitlines()[2]
        .endswith("slip: on ice; waits until recover {2} has dealt with its failure, for 500 ms")
    )
    at = RunAt(made("in_recovery").fold())
    assert "recovering, slip: on ice; waits until recover {3}" in outline_svg(
        at, whole_outline(at), ""
    )


def test_task_recovers_though_another_failure_is_unhandled() -> None:
    built = Story().module("legs", "move").module("expert", "recover")
    move = built.command("move", "user", to="legs")
    built.failed(move, "slip").rescued(move, "recover", "expert")
    built.say(facts.Failed(move, "slip", "", is_beside=True, by="user"))
    built.say(facts.Unhandled(TaskId(move))).at(1.0)
    assert built.fold().tasks[TaskId(move)].state is TaskState.RECOVERING


def test_monitor_continues_after_its_failure_retries_a_task() -> None:
    built = Story().module("legs", "walk").module("user")
    walk = built.goal("walk", "user", to="legs", begins=True)
    monitor = built.received("watch", MessageClass.POLLING_MONITOR, "user", walk)
    built.say(facts.OutlivesRetry(TaskId(monitor)))
    built.say(facts.Failed(monitor, "slip", "", is_beside=True, by="user"))
    built.say(facts.Retried(TaskId(walk), b"", "central", TaskId(monitor))).at(1.0)
    assert built.fold().tasks[TaskId(monitor)].state is TaskState.HELD


@pytest.mark.parametrize("width", [10, 40, 49, 79])
def test_tree_fits_a_narrow_terminal_and_keeps_names(tca: Tca, tmp_path: Path, width: int) -> None:
    folder, columns = made("replaced").write(tmp_path / "walk"), {"COLUMNS": str(width)}
    lines = tca("tree", folder, **columns).stdout.splitlines()
    assert max(map(len, lines)) <= width
    assert lines[2].startswith("wal")
    if width >= 40:
        assert lines[3].startswith(f"└─ step {{2}}  {HANDLED}")
        assert ("achieving" in lines[1]) == (width >= 60)
    story = tca("tree", folder, "--story", 2, **columns).stdout.splitlines()
    assert max(map(len, story)) <= max(width, 20)


def test_deep_tree_keeps_names_on_a_narrow_terminal(tca: Tca, tmp_path: Path) -> None:
    story, parent = Story().at(1.0), 0
    for _ in range(12):
        parent = story.goal("step", "user", parent)
    lines = tca("tree", story.write(tmp_path / "deep"), COLUMNS="40").stdout.splitlines()
    assert max(map(len, lines)) <= 40
    assert all("step {" in line for line in lines[2:])


# --- failures raised from outside the handler -----------------------------------------------------------


def test_chart_marks_failures_raised_beside_the_handler() -> None:
    drawn = chart(made("failed_beside").fold())
    (row,) = drawn.rows
    assert [mark.time for bar in row.handled for mark in bar.marks] == [3.0]
    (mark,) = row.queued[0].marks
    assert (
        mark.title == "move {2} failed at 4.000 s: slip: on ice (raised by the command 'tca raise')"
    )
    picture = svg_text(drawn, "late")
    assert mark.title.replace("'", "&#x27;") in picture
    assert "failure raised from outside the handler" in picture
    lines = list(chart_lines(drawn, 100))
    axis, handled, queued, *_ = (line for line in lines if "!" in line or "~" in line)
    assert axis.startswith("legs")
    assert lines[-1].endswith("handled") or "raised from outside the handler" in lines[-1]
    assert handled != queued


def test_failure_data_is_not_shown_as_a_result(run: Path) -> None:
    history, force = stumbling().fold(), {"force": 812.0}
    task = history.tasks[TaskId(7)]
    for details in (of_task(history, task), of_handling(history, task.handlings[0])):
        assert (details["result"], details["failure data"]) == (None, force)
    reading = Reading(open_log(run))
    for entry in open_log(run):
        reading.feed.apply(entry)
    answer = message_answer(reading, 7, history.time)
    assert answer is not None
    assert (answer["result"], answer["failureData"]) == ("", json.dumps(force))


# --- a run with two resolved failures and one that was only observed ------------------------------


RESOLVED, FAILED, KILLED, ACHIEVED = (
    TaskState.RESOLVED,
    TaskState.FAILED,
    TaskState.KILLED,
    TaskState.ACHIEVED,
)


@pytest.fixture(scope="module")
def resolved_entries() -> list[Entry]:
    """Return a walk with a mended step, a mended step of the user, and a walk with an observed
    failure.
    """
    robot = Player.of(
        "planner: goal walk",
        "legs: command step, command swing",
        "expert: exception handler mend",
        "watcher: exception handler look",
        "safety: command check",
        "user",
    )
    robot.request("user", headers.Attach, Attachment("", "look"))
    robot.request("safety/1", headers.Tap, Condition.BEFORE_HANDLING, "check", "step")
    mend = [Attachment("slip", "mend")]
    for is_in_walk, is_mended in ((True, True), (False, True), (True, False)):
        under = robot.task("user", "walk") if is_in_walk else 0
        robot.task(
            "planner/1" if is_in_walk else "user",
            "step",
            under=under,
            attachments=mend if is_mended else [],
        )
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
def resolved_run(resolved_entries: list[Entry]) -> History:
    return History.until(resolved_entries, None)


@pytest.fixture
def path(resolved_entries: list[Entry], tmp_path: Path) -> Path:
    return written(resolved_entries, tmp_path / "run")


def states(resolved_run: History, name: str) -> list[TaskState]:
    return [task.state for task in resolved_run.tasks.values() if task.name == name]


def test_resolved_task_differs_from_achieved_and_failed(resolved_run: History) -> None:
    assert states(resolved_run, "step") == [RESOLVED, RESOLVED, FAILED]
    assert states(resolved_run, "walk") == [ACHIEVED, FAILED]
    assert states(resolved_run, "swing") == [ACHIEVED, KILLED]
    assert [
        bar.ending for bar in chart(resolved_run).bars() if bar.name == "step" and bar.ending
    ] == [
        Ending.RESOLVED,
        Ending.RESOLVED,
        Ending.FAILED,
    ]
    for looks in (COLOURS, FILLS):
        assert len({looks[state] for state in (ACHIEVED, RESOLVED, FAILED)}) == 3


def test_outcome_counts_resolved_top_level_tasks_separately(resolved_entries: list[Entry]) -> None:
    assert outcome_of(resolved_entries).top == {ACHIEVED: 1, RESOLVED: 1, FAILED: 1}


def test_every_tool_shows_done_after_a_failure(path: Path, tca: Any) -> None:
    for command in ("tree", "gantt", "stats"):
        assert Outcome.RESOLVED in tca(command, path).stdout, command
    tree = [line for line in tca("tree", path).stdout.splitlines() if re.match(r"\W*step ", line)]
    assert [
        str(state) in line for state, line in zip((RESOLVED, RESOLVED, FAILED), tree, strict=True)
    ] == [True] * 3
    page = path.parent / "report.html"
    assert not tca("report", path, "-o", page).exit_code
    assert "s-resolved" in page.read_text()
    assert "returned without dealing with the failure" in page.read_text()
    kinds = [line.split()[1] for line in tca("log", "show", path).stdout.splitlines()]
    assert (kinds.count("resolved"), kinds.count("recovered"), kinds.count("not")) == (2, 2, 1)


def changed(resolved_entries: list[Entry], kind: type, becomes: Any) -> Iterator[Entry]:
    """Yield the journal with the facts of one kind replaced or removed."""
    for entry in resolved_entries:
        kept = [becomes(fact) if isinstance(fact, kind) else fact for fact in entry.facts]
        yield msgspec.structs.replace(entry, facts=[fact for fact in kept if fact is not None])


def test_check_finds_missing_resolved_and_false_recovered_facts(
    resolved_entries: list[Entry],
) -> None:
    assert checked(resolved_entries) == []
    unsaid = checked(changed(resolved_entries, facts.Resolved, lambda _: None))
    assert {one.rule for one in unsaid} == {rules.RESOLVED.text}
    green = checked(
        changed(
            resolved_entries,
            facts.NotResolved,
            lambda fact: facts.Recovered(fact.task, fact.handler),
        )
    )
    assert rules.RESOLVED.text in {one.rule for one in green}
