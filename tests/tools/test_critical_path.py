"""The critical path, of runs short enough to work it out by hand."""

from itertools import pairwise
from typing import Any

import pytest
from tools.made_robots import commanding, near, recovering, stepping
from tools.story import QUERY, Story, mopping, resumed_alone, walking

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task, shares
from tca_tools.analysis.step_words import why_then
from tca_tools.analysis.steps import Doing
from tca_tools.journal.records import Task
from tca_tools.journal.whole_run import Run
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass


def path_of(run: Run) -> list[tuple[Any, ...]]:
    """The critical path of the last top-level task: what, where, from when until when; what took no time is left out."""
    task = last_task(run)
    assert task is not None
    return steps_of(run, task)


def steps_of(run: Run, task: Task) -> list[tuple[Any, ...]]:
    """The same of any task."""
    steps = critical_path(run, Causes(run), task).steps
    for before, after in pairwise(steps):
        assert before.end == after.start, "a path has no gaps"
    return [
        (
            run.name(step.message_id) if step.doing is Doing.WORK else str(step.doing),
            step.module,
            *near(step.start, step.end),
        )
        for step in steps
        if step.seconds > 1e-9
    ]


def test_planning_and_acting_in_turn() -> None:
    """Where the time went, and why no step began sooner."""
    run = stepping().fold()
    assert path_of(run) == [
        ("walk", "planner", 1.0, 1.3), ("step", "planner", 1.3, 2.3), ("move", "legs", 2.3, 4.3),
        ("step", "planner", 4.3, 5.3), ("move", "legs", 5.3, 7.3), ("step", "planner", 7.3, 8.3),
        ("move", "legs", 8.3, 10.3),
    ]  # fmt: skip
    path = critical_path(run, Causes(run), run.tasks[1])
    told = [(share.name, share.where, share.steps, *near(share.seconds)) for share in shares(run, path)]
    assert told == [("move", "legs", 3, 6.0), ("step", "planner", 3, 3.0), ("walk", "planner", 1, 0.3)]
    why = [why_then(run, step) for step in path.steps]
    assert why == [
        "", "100 ms in the queue for planner", "", "it waited until step {2} is achieved", "",
        "it waited until step {3} is achieved", "",
    ]  # fmt: skip


def test_a_handler_that_asks_and_commands_and_waits() -> None:
    assert path_of(commanding().fold()) == [
        ("walk", "planner", 1.0, 1.1), ("where", "eye", 1.1, 1.5), ("walk", "planner", 1.5, 1.6),
        ("move", "legs", 1.6, 3.6), ("walk", "planner", 3.6, 3.7), ("where", "eye", 3.7, 4.1),
        ("walk", "planner", 4.1, 4.2), ("move", "legs", 4.2, 6.2), ("walk", "planner", 6.2, 6.3),
    ]  # fmt: skip


def test_through_an_exception_handler_and_a_retry() -> None:
    run = recovering().fold()
    steps = critical_path(run, Causes(run), run.tasks[1]).steps
    told = [(run.name(step.message_id), round(step.start, 6), round(step.end, 6)) for step in steps]
    assert told == [("move", 1.0, 2.0), ("recover", 2.0, 2.2), ("move", 2.2, 3.7)]


def test_a_delay_and_a_missing_handler() -> None:
    story = Story().module("a").module("legs", "move")
    first = story.at(1.0).command("move", "a", to="legs")
    second = 2
    delay = Constraint(Point(TaskId(first), Moment.END_ACHIEVING), Point(TaskId(second), Moment.START_ACHIEVING), 3.0)
    assert story.at(1.5).command("look", "a", 0, delay) == second
    story.at(2.0).achieved(first).at(5.0).say(facts.TimedOut(delay)).queued(second)
    story.at(7.0).module("eye", "look").delivered(second, "eye").at(8.0).achieved(second)
    assert path_of(story.fold()) == [
        ("move", "legs", 1.0, 2.0), ("delay", "", 2.0, 5.0), ("no handler", "", 5.0, 7.0), ("look", "eye", 7.0, 8.0),
    ]  # fmt: skip


def test_a_run_that_is_not_over_leads_to_what_goes_on() -> None:
    run = walking().fold()
    task = last_task(run)
    assert task is not None
    assert (task.id, critical_path(run, Causes(run), task).is_open) == (1, True)
    assert path_of(run)[-2:] == [("move leg", "controller", 1.4, 3.4), ("move body", "controller", 3.4, 4.0)]


