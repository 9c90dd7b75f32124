"""Failures that are raised beside the handler: charts mark the moment, and the story tells who did it."""

from pathlib import Path

from tools.story import Story

from tca_tools.analysis.failures import failures
from tca_tools.gantt.build import chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import chart_lines
from tca_tools.run.fold import History
from tca_tools.run.journals import open_log
from tca_tools.why.story import story
from tca_wire.journal import facts

COMMAND = "tca raise#7"


def late() -> Story:
    """A move is too slow at 3 s, and somebody makes the same of one that waits, at 4 s; the handler goes on until 9 s."""
    told = Story().module("legs", "move").at(1.0)
    move = told.command("move", "user")
    told.delivered(move, "legs").at(3.0).say(facts.Failed(move, "timeout", "late", is_beside=True, by="central"))
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


def test_an_older_journal_does_not_tell() -> None:
    told = Story().module("legs", "move").at(1.0)
    move = told.delivered(told.command("move", "user"), "legs").at(2.0).say(facts.Failed(1, "slip", "", is_beside=True))
    assert "failed: slip" in [one.text for one in story(move.fold(), 1)]


def test_a_report_tells_who_raised_it() -> None:
    found = {kind.failure: case.raised_by for kind in failures(late().fold()) for case in kind.cases}
    assert found == {"timeout": "raised by central", "slip": "raised by the command 'tca raise'"}
