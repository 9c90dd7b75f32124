"""The critical path goes on through waits that came to nothing, or took no time; and a refused deadlock is told."""

import pytest
from tools.story import QUERY, Story
from tools.test_critical_path import path_of

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path
from tca_tools.analysis.failures import failures
from tca_tools.analysis.step_words import why_then
from tca_tools.log.classic import classic_lines
from tca_tools.report.contents import contents
from tca_tools.run.fates import Fate
from tca_tools.run.whole_run import Run
from tca_tools.stats.measure import measure
from tca_tools.why.story import story as story_of
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Refusal

CIRCLE = "each waits for the next, in a circle: a waits for b; b waits for a"
SLOW = [("go", "m", 0.0, 0.5), ("slow", "k", 0.5, 3.5)]


def going() -> tuple[Story, int]:
    """*go* waits three seconds for *slow*, and goes on at 3.5."""
    told = Story().module("m", "go", "back").module("n", "ask").module("k", "slow", "short")
    go = told.goal("go", "user", to="m", begins=True)
    slow = told.at(0.5).command("slow", "m", go, to="k")
    told.say(facts.WaitBegan("m", go, TaskId(slow), Moment.END_ACHIEVING)).at(3.5)
    told.achieved(slow).say(facts.WaitEnded("m", go, TaskId(slow)))
    return told, go


def short_at(told: Story, time: float, go: int) -> Run:
    """Then it commands *short*, half a second."""
    short = told.at(time).command("short", "m", go, to="k")
    told.returned(go).at(time + 0.5)
    return told.achieved(short).reached(go, Moment.END_ACHIEVING).fold()


def whys(run: Run) -> list[str]:
    return [why_then(run, step) for step in critical_path(run, Causes(run), run.tasks[1]).steps]


def test_through_a_lock_that_was_wanted_in_vain() -> None:
    told, go = going()
    told.at(4.0).say(facts.Claimed(50, "n", "n", False, "m", go)).at(4.3).say(facts.ClaimEnded(50, "its time is over"))
    run = short_at(told, 4.4, go)
    last = [("go", "m", 3.5, 4.0), ("locked", "n", 4.0, 4.3), ("go", "m", 4.3, 4.4), ("short", "k", 4.4, 4.9)]
    assert path_of(run) == SLOW + last
    assert "its handler waited for the lock of n {50}, in vain" in whys(run)


def test_through_a_task_that_was_waited_for_in_vain() -> None:
    told, go = going()
    never = told.at(4.0).command("never", "m", go)
    told.queued(never).say(facts.WaitBegan("m", go, TaskId(never), Moment.END_ACHIEVING)).at(4.3)
    told.say(facts.WaitEnded("m", go, TaskId(never)))
    run = short_at(told, 4.4, go)
    assert [row[:2] for row in path_of(run)][2:5] == [("go", "m"), ("no handler", ""), ("go", "m")]
    assert f"its handler waited until never {{{never}}} is achieved, in vain" in whys(run)


def refused() -> Run:
    """*ask* would wait for its asker, copes, and answers after a tenth of a second."""
    told, go = going()
    return short_at(_asked(told, go), 4.2, go)


def _asked(told: Story, go: int) -> Story:
    ask = told.at(4.0).received("ask", QUERY, "m", origin=go, blocking=True, to="n")
    back = told.at(4.05).received("back", QUERY, "n", origin=ask, blocking=True)
    told.queued(back, "m").say(facts.RequestRefused("n", Refusal.DEADLOCK, CIRCLE), facts.Unqueued(back))
    told.say(facts.Dropped(back, "any", "deadlock")).at(4.1)
    return told.returned(ask, data=-1).say(facts.Answered(ask))


def test_through_a_deadlock_that_was_refused_at_once() -> None:
    go_on = [("go", "m", 3.5, 4.0), ("ask", "n", 4.0, 4.1), ("go", "m", 4.1, 4.2), ("short", "k", 4.2, 4.7)]
    assert path_of(refused()) == SLOW + go_on


def test_a_deadlock_that_was_coped_with_is_told_with_its_circle() -> None:
    run = refused()
    (kind,) = failures(run)
    (case,) = kind.cases
    assert (kind.failure, kind.message, case.of, case.text) == ("deadlock", "ask", "ask {3}", CIRCLE)
    assert (case.fate, case.time, case.why) == (Fate.COPED, 4.05, "it was to wait for the reply to back {4}")
    (asked,) = (one for one in story_of(run, 3) if "waits" in one.text)
    assert asked.text == f"its handler waits for the reply to back {{4}}, and is refused: deadlock: {CIRCLE}"
    assert asked.seconds is None
    assert f"came to nothing: deadlock: {CIRCLE}" in [one.text for one in story_of(run, 4)]
    assert (measure(run).deadlocks, measure(run, start=4.1).deadlocks) == (1, 0)