def test_nothing_runs_when_the_journal_ends() -> None:
    story = Story().module("a")
    story.at(1.0).command("move", "a")
    story.at(4.0)
    assert path_of(story.fold()) == [("not known", "", 1.0, 4.0)]


def test_a_handler_worked_until_it_waited_for_itself() -> None:
    story = Story().module("a", "walk").at(1.0)
    walk = story.goal("walk", "user", to="a", begins=True)
    story.at(5.0).asked_by(walk).say(facts.WaitBegan("a", walk, TaskId(walk), Moment.END_ACHIEVING))
    assert path_of(story.at(9.0).fold()) == [("walk", "a", 1.0, 5.0), ("in a circle of waits", "", 5.0, 9.0)]


def circling() -> Story:
    """Two walks {1}, {2} whose handlers wait for each other; the second one begins late."""
    story = Story().module("a", "walk").module("b", "walk").at(1.0)
    first, second = story.goal("walk", "user", to="a"), story.goal("walk", "user", to="b")
    story.at(2.0).say(facts.WaitBegan("a", first, TaskId(second), Moment.END_ACHIEVING))
    return story.at(3.0).say(facts.WaitBegan("b", second, TaskId(first), Moment.END_ACHIEVING)).at(9.0)


@pytest.mark.parametrize("is_killed", [True, False])
def test_a_circle_of_waits_is_named_also_when_somebody_ends_it(is_killed: bool) -> None:
    story = circling()
    if is_killed:
        story.say(facts.Killed(TaskId(1), "enough", "panel")).returned(1).reached(1, *Moment)
    run = story.fold()
    assert steps_of(run, run.tasks[1]) == [("walk", "b", 1.0, 3.0), ("in a circle of waits", "", 3.0, 9.0)]
    (*_, stuck) = critical_path(run, Causes(run), run.tasks[1]).steps
    assert why_then(run, stuck) == "it waits for walk {1}, which waits for itself by way of walk {2}"


def test_a_circle_that_the_last_event_closes_led_to_work() -> None:
    assert path_of(circling().fold(3.0)) == [("walk", "b", 1.0, 3.0)]


def test_what_is_suspended_by_something_above_another_task_waits_for_what_still_runs_there() -> None:
    """A walk {1} is suspended while its move {2} runs on; a look {3} of a program is suspended with it, and killed."""
    story = Story().module("a", "walk").module("legs", "move").at(1.0)
    walk = story.goal("walk", "user", to="a", begins=True)
    story.command("move", "a", walk, to="legs")
    story.at(2.0).returned(walk).say(facts.SuspendedOrResumed(TaskId(walk), True))
    look = story.at(3.0).command("look", "user", walk)
    story.at(9.0).say(facts.Killed(TaskId(look), "enough", "panel")).reached(look, *Moment)
    run = story.fold()
    assert steps_of(run, run.tasks[look]) == [("move", "legs", 1.0, 9.0)]


def test_a_query_in_a_queue_that_a_journal_that_ends_waits_for() -> None:
    story = Story().module("a", "walk").module("eye", "where").at(1.0)
    walk = story.command("walk", "user", to="a")
    story.at(2.0).queued(story.received("where", QUERY, "a", origin=walk, blocking=True), "eye")
    assert path_of(story.at(9.0).fold()) == [("walk", "a", 1.0, 2.0), ("queued", "eye", 2.0, 9.0)]


@pytest.mark.parametrize("until", [8.0, None])
def test_a_suspended_task_stands_from_when_on_nothing_of_it_runs(until: float | None) -> None:
    """Also while it still stands: the work that ran on is work."""
    history = mopping("panel").fold(until)
    before = [("sweep", "broom", 1.0, 3.0), ("suspended", "", 3.0, until or 9.0)]
    after = [("sweep", "broom", 9.0, 10.0), ("sweep", "broom", 10.0, 11.0)]
    task = history.tasks[1]
    assert steps_of(history, task) == (before if until else before + after)
    stood = critical_path(history, Causes(history), task).steps[1]
    assert (stood.message_id, why_then(history, stood)) == (1, "suspended by panel at 2.000 s")


