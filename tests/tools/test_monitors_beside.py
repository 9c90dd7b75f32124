"""A monitor that watches until somebody ends it is not what a run waits for: the report is of the work beside it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.story import Story

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task
from tca_tools.analysis.summary import span_of, summary
from tca_tools.report.contents import contents
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Role


def watched_walk(until: float) -> Story:
    """A monitor is sent at 1.0, a walk of 6 s at 2.0; at 8.5 all modules have gone, and the battery is asked about."""
    story = Story().module("user").module("brain", "walk").module("legs", "battery low")
    watch = story.at(1.0).received("battery watch", MessageClass.POLLING_MONITOR, "user")
    story.reached(watch, Moment.START_HANDLING, Moment.START_ACHIEVING)
    walk = story.at(2.0).goal("walk", "user", to="brain", begins=True)
    if until >= 8.0:
        story.at(8.0).returned(walk).reached(walk, Moment.END_PLANNING, Moment.END_ACHIEVING)
    if until >= 8.5:
        story.at(8.5).say(facts.HandlerRemoved("battery low", "legs"))
        story.queued(story.received("battery low", MessageClass.QUERY, "central"))
    return story.at(until)


def test_a_monitor_that_stands_by_does_not_hide_the_run() -> None:
    run = watched_walk(20.0).fold()
    handling = summary(run)
    assert handling.outcome == "The top-level task was achieved; 1 monitor still watched."
    assert (handling.is_good, handling.start, handling.end) == (True, 2.0, 8.0)
    found = contents(run)
    assert found.path is not None
    assert (str(found.path.path.task), found.path.shares[0].name, found.path.shares[0].share) == (
        "walk {2}",
        "walk",
        1.0,
    )
    assert found.advice == []  # nor that nobody handles what is asked when all have gone home
    assert found.waits  # but it is told there


def test_in_the_middle_of_a_walk() -> None:
    run = watched_walk(5.0).fold()
    assert summary(run).outcome == "The top-level task was not over when the journal ended; 1 monitor still watched."
    assert (str(last_task(run)), str(longest_task(run)), span_of(run)) == ("walk {2}", "walk {2}", (2.0, 5.0))
    run.is_live = True
    assert summary(run).outcome == "The top-level task is still running, as of 5.000 s; 1 monitor still watching."


def ended(story: Story, by: str) -> Story:
    story.at(21.0).say(facts.Killed(TaskId(1), "over", by))
    return story.reached(1, Moment.END_HANDLING, Moment.END_ACHIEVING)


@pytest.mark.parametrize(
    ("by", "outcome"),
    [
        ("user", "The top-level task was achieved."),
        ("central", "1 of 2 top-level tasks was not achieved: battery watch {1} was killed: over."),
    ],
)
def test_a_module_may_end_its_monitor_but_central_does_so_for_a_reason(by: str, outcome: str) -> None:
    run = summary(ended(watched_walk(20.0), by).fold())
    assert (run.outcome, run.is_good) == (outcome, by == "user")


def test_what_a_monitor_has_sent_is_work_like_any_other() -> None:
    """The battery is loaded from 9.0 to 12.0, after the walk."""
    story = watched_walk(9.0)
    load = story.received("load", MessageClass.COMMAND, "central", 1, origin=0, role=Role.ACTION, about=1)
    run = story.acted(load, "legs", 3.0).at(30.0).fold()
    assert span_of(run) == (2.0, 12.0)
    last = last_task(run)
    assert last is not None
    assert (last.name, summary(run).outcome) == ("load", "The top-level task was achieved; 1 monitor still watched.")
    assert critical_path(run, Causes(run), last).steps[-1].module == "legs"


def test_where_there_is_nothing_but_monitors_they_are_the_run() -> None:
    story = Story().module("user")
    watch = story.at(1.0).received("battery watch", MessageClass.POLLING_MONITOR, "user")
    run = story.reached(watch, Moment.START_HANDLING, Moment.START_ACHIEVING).at(5.0).fold()
    assert summary(run).outcome == "No top-level task but monitors was sent; 1 monitor still watched."
    assert (str(last_task(run)), span_of(run)) == ("battery watch {1}", (1.0, 5.0))


def test_a_monitor_that_watches_is_called_what_it_is(tca: Callable[..., Result], tmp_path: Path) -> None:
    story = watched_walk(7.0)
    story.at(7.5).say(facts.MonitorEnded(TaskId(1), "it has been fired as often as it may"))
    journal = story.at(8.0).write(tmp_path / "walk")
    before, after = (tca("tree", journal, "--at", at).stdout.splitlines() for at in (7.0, 8.0))
    assert "1 watching" in before[0]
    assert before[2].split()[:4] == ["battery", "watch", "{1}", "(monitor)"]
    assert before[2].split()[4] == "watching"
    assert "watching" not in "".join(after)
    told = tca("tree", journal, "--story", "1", "--at", "7").stdout
    assert "watching" in told
    assert "achieving" not in told
