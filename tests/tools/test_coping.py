"""Who copes with a failure: a task that is handled again or dealt with, or who had asked and went on; seen in all tools."""

from collections.abc import Callable

import msgspec
import pytest
from click.testing import Result
from tools.story import QUERY, Story

from tca_tools.analysis.failures import failures
from tca_tools.analysis.summary import summary
from tca_tools.explain.story import story as story_of
from tca_tools.gantt.build import chart
from tca_tools.gantt.chart import Ending
from tca_tools.gantt.svg import svg_text
from tca_tools.journal.fates import Fate, begun_again_with, coped_with, fate, hinges, told_to, went_on
from tca_tools.journal.fold import History
from tca_tools.tasktree_viz.failing import failure_chain
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Dropping, MessageClass, Outcome, Role

Tca = Callable[..., Result]
LOOKED, ASKED = 2, 3


def asking(*, passed_on: bool = False, task_fails: bool = False, dealt_with: bool = False) -> Story:
    """A walk {1} asks where it is {2}; who handles that asks for a look {3}, which fails. What it then does, and the
    walk, is told; the walk's failure may be dealt with.
    """
    story = Story().module("planner", "walk").module("maps", "where").module("eye", "look").module("expert", "help")
    walk = story.at(1.0).goal("walk", "user", to="planner")
    where = story.at(1.1).received("where", QUERY, "planner", origin=walk, blocking=True, to="maps")
    look = story.at(1.2).received("look", QUERY, "maps", origin=where, blocking=True, to="eye")
    _fail(story.at(2.0), look).say(facts.Answered(look)).at(3.0)
    if not passed_on:
        story.returned(where).say(facts.Answered(where))
    else:
        _fail(story, where).say(facts.Answered(where))
    story.at(4.0)
    if not task_fails:
        return story.returned(walk).reached(walk, *Moment).at(5.0)
    _fail(story, walk)
    if not dealt_with:
        return story.say(facts.Unhandled(TaskId(walk))).reached(walk, *Moment).at(5.0)
    handler = story.rescued(walk, "help", "expert")
    story.at(4.5).returned(handler).reached(handler, *Moment).say(facts.Recovered(TaskId(walk)))
    return story.reached(walk, *Moment).at(5.0)


def _fail(story: Story, number: int) -> Story:
    return story.failed(number, "blind", "fog")


def fates(run: History) -> dict[int, Fate]:
    return {case.message_id: case.fate for kind in failures(run) for case in kind.cases}


def test_who_asked_went_on() -> None:
    run = asking().fold()
    look = run.messages[ASKED]
    assert went_on(run, look, 2.0)
    assert told_to(run, look, 2.0) == "told to maps, whose handler of where {2} went on"
    assert fates(run) == {ASKED: Fate.COPED}
    assert all(kind.is_good for kind in failures(run))
    assert summary(run).is_good
    assert (2.0, f"its failure is {told_to(run, look, 2.0)}") in [(one.time, one.text) for one in story_of(run, ASKED)]


@pytest.mark.parametrize(
    ("task_fails", "dealt_with", "end"), [(False, False, True), (True, False, False), (True, True, True)]
)
def test_a_failure_that_is_passed_on_is_followed(*, task_fails: bool, dealt_with: bool, end: bool) -> None:
    run = asking(passed_on=True, task_fails=task_fails, dealt_with=dealt_with).fold()
    assert [went_on(run, run.messages[number], time) for number, time in ((ASKED, 2.0), (LOOKED, 3.0))] == [end, end]
    assert fates(run)[ASKED] is (Fate.COPED if end else Fate.ANSWERED)
    after = ", and that was handled" if end else ""
    assert told_to(run, run.messages[ASKED], 2.0) == f"told to maps, whose handler of where {{2}} failed then{after}"


def given_up() -> Story:
    """The same; but who handles "where is it" is lost before the look fails, and the walk fails with that."""
    story = Story().module("planner", "walk").module("maps", "where").module("eye", "look")
    walk = story.at(1.0).goal("walk", "user", to="planner")
    where = story.received("where", QUERY, "planner", origin=walk, blocking=True, to="maps")
    look = story.at(1.2).received("look", QUERY, "maps", origin=where, blocking=True, to="eye")
    story.at(2.0).say(
        facts.ModuleLeft("maps", "fog"), facts.Dropped(look, "any", "its sender gave up", dropping=Dropping.GIVEN_UP)
    )
    _fail(story.say(facts.Failed(where, "blind", "fog"), facts.Answered(where)), walk)
    story.say(facts.Unhandled(TaskId(walk)), facts.Killed(TaskId(walk), "blind", "central")).reached(walk, *Moment)
    return _fail(story.at(9.0), look).at(10.0)