def test_a_deadlock_of_a_program_outside_of_handlers_is_told_to_it() -> None:
    told = Story().module("user").module("k", "slow").at(1.0)
    slow = told.command("slow", "user", to="k")
    told.at(2.0).say(facts.WaitBegan("user", 0, TaskId(slow), Moment.END_ACHIEVING)).at(3.0)
    told.say(facts.RequestRefused("user", Refusal.DEADLOCK, CIRCLE), facts.WaitEnded("user", 0, TaskId(slow)))
    run = told.at(4.0).fold()
    (kind,) = failures(run)
    assert (kind.cases[0].of, kind.cases[0].fate, kind.message) == ("user", Fate.TOLD, "slow")
    assert contents(run).stories == {}


def test_a_query_that_is_dropped_from_a_queue_is_not_on_hold_in_the_classic_log() -> None:
    told, go = going()
    lines = "\n".join(classic_lines(_asked(told, go).entries))
    assert "Dropped" in lines
    assert "ON HOLD" not in lines


@pytest.mark.parametrize("looks_at", [2.5, 5.0])
def test_a_program_that_looks_at_a_result_late_had_to_wait_for_it(looks_at: float) -> None:
    """Whether it waits while the task still runs, or asks when that is over: first that, then the program."""
    told = Story().module("k", "slow").module("user").at(1.0)
    slow = told.command("slow", "user", to="k")
    waits = facts.WaitBegan("user", 0, TaskId(slow), Moment.END_ACHIEVING), facts.WaitEnded("user", 0, TaskId(slow))
    if looks_at < 3.0:
        told.at(looks_at).say(waits[0])
    told.at(3.0).achieved(slow).say(*waits[1:] * (looks_at < 3.0))
    if looks_at > 3.0:
        told.at(looks_at).say(*waits)
    other = told.at(6.0).command("slow", "user")
    run = told.acted(other, "k", 1.0).fold()
    assert path_of(run) == [("slow", "k", 1.0, 3.0), ("outside", "user", 3.0, 6.0), ("slow", "k", 6.0, 7.0)]


def test_of_a_reply_to_many_that_is_waited_for_a_copy_may_stand_in_a_queue() -> None:
    told = Story().module("m", "go").module("n", "all").at(1.0)
    go = told.command("go", "user", to="m")
    asked = told.at(2.0).received("all", MessageClass.MULTI_QUERY, "m", origin=go, blocking=True)
    run = told.say(facts.Queued(asked + 1, asked, "n", "n")).at(5.0).fold()
    assert path_of(run) == [("go", "m", 1.0, 2.0), ("queued", "n", 2.0, 5.0)]


def test_a_lock_is_waited_for_while_somebody_is_at_work_there() -> None:
    told = Story().module("m", "go").module("n", "hog").at(1.0)
    told.command("hog", "user", to="n")
    go = told.at(2.0).command("go", "user", to="m")
    told.at(3.0).say(facts.Claimed(50, "n", "n", False, "m", go))
    run = told.at(6.0).fold()
    path = critical_path(run, Causes(run), run.tasks[go])
    assert [(run.name(step.message_id), step.start, step.end) for step in path.steps] == [("hog", 1.0, 6.0)]
    assert path.because == ["the handler of go {2} waits for the lock of n {50}, busy with hog {1}"]


def test_a_wait_that_begins_just_when_the_journal_ends() -> None:
    told = Story().module("m", "go").at(1.0)
    go = told.command("go", "user", to="m")
    told.at(2.0).queued(told.received("where", QUERY, "m", origin=go, blocking=True))
    assert path_of(told.fold()) == [("go", "m", 1.0, 2.0)]


def test_a_handler_that_is_cut_off_while_it_waits_did_nothing_just_then() -> None:
    """Its module is lost while *ask* is still at work for it: that is on the path until then."""
    told, go = going()
    told.at(4.0).delivered(told.received("ask", QUERY, "m", origin=go, blocking=True), "n").at(6.0)
    told.say(facts.ModuleLeft("m", "lost"), facts.Failed(go, "module lost", ""), facts.Killed(TaskId(go), "lost"))
    run = told.reached(go, *Moment).at(7.0).fold()
    assert path_of(run) == [*SLOW, ("go", "m", 3.5, 4.0), ("ask", "n", 4.0, 6.0)]