def test_a_suspended_task_of_which_nothing_ran_stood_in_a_queue_before() -> None:
    story = Story().module("a", "walk").at(1.0)
    walk = story.goal("walk", "user", to="a", begins=True)
    fly = story.at(1.5).command("fly", "a", walk)
    story.queued(fly).returned(walk).at(3.0)
    story.say(facts.Unqueued(fly), facts.SuspendedOrResumed(TaskId(walk), True)).at(5.0)
    story.say(facts.SuspendedOrResumed(TaskId(walk), False)).queued(fly).at(7.0).acted(fly, "a", 1.0)
    story.reached(walk, Moment.END_ACHIEVING)
    path = [
        ("walk", "a", 1.0, 1.5), ("no handler", "", 1.5, 3.0), ("suspended", "", 3.0, 5.0),
        ("no handler", "", 5.0, 7.0), ("fly", "a", 7.0, 8.0),
    ]  # fmt: skip
    assert path_of(story.fold()) == path
    assert path_of(story.fold(3.0)) == path[:2]  # the journal ends with the suspension


def test_what_was_resumed_alone_works_under_a_suspended_task() -> None:
    assert path_of(resumed_alone().fold()) == [
        ("walk", "a", 1.0, 2.0), ("suspended", "", 2.0, 4.0), ("move", "legs", 4.0, 6.0), ("suspended", "", 6.0, 9.0),
        ("move", "legs", 9.0, 10.0),
    ]  # fmt: skip


def test_the_longest_task_and_the_last() -> None:
    run = recovering().fold()
    last, longest = last_task(run), longest_task(run)
    assert (last and last.id, longest and longest.id) == (5, 1)
    assert last_task(Story().fold()) is None


def test_a_handler_with_very_many_waits_is_walked_in_time() -> None:
    story = Story().module("a", "count").module("b", "add")
    count = story.at(1.0).goal("count", "x", to="a", begins=True)
    for number in range(2_000):
        story.at(2.0 + number).query("add", "a", count, "b", took=0.5)
    story.at(3_000.0).returned(count).reached(count, Moment.END_PLANNING, Moment.END_ACHIEVING)
    assert len(path_of(story.fold())) == 4_001


def standing(story: Story) -> tuple[list[tuple[Any, ...]], str, list[str]]:
    """Of the last task of a run that stands: its path, why its last step lasts, and the waits that lead there."""
    run = story.fold()
    task = last_task(run)
    assert task is not None
    path = critical_path(run, Causes(run), task)
    return steps_of(run, task), why_then(run, path.steps[-1]), path.because


def after(task: int, moment: Moment, delay: float = 0.0) -> Constraint:
    """The message that is sent may not start before that."""
    return Constraint(Point(TaskId(task), moment), Point(TaskId(-1), Moment.START_ACHIEVING), delay)


def test_a_run_that_stands_because_of_a_delay_says_until_when() -> None:
    story = Story().module("legs", "move")
    walk = story.at(1.0).goal("walk", "user", to="legs", begins=True)
    story.acted(first := story.command("move", "user", walk), "legs", 1.0).returned(walk)
    story.command("move", "user", walk, after(first, Moment.END_ACHIEVING, 30.0))
    path, why, because = standing(story.at(12.0))
    assert path == [("move", "legs", 1.0, 2.0), ("delay", "", 2.0, 12.0)]
    assert why == "it waits until 32.000 s, 20 s after the journal ends"
    assert because == []


def test_a_run_that_stands_because_of_a_constraint_on_a_task_that_still_runs() -> None:
    story = Story().module("legs", "move").module("eye", "look")
    look, move = 2, story.at(1.0).command("move", "user")
    assert story.at(2.0).command("look", "user") == look
    story.delivered(look, "eye").say(facts.Constrained([_start_after(move, look)]))
    path, why, because = standing(story.at(9.0))
    assert path == [("look", "eye", 2.0, 9.0)]
    assert (why, because) == ("", ["move {1} waits until look {2} is achieved"])


def test_a_run_that_stands_because_of_a_constraint_on_a_task_that_stands_itself() -> None:
    """Through a handler that waits, to a task under another one."""
    story = Story().module("a", "walk").module("b", "clean")
    walk = story.at(1.0).goal("walk", "user", to="a", begins=True)
    clean = story.at(2.0).goal("clean", "user", to="b", begins=True)
    story.at(3.0).queued(story.command("sweep", "b", clean)).returned(clean).reached(clean, Moment.END_PLANNING)
    story.at(4.0).say(facts.WaitBegan("a", walk, TaskId(clean), Moment.END_ACHIEVING))
    path, _, because = standing(story.at(9.0))
    assert path[-1] == ("no handler", "", 3.0, 9.0)
    assert because == ["the handler of walk {1} waits until clean {2} is achieved"]