def test_who_had_given_up_is_not_told_and_nothing_of_his_fails_later() -> None:
    run = given_up().fold()
    look = run.messages[ASKED]
    told = "told to nobody: its sender had given up"
    assert told_to(run, look, 9.0) == told
    assert fates(run) == {1: Fate.NOT_HANDLED, LOOKED: Fate.ANSWERED, ASKED: Fate.UNTOLD}
    assert [kind.message for kind in failures(run)][-1] == "look"  # though it cost most
    assert not went_on(run, look, 9.0)
    assert hinges(run, look, 9.0) == []
    assert f"its failure is {told}" in [one.text for one in story_of(run, ASKED)]
    links = failure_chain(run, TaskId(1))
    assert [one.text for one in links if one.depth] == ["where {2} failed: blind: fog"]
    assert max(one.time for one in links) == 2.0
    bar = next(bar for row in chart(run).rows for bar in row.handled if bar.name == "look")
    assert bar.title().endswith(f": failed: blind: fog, {told}")


def test_who_had_ended_is_not_told() -> None:
    """The handler that had asked returned without the answer."""
    story = Story().module("planner", "walk").module("eye", "look").at(1.0)
    walk = story.goal("walk", "user", to="planner")
    look = story.received("look", QUERY, "planner", origin=walk, to="eye")
    story.at(2.0).returned(walk).reached(walk, *Moment)
    run = _fail(story.at(3.0), look).say(facts.Answered(look)).fold()
    assert told_to(run, run.messages[look], 3.0) == "told to nobody: the handler of walk {1} that asked had ended"
    assert fates(run) == {look: Fate.UNTOLD}


def test_of_a_condition_that_fails_after_its_monitor_ended_nobody_is_told() -> None:
    story = Story().module("eye", "hot?").at(1.0)
    monitor = story.received("watch", MessageClass.POINT_MONITOR, "user")
    asked = story.received("hot?", QUERY, "central", role=Role.CONDITION, about=monitor, to="eye")
    story.at(2.0).say(facts.Killed(TaskId(monitor), "enough", "user")).reached(monitor, *Moment)
    run = _fail(story.at(3.0), asked).fold()
    assert told_to(run, run.messages[asked], 3.0) == "told to nobody: watch {1} watched no longer"
    assert fates(run) == {asked: Fate.UNTOLD}


def test_nor_if_it_has_begun_anew_for_the_second_time() -> None:
    """It ended its watch with the same words before: that was no news."""
    again = [facts.MonitorEnded(TaskId(1), "it is retried"), facts.Retried(TaskId(1), b"", "user")]
    story = Story().module("eye", "hot?").at(1.0)
    monitor = story.received("watch", MessageClass.POINT_MONITOR, "user")
    story.at(2.0).say(*again)
    asked = story.received("hot?", QUERY, "central", role=Role.CONDITION, about=monitor, to="eye")
    story.at(3.0).say(*again)
    run = _fail(story.at(4.0), asked).fold()
    assert told_to(run, run.messages[asked], 4.0) == "told to nobody: watch {1} watched no longer"


def test_a_helper_that_fails_when_all_is_decided_is_no_step_of_the_failure() -> None:
    """A walk is retried by hand while its exception handler runs; that fails later, and the walk is killed at last."""
    story = Story().module("legs", "walk").module("expert", "help").at(1.0)
    walk = story.goal("walk", "user")
    _fail(story.delivered(walk, "legs").at(2.0), walk)
    helper = story.rescued(walk, "help", "expert")
    story.at(3.0)
    story.say(facts.Retried(TaskId(walk), b"", by="user")).at(4.0).delivered(walk, "legs").at(5.0)
    _fail(story, helper).at(6.0).say(facts.Killed(TaskId(walk), "enough", "user")).returned(walk).reached(walk, *Moment)
    run = story.fold()
    assert not any("help {2} failed" in one.text for one in failure_chain(run, TaskId(walk)))


def test_of_what_is_killed_later_there_is_no_chain_yet() -> None:
    """A step fails, and in the end the walk is killed for that."""
    story = Story().module("legs", "step").at(1.0)
    walk = story.goal("walk", "user")
    step = story.goal("step", "user", walk)
    _fail(story.delivered(step, "legs").at(2.0), step).at(3.0).say(facts.Unhandled(TaskId(step)))
    why = "failure 'blind' of task 2 'step' was not handled"
    story.say(*(facts.Killed(TaskId(task), why, failed=TaskId(step)) for task in (walk, step)))
    run = story.reached(step, *Moment).reached(walk, *Moment).at(4.0).fold()
    assert [one.depth for one in failure_chain(run, TaskId(walk))] == [1, 0, 1]
    assert failure_chain(run, TaskId(walk), 2.5) == []


