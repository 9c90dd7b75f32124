"""A failure for which a task above is begun again is overcome: at once, in all tools, and they say who decided that."""

import msgspec
import pytest
from tools.story import Story

from tca_tools.analysis.failures import failures
from tca_tools.run.fates import Fate, begun_again_with, coped_with, fate, hinges
from tca_tools.run.fold import History
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.why.story import story as story_of
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Role

DAY, JOB, MOVE, REDO, AGAIN = 1, 2, 3, 4, 5
JAM = "jam: the belt"
WITH_JOB = "task 2 'job' is retried"


def jammed() -> Story:
    """Of a job {2} of the day {1} a move {3} fails, and an exception handler {4} of the planner runs for that."""
    story = Story().module("planner", "day", "job", "redo").module("base", "move").at(1.0)
    day = story.goal("day", "user", to="planner")
    job = story.at(1.1).goal("job", "planner", day)
    story.returned(day).delivered(job, "planner").at(1.2)
    move = story.command("move", "planner", job)
    story.returned(job).delivered(move, "base").at(2.0).failed(move, "jam", "the belt")
    redo = story.received("redo", MessageClass.EXCEPTION, "central", move, origin=0, role=Role.EXCEPTION, about=move)
    story.say(facts.Caught(TaskId(move), TaskId(redo), TaskId(job), 9)).at(2.5).delivered(redo, "planner")
    return story.at(3.0)


def begun_again(*, body: bytes = b"") -> Story:
    """It has the job handled again."""
    story = jammed().asked_by(REDO).say(facts.Retried(TaskId(JOB), body, "planner"))
    story.say(facts.Killed(TaskId(MOVE), WITH_JOB, "planner", REDO))
    story.at(3.1).returned(REDO).reached(REDO, *Moment).reached(MOVE, *Moment).delivered(JOB, "planner").at(3.2)
    move = story.command("move", "planner", JOB)
    return story.returned(JOB).delivered(move, "base").at(4.0)


def achieved(story: Story) -> Story:
    return story.returned(AGAIN).reached(AGAIN, *Moment).reached(JOB, *Moment).at(6.0)


def told(run: History, number: int, moment: float = 9.0) -> list[str]:
    return [one.text for one in failure_chain(run, TaskId(number), moment)]


def sentences(run: History, number: int) -> list[str]:
    return [one.text for one in story_of(run, number)]


def test_it_is_overcome_when_the_task_above_is_begun_again_though_the_top_level_task_goes_on() -> None:
    run = begun_again().fold()
    move = run.tasks[MOVE]
    assert fate(run, move, 2.0) is Fate.RETRIED
    assert begun_again_with(run, move, 2.0) is run.tasks[JOB]
    assert hinges(run, move, 2.0) == []
    assert [coped_with(run, move, moment) for moment in (1.5, 2.7, 3.5)] == [False, True, True]
    assert fate(run, move, 2.0, known=2.7) is Fate.OPEN


def test_it_stays_so_though_the_run_fails_later_for_another_reason() -> None:
    story = achieved(begun_again())
    why = "failure 'flood' of task 1 'day' was not handled"
    story.say(facts.Failed(TaskId(DAY), "flood", ""), facts.Unhandled(TaskId(DAY)))
    run = story.say(facts.Killed(TaskId(DAY), why, "central")).reached(DAY, *Moment).fold()
    found = {case.message_id: (case.fate, case.why) for kind in failures(run) for case in kind.cases}
    assert found[MOVE] == (Fate.RETRIED, "job {2} was handled again: achieved")
    assert found[DAY][0] is Fate.NOT_HANDLED


def test_the_steps_of_the_failure_go_on_to_what_became_of_the_task_above() -> None:
    steps = [
        f"move {{3}} failed: {JAM}",
        "exception handler redo {4} was called in planner",
        f"move {{3}} was killed: {WITH_JOB} (by planner)",
    ]
    assert told(begun_again().fold(), MOVE) == steps
    run = achieved(begun_again()).fold()
    assert told(run, MOVE) == [*steps, "job {2}, handled again: achieved"]
    assert told(run, MOVE, 3.5) == steps


@pytest.mark.parametrize("body", [b"", msgspec.msgpack.encode(2)])
def test_who_decided_that_is_told_by_the_task_above_and_by_the_exception_handler(body: bytes) -> None:
    run = begun_again(body=body).fold()
    other = ", with other data" * bool(body)
    whom = f"planner: redo {{4}}, called for move {{3}}, which had failed: {JAM}"
    assert f"to be handled again{other} (retried by {whom})" in sentences(run, JOB)
    assert f"has job {{2}} handled again{other}" in sentences(run, REDO)


def test_where_two_exception_handlers_run_in_a_module_the_one_that_asked_has_decided() -> None:
    story = jammed()
    other = story.received("redo", MessageClass.EXCEPTION, "central", MOVE, origin=0, role=Role.EXCEPTION, about=MOVE)
    story.delivered(other, "planner", "second").at(3.0).asked_by(REDO)
    run = story.say(facts.Retried(TaskId(JOB), b"", "planner")).at(4.0).fold()
    assert any(text.startswith("to be handled again (retried by planner: redo {4}") for text in sentences(run, JOB))
    assert "has job {2} handled again" in sentences(run, REDO)
    assert not [text for text in sentences(run, other) if "handled again" in text]


def test_of_a_task_that_is_retried_for_its_own_failure_nothing_is_said_twice() -> None:
    run = jammed().asked_by(REDO).say(facts.Retried(TaskId(MOVE), b"", "planner")).at(4.0).fold()
    assert "to be handled again (retried by planner)" in sentences(run, MOVE)
    assert "has move {3} handled again" in sentences(run, REDO)


def killed() -> Story:
    """It has the job killed."""
    return jammed().say(*(facts.Killed(TaskId(task), "enough", "planner", REDO) for task in (JOB, MOVE))).at(3.1)


def by_user(story: Story, by: str = "user") -> Story:
    return story.say(facts.Killed(TaskId(DAY), f"by module '{by}'", by))


def through(story: Story) -> Story:
    return story.returned(REDO).reached(REDO, *Moment).reached(MOVE, *Moment).reached(JOB, *Moment).at(4.0)


def test_what_its_exception_handler_kills_is_overcome_as_long_as_the_top_level_task_goes_on() -> None:
    run = killed().fold()
    assert fate(run, run.tasks[MOVE], 2.0) is Fate.REPLACED
    assert hinges(run, run.tasks[MOVE], 2.0)
    run = by_user(killed(), "planner").at(5.0).fold()  # the exception handler gives up
    assert fate(run, run.tasks[MOVE], 2.0) is Fate.KILLED
    assert fate(run, run.tasks[MOVE], 2.0, known=3.05) is Fate.REPLACED


def test_it_stays_so_when_the_run_is_ended_later_for_another_reason() -> None:
    run = through(killed()).fold()
    assert hinges(run, run.tasks[MOVE], 2.0) == []
    assert "kills job {2}" in sentences(run, REDO)
    assert "kills move {3}" not in sentences(run, REDO)  # with that
    run = by_user(through(killed())).reached(DAY, *Moment).at(5.0).fold()
    assert fate(run, run.tasks[MOVE], 2.0) is Fate.REPLACED
