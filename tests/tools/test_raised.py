"""Failures that are raised beside the handler, and tasks that go on though they have failed."""

from pathlib import Path

from tools.story import Story

from tca_tools.analysis.failures import failures
from tca_tools.export.tables import TABLES
from tca_tools.gantt.build import chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.run.at_time import RunAt
from tca_tools.run.fold import History
from tca_tools.run.journals import open_log
from tca_tools.run.records import State
from tca_tools.why.story import story
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome

COMMAND = "tca raise#7"


def late() -> Story:
    """A move is too slow at 3 s, and somebody makes the same of one that waits, at 4 s; the handler goes on until 9 s."""
    told = Story().module("legs", "move").at(1.0)
    move = told.command("move", "user", to="legs")
    told.at(3.0).say(facts.Failed(move, "timeout", "late", is_beside=True, by="central"))
    told.queued(told.command("move", "user"), "legs").at(4.0)
    slip = facts.Failed(2, "slip", "on ice", is_beside=True, by=COMMAND, body=b"\x07")
    return told.say(slip).at(9.0).returned(move)


def test_charts_mark_the_moment() -> None:
    made = chart(late().fold())
    (row,) = made.rows
    assert [mark.time for bar in row.handled for mark in bar.raised] == [3.0]
    (mark,) = row.queued[0].raised
    assert mark.title == "move {2} failed at 4.000 s: slip: on ice (raised by the command 'tca raise')"
    picture = svg_text(made, "late")
    assert mark.title.replace("'", "&#x27;") in picture
    assert "failure raised beside the handler" in picture
    lines = list(chart_lines(made, 100))
    axis, handled, queued, *_ = (line for line in lines if "!" in line or "~" in line)
    assert axis.startswith("legs")
    assert lines[-1].endswith("handled") or "raised beside the handler" in lines[-1]
    assert handled != queued


def test_the_story_tells_who_raised_it_and_with_which_data(tmp_path: Path) -> None:
    history = History()
    for entry in open_log(late().write(tmp_path / "late")):
        history.apply(entry)
    assert [one.text for one in story(history, 2) if one.time == 4.0] == [
        "failed: slip: on ice (raised by the command 'tca raise')",
        "the failure's data: 7",
    ]
    assert "failed: timeout: late" in [one.text for one in story(history, 1)]  # central's own: its text tells


def test_a_report_tells_who_raised_it() -> None:
    found = {kind.failure: case.raised_by for kind in failures(late().fold()) for case in kind.cases}
    assert found == {"timeout": "by central", "slip": "by the command 'tca raise'"}


STOP = 2


def surviving() -> Story:
    """A walk {1} is killed; what is to stop the legs {2} waits for them, is late at 3 s, and is handled all the same."""
    told = Story().module("legs", "walk", "stop").at(1.0)
    walk = told.goal("walk", "user", to="legs")
    told.at(2.0).say(facts.Killed(TaskId(walk), "enough", "user"))
    assert told.received("stop", MessageClass.COMMAND, "central", walk) == STOP
    told.queued(STOP, "legs").at(3.0)
    told.say(facts.Failed(STOP, "timeout", "late", is_beside=True, by="central"), facts.Unhandled(TaskId(STOP)))
    told.at(4.0).returned(walk, Outcome.KILLED).delivered(STOP, "legs").at(5.0)
    return told.returned(STOP).reached(STOP, *Moment).reached(walk, *Moment)


def test_a_task_that_is_handled_after_a_failure_that_nobody_handled_has_failed() -> None:
    run = surviving().fold()
    assert [state for _, state in run.tasks[STOP].states] == [State.QUEUED, State.HANDLING, State.FAILED]
    assert [RunAt(run, moment).tasks[STOP].failure for moment in (2.5, 3.5, 4.5)] == ["", *["timeout: late"] * 2]
    assert [(one.time, one.text) for one in story(run, STOP)][1:] == [
        (2.0, "queued for legs, busy with walk {1}"),
        (3.0, "failed: timeout: late"),
        (4.0, "handled by legs"),
        (5.0, "has ended"),
    ]


def test_tables_keep_it() -> None:
    run = surviving().fold()
    tables = {table.name: [dict(zip(table.columns, row, strict=True)) for row in table.rows(run)] for table in TABLES}
    assert [(row["failure"], row["handled"]) for row in tables["messages"]] == [(None, None), ("timeout: late", False)]
    assert [row["state"] for row in tables["tasks"]] == ["killed", "failed"]


def test_who_is_retried_begins_anew_with_no_failure() -> None:
    told = Story().module("legs", "move").at(1.0)
    move = told.command("move", "user", to="legs")
    told.at(2.0).say(facts.Retried(TaskId(move), b"", "user"))
    told.at(3.0).failed(move, "slip", "")  # nobody asks for that any more
    assert told.at(4.0).delivered(move, "legs").fold().tasks[move].state is State.HANDLING
    assert told.at(5.0).returned(move).reached(move, *Moment).fold().tasks[move].state is State.ACHIEVED