def test_of_an_inform_nobody_is_told_and_of_a_condition_its_monitor() -> None:
    story = Story().module("eye", "hot?", "log").at(1.0)
    log = story.received("log", MessageClass.INFORM, "user")
    _fail(story.delivered(log, "eye").at(2.0), log)
    monitor = story.received("watch", MessageClass.POINT_MONITOR, "user")
    asked = story.received("hot?", QUERY, "central", role=Role.CONDITION, about=monitor)
    _fail(story.delivered(asked, "eye").at(3.0), asked)
    run = story.fold()
    assert went_on(run, run.messages[asked], 3.0) is False  # nothing is known of the monitor yet
    run = story.say(facts.Failed(monitor, "blind", "its condition: fog"), facts.Unhandled(TaskId(monitor))).fold()
    assert fates(run) == {log: Fate.UNTOLD, asked: Fate.ANSWERED, monitor: Fate.NOT_HANDLED}
    assert told_to(run, run.messages[asked], 3.0) == "told to central, for watch {2}"


def test_who_asked_directly_is_followed_too() -> None:
    """A note of a direct message may come when the handler that had sent it is long done."""
    for task_fails in (False, True):
        story = Story().module("cook", "bake").module("eye", "look").at(1.0)
        story.say(facts.FormatDefined("look", QUERY, "{}", "{}", "eye"))
        bake = story.goal("bake", "user", to="cook")
        story.at(3.0)
        if task_fails:
            _fail(story, bake).say(facts.Unhandled(TaskId(bake)))
        else:
            story.returned(bake)
        story.reached(bake, *Moment).at(4.0)
        story.say(facts.HandledDirectly("look", "eye", "eye", "cook", bake, 1, 2.0, 0.2, Outcome.FAILED, "blind"))
        bar = next(bar for row in chart(story.fold()).rows for bar in row.handled if bar.name == "look")
        went = "failed then" if task_fails else "went on"
        assert (bar.ending is Ending.COPED) is not task_fails
        assert bar.title().endswith(f": failed, told to cook, whose handler of bake {{1}} {went}")


def replacing(*, top_fails: bool = False) -> Story:
    """A step {2} of a walk {1} fails, and is killed for that; the walk is achieved without it, or fails too."""
    story = Story().module("legs", "step").at(1.0)
    walk = story.goal("walk", "user")
    step = story.goal("step", "user", walk)
    _fail(story.delivered(step, "legs").at(2.0), step).say(facts.Unhandled(TaskId(step)))
    story.say(facts.Killed(TaskId(step), "not needed", "user")).reached(step, *Moment).at(3.0)
    if top_fails:
        story.say(facts.Killed(TaskId(walk), "no way", "user"))
    return story.reached(walk, *Moment).at(4.0)


@pytest.mark.parametrize("top_fails", [False, True])
def test_what_is_called_replaced_is_no_bad_news_anywhere(*, top_fails: bool) -> None:
    run = replacing(top_fails=top_fails).fold()
    step = run.tasks[TaskId(2)]
    assert fates(run) == {2: Fate.NOT_HANDLED if top_fails else Fate.REPLACED}
    assert went_on(run, step, 2.0) is not top_fails
    assert ('class="coped"' in svg_text(chart(run), "")) is not top_fails
    end = "step {2} was killed: not needed (by user)" + ("" if top_fails else "; walk {1} was achieved without it")
    assert failure_chain(run, TaskId(2))[-1].text == end


def test_of_two_failures_the_first_is_not_dealt_with_because_the_second_came() -> None:
    """While an exception handler decides, another failure is raised on the same task; then it is killed."""
    story = Story().module("legs", "step").module("expert", "help").at(1.0)
    step = story.goal("step", "user")
    _fail(story.delivered(step, "legs").at(2.0), step)
    story.rescued(step, "help", "expert")
    story.at(3.0).say(facts.Failed(step, "hot", "")).at(4.0)
    run = story.say(facts.Killed(TaskId(step), "too much", "expert")).reached(step, *Moment).fold()
    (kinds,) = [[case.fate for kind in failures(run) for case in kind.cases]]
    assert kinds == [Fate.KILLED, Fate.NOT_HANDLED]


def test_what_was_dealt_with_stays_so_though_the_task_is_killed_later() -> None:
    story = asking(passed_on=True, task_fails=True, dealt_with=True)
    story.entries[-1].facts.clear()
    run = story.say(facts.Killed(TaskId(1), "enough", "user")).fold()
    assert fates(run)[1] is Fate.DEALT_WITH


def test_what_names_itself_as_its_sender_is_followed_no_further() -> None:
    story = Story().module("eye", "look").at(1.0).say(facts.Delivered(1, 1, "eye", "eye"))
    look = story.received("look", QUERY, "eye", origin=1)
    run = _fail(story.at(2.0), look).fold()
    assert went_on(run, run.messages[look], 2.0)


# --- a task above is begun again -------------------------------------------------------------------------------------


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
