"""Outcome, failures, waits and resources of a run, each worked out by hand."""

from collections.abc import Callable
from pathlib import Path

from click.testing import Result
from tools.story import Story, walking

from tca_tools.analysis.critical_path import last_task, longest_task
from tca_tools.analysis.summary import span_of, summary
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, levels
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass


def test_a_run_that_is_not_over_and_one_of_nothing() -> None:
    run = summary(walking().fold())
    assert (run.outcome, run.is_good, run.end) == (
        "The top-level task was not over when the journal ended.",
        False,
        4.0,
    )
    assert summary(Story().fold()).outcome == "No task was sent."
    assert summary(Run()).seconds == 0.0


def test_spans() -> None:
    spans = [(0.0, 4.0), (1.0, 2.0), (3.0, 6.0), (8.0, 8.0)]
    assert list(levels(spans)) == [(0.0, 1), (1.0, 2), (2.0, 1), (3.0, 2), (4.0, 1), (6.0, 0)]
    one, two = Cover(spans), Cover(spans, 2)
    assert (one.total, two.total) == (6.0, 2.0)
    assert [one.within(*window) for window in ((0, 6), (-5, 1), (5, 9), (3, 3), (7, 8))] == [6, 1, 1, 0, 0]
    assert (two.within(1.5, 3.5), two.within(9, 1), Cover([]).within(0, 1)) == (1.0, 0.0, 0.0)


# --- monitors that stand by are not what a run waits for -------------------------------------------------------------


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


def test_in_the_middle_of_a_walk() -> None:
    run = watched_walk(5.0).fold()
    assert summary(run).outcome == "The top-level task was not over when the journal ended; 1 monitor still watched."
    assert (str(last_task(run)), str(longest_task(run)), span_of(run)) == ("walk {2}", "walk {2}", (2.0, 5.0))
    run.is_live = True
    assert summary(run).outcome == "The top-level task is still running, as of 5.000 s; 1 monitor still watching."


def ended(story: Story, by: str) -> Story:
    story.at(21.0).say(facts.Killed(TaskId(1), "over", by))
    return story.reached(1, Moment.END_HANDLING, Moment.END_ACHIEVING)


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