def test_a_run_that_stands_because_of_a_lock_that_somebody_has_taken_outside_of_any_handler() -> None:
    story = Story().module("a", "walk").module("legs", "move").module("user").at(1.0)
    story.say(facts.Claimed(77, "legs", "legs", False, "user", 0), facts.Granted(77)).at(2.0)
    walk = story.goal("walk", "user", to="a")
    story.at(3.0).say(facts.Claimed(78, "legs", "legs", False, "a", walk))
    path, why, _ = standing(story.at(9.0))
    assert path[-2:] == [("walk", "a", 2.0, 3.0), ("locked", "user", 3.0, 9.0)]
    assert why == "it waits for the lock of legs {78}, which user has locked"


def test_a_run_that_stands_because_a_monitor_watches() -> None:
    story = Story().at(1.0)
    watch = story.received("look out", MessageClass.POLLING_MONITOR, "user")
    story.at(2.0).reached(watch, Moment.START_HANDLING, Moment.START_ACHIEVING)
    assert standing(story.at(9.0))[0][-1] == ("watching", "", 2.0, 9.0)


def test_a_run_that_stands_on_a_constraint_of_which_no_more_is_known() -> None:
    story = Story().at(1.0)
    first = story.command("move", "user")
    second = story.at(2.0).command("look", "user")
    story.say(facts.Constrained([_start_after(first, second)]))
    path, why, _ = standing(story.at(9.0))
    assert (path, why) == ([("held", "", 1.0, 9.0)], "it waits until look {2} is achieved")


def _start_after(task: int, other: int) -> Constraint:
    return Constraint(Point(TaskId(other), Moment.END_ACHIEVING), Point(TaskId(task), Moment.START_ACHIEVING))


def test_a_task_that_its_deadline_killed_leads_to_what_it_waited_for_elsewhere() -> None:
    """As its story does: most of its time went by because nobody handled what another task needed."""
    story = Story().module("a", "walk", "charge").at(1.0)
    charge = story.goal("charge", "user", to="a", begins=True)
    story.at(1.5)
    story.queued(story.command("plug in", "a", charge)).returned(charge).reached(charge, Moment.END_PLANNING).at(2.0)
    walk = story.goal("walk", "user", to="a", begins=True)
    step = story.at(3.0).command("step", "a", walk, _start_after(4, charge))
    story.returned(walk).at(9.0).say(facts.Failed(walk, "timeout", "", is_beside=True))
    for task in (step, walk):
        story.say(facts.Killed(TaskId(task), "late")).reached(task, *Moment)
    run = story.fold()
    assert steps_of(run, run.tasks[TaskId(walk)]) == [("charge", "a", 1.0, 1.5), ("no handler", "", 1.5, 9.0)]


def test_a_task_that_a_handler_kills_leads_into_that_handler() -> None:
    story = Story().module("a", "walk", "watch").at(1.0)
    walk = story.goal("walk", "user", to="a", begins=True)
    story.returned(walk).at(2.0)
    watch = story.goal("watch", "user", to="a")
    story.at(5.0).asked_by(watch).say(facts.Killed(TaskId(walk), "enough")).reached(walk, *Moment)
    run = story.fold()
    assert steps_of(run, run.tasks[TaskId(walk)])[-1] == ("watch", "a", 2.0, 5.0)


def test_a_task_that_is_suspended_twice_and_killed_by_its_deadline() -> None:
    story = Story().module("a", "walk").module("legs", "move").at(1.0)
    walk = story.goal("walk", "user")
    story.delivered(walk, "a").reached(walk, Moment.START_ACHIEVING)
    story.at(2.0).returned(walk).say(facts.SuspendedOrResumed(TaskId(walk), True))
    story.at(3.0).say(facts.SuspendedOrResumed(TaskId(walk), False))
    story.at(4.0).say(facts.SuspendedOrResumed(TaskId(walk), True))
    story.at(6.0).say(facts.Killed(TaskId(walk), "late")).reached(walk, *Moment)
    assert path_of(story.fold()) == [
        ("walk", "a", 1.0, 2.0), ("suspended", "", 2.0, 3.0), ("not known", "", 3.0, 4.0),
        ("suspended", "", 4.0, 6.0),
    ]  # fmt: skip
