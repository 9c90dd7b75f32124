"""Outcome, failures, waits and resources of a run, each worked out by hand."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.made_robots import commanding, fail, near, recovering, stepping
from tools.story import Story, mopping, walking

from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Topic
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path, last_task, longest_task
from tca_tools.analysis.failures import failures
from tca_tools.analysis.long_waits import long_waits as waits
from tca_tools.analysis.resources import uses
from tca_tools.analysis.summary import span_of, summary
from tca_tools.journal.fates import Fate
from tca_tools.journal.records import TaskState
from tca_tools.journal.whole_run import Run
from tca_tools.report.contents import contents
from tca_tools.spans import Cover, levels
from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import MessageClass, Outcome, Role
from tca_wire.waits import WaitKind


def test_a_good_run() -> None:
    run = summary(stepping().fold())
    assert (run.outcome, run.is_good, run.failures) == ("The top-level task was achieved.", True, 0)
    assert (run.start, run.end, run.modules) == (1.0, 10.3, 3)
    assert run.tasks == {TaskState.ACHIEVED: 7}


def test_a_run_that_is_not_over_and_one_of_nothing() -> None:
    run = summary(walking().fold())
    assert (run.outcome, run.is_good, run.end) == (
        "The top-level task was not over when the journal ended.",
        False,
        4.0,
    )
    assert summary(Story().fold()).outcome == "No task was sent."
    assert summary(Run()).seconds == 0.0


CALLED = "recover {2} was called in expert"


def test_failures_and_what_became_of_them() -> None:
    kinds = {kind.failure: kind.cases[0] for kind in failures(recovering().fold())}
    slip, fall, jam = kinds["slip"], kinds["fall"], kinds["jam"]
    assert (slip.fate, slip.of, slip.text, slip.time) == (Fate.RETRIED, "move {1}", "left foot", 2.0)
    assert (slip.raised_by, slip.called) == ("by its handler in legs", [CALLED])
    assert near(slip.lost, slip.recovery) == (1.0, 0.2)
    assert near(fall.fate, fall.lost, fall.recovery) == (Fate.DEALT_WITH, 0.5, 0.3)
    assert near(jam.fate, jam.called, jam.cost) == (Fate.NOT_HANDLED, [], 0.4)
    assert next(iter(kinds)) == "jam"  # what was not overcome comes first


def test_a_task_that_was_killed_by_its_exception_handler_and_replaced() -> None:
    story = Story().module("user").module("planner", "walk").module("legs", "move").module("expert", "recover")
    walk = story.at(1.0).goal("walk", "user", to="planner", begins=True)
    move = story.command("move", "planner", walk, to="legs")
    story.returned(walk)
    fail(story.at(2.0), move, "slip", "")
    helper = story.rescued(move, "recover", "expert")
    story.at(2.1).say(facts.Killed(TaskId(move), "another way"), facts.Recovered(TaskId(move)))
    story.at(3.0).returned(helper).reached(helper, *Moment).reached(move, *Moment).reached(walk, *Moment)
    (kind,) = failures(story.fold())
    (case,) = kind.cases
    assert (case.fate, case.why, kind.is_good) == (Fate.REPLACED, "another way", True)
    assert near(case.lost, case.recovery) == (1.0, 1.0)


def test_a_failure_that_is_dealt_with_before_another_is_raised() -> None:
    story = Story().module("legs", "move").module("expert", "recover")
    move = story.at(1.0).command("move", "user", to="legs")
    story.at(2.0).say(facts.Failed(move, "slow", "", is_beside=True))
    helper = story.rescued(move, "recover", "expert")
    story.at(2.5).returned(helper).reached(helper, *Moment).say(facts.Recovered(TaskId(move)))
    fail(story.at(4.0), move, "slip", "")
    story.say(facts.Unhandled(TaskId(move)), facts.Killed(TaskId(move), "slip")).reached(move, *Moment)
    cases = {kind.failure: kind.cases[0] for kind in failures(story.fold())}
    slow, slip = cases["slow"], cases["slip"]
    assert near(slow.fate, slow.recovery, slow.called) == (Fate.DEALT_WITH, 0.5, [CALLED])
    assert near(slip.fate, slip.lost, slip.called) == (Fate.NOT_HANDLED, 3.0, [])


@pytest.mark.parametrize(
    ("title", "handled"), [("Nobody handles 'dance'", ()), ("Nobody handles 'dance' for a while", (1.0, 2.0)),
                           ("Nobody handles 'dance' for a while", (5.0,))],
)  # fmt: skip
def test_whether_nobody_ever_handled_it_or_only_then(title: str, handled: tuple[float, ...]) -> None:
    """Handled from the first time until the second, if there is one; a dance is sent at 3.0."""
    story = Story().module("user")
    times = dict(zip(handled, ("come", "go"), strict=False)) | {3.0: "dance"}
    for time in sorted(times):
        story.at(time)
        if times[time] == "come":
            story.module("legs", "dance")
        elif times[time] == "go":
            story.say(facts.HandlerRemoved("dance", "legs"))
        else:
            story.queued(story.command("dance", "user"))
    run = story.at(9.0).fold()
    (one,) = advice(run, Causes(run), None, [], [], [], 0.1)
    assert (one.title, round(one.saving, 6)) == (title, 6.0)


@pytest.mark.parametrize("is_killed", [True, False])
def test_a_deadline_costs_what_was_done_until_then(is_killed: bool) -> None:
    """The handler had run for half a second when its time was over; nothing is lost if the task then goes on."""
    story = Story().module("oven", "dock").module("expert", "recover")
    dock = story.at(1.0).command("dock", "user", to="oven")
    story.at(1.5).say(facts.Failed(dock, "timeout", "not within 0.5 s", is_beside=True))
    if is_killed:
        story.say(facts.Unhandled(TaskId(dock)), facts.Killed(TaskId(dock), "timeout"))
    else:
        helper = story.rescued(dock, "recover", "expert")
        story.returned(helper).reached(helper, *Moment).say(facts.Recovered(TaskId(dock)))
    run = story.at(1.6).returned(dock).reached(dock, *Moment).fold()
    (kind,) = failures(run)
    assert near(kind.cases[0].lost) == ((0.5,) if is_killed else (0.0,))
    outcome = run.tasks[dock].handlings[0].outcome  # it returned, but its task had been killed
    assert outcome is (Outcome.KILLED if is_killed else Outcome.DONE)


def test_failures_at_the_same_time_cost_that_time_once() -> None:
    story = Story().module("legs", "move", resource="legs")
    moves = [story.at(1.0).command("move", "user") for _ in range(2)]
    for move in moves:
        story.delivered(move, "legs")
    for move in moves:
        fail(story.at(3.0), move, "slip", "")
    (kind,) = failures(story.fold())
    assert near(kind.cost, len(kind.cases)) == (2.0, 2)


def test_a_failure_that_is_raised_from_outside_and_one_of_a_query() -> None:
    story = Story().module("legs", "move").module("eye", "where")
    move = story.at(1.0).command("move", "user", to="legs")
    story.at(2.0).say(facts.Failed(move, "timeout", "not within 1 s", is_beside=True))
    where = story.at(3.0).received("where", MessageClass.QUERY, "user", blocking=True, to="eye")
    story.at(3.5)
    fail(story, where, "blind", "")
    timeout, blind = (kind.cases[0] for kind in failures(story.fold()))
    assert (timeout.raised_by, timeout.fate) == ("by central", Fate.NOT_HANDLED)
    assert near(blind.fate, blind.lost) == (Fate.TOLD, 0.5)
    assert blind.why == "told to user"


def test_the_longest_waits_of_each_kind() -> None:
    found = {kind.kind: kind for kind in waits(stepping().fold())}
    held = found[WaitKind.CONSTRAINT]
    assert [near(wait.who, wait.start, wait.seconds, wait.what) for wait in held.longest] == [
        ("step {4}", 1.2, 6.1, "until step {3} is achieved"),
        ("step {3}", 1.2, 3.1, "until step {2} is achieved"),
    ]
    (queued,) = found[WaitKind.RESOURCE].longest
    assert near(queued.who, queued.seconds, queued.what) == ("step {2}", 0.1, "for planner, busy with walk {1}")


def test_waits_for_replies_and_tasks_name_who_was_slow() -> None:
    found = {kind.kind: kind for kind in waits(commanding().fold())}
    assert near(found[WaitKind.REPLY].number, found[WaitKind.REPLY].seconds) == (2, 0.8)
    reply, task = found[WaitKind.REPLY].longest[0], found[WaitKind.TASK].longest[0]
    assert (reply.who, reply.what) == ("the handler of walk {1}", "for the reply to where {2}, which eye handles")
    assert task.what == "until move {3} is achieved"


def test_waits_for_locks_and_for_nobody() -> None:
    story = Story().module("eye").module("legs", "move")
    story.at(1.0).say(facts.Claimed(50, "legs", "legs", False, "eye", 0), facts.Granted(50))
    story.at(2.0).queued(story.command("move", "user"), "legs").queued(story.command("dance", "user")).at(6.0)
    found = {kind.kind: kind.longest[0] for kind in waits(story.fold())}
    lock, nobody = found[WaitKind.LOCK], found[WaitKind.HANDLER]
    assert (lock.what, lock.seconds, lock.is_open) == ("for legs, which eye has locked", 4.0, True)
    assert nobody.what == "for a module that handles dance"


def test_a_suspended_task_waits_from_when_on_nothing_of_it_runs() -> None:
    found = {kind.kind: kind for kind in waits(mopping().fold())}
    (wait,) = found[WaitKind.RESUME].longest
    assert (wait.who, wait.start, wait.seconds, wait.is_open) == ("mop floor {1}", 3.0, 6.0, False)
    assert wait.what == "until it is resumed; suspended at 2.000 s, work under it went on"
    by = {kind.kind: kind for kind in waits(mopping("panel").fold())}[WaitKind.RESUME].longest[0].what
    assert by == "until it is resumed; suspended by panel at 2.000 s, work under it went on"
    (nobody,) = found[WaitKind.HANDLER].longest
    assert (nobody.who, nobody.start, nobody.is_open) == ("fly {5}", 1.6, True)
    (still,) = (kind for kind in waits(mopping().fold(4.0)) if kind.kind is WaitKind.RESUME)
    assert (still.longest[0].seconds, still.longest[0].is_open) == (1.0, True)
    assert not any(kind.kind is WaitKind.RESUME for kind in waits(mopping().fold(2.5)))  # a sweep runs on


def test_a_handler_that_waits_for_what_is_suspended_under_it_does_not_work() -> None:
    story = Story().module("planner", "walk").module("legs", "move").at(1.0)
    walk = story.command("walk", "user", to="planner")
    story.say(facts.SuspendedOrResumed(TaskId(walk), True, "panel")).at(2.0)
    move = story.command("move", "planner", walk)
    story.say(facts.WaitBegan("planner", walk, TaskId(move), Moment.END_ACHIEVING)).at(5.0)
    (wait,) = next(kind for kind in waits(story.fold()) if kind.kind is WaitKind.RESUME).longest
    assert (wait.who, wait.start, wait.seconds) == ("walk {1}", 2.0, 3.0)
    assert wait.what.startswith("until it is resumed; suspended by panel at 1.000 s")


def test_advice_on_what_nobody_could_work_on() -> None:
    """On the critical path of the floor stands only its suspension; the drone waits beside it."""
    history = mopping("panel").fold()
    causes = Causes(history)
    path = critical_path(history, causes, history.tasks[1])
    suspended, drone = advice(history, causes, path, [], [], [], at_least=0.1)
    assert near(suspended.topic, suspended.saving, suspended.on_path) == (Topic.SUSPENDED, 6.0, 6.0)
    assert suspended.example == "mop floor {1} suspended by panel, from 3.000 s, 6 s"
    assert near(drone.topic, drone.saving, drone.on_path) == (Topic.HANDLER, 10.4, 0)
    assert drone.text == "'fly' waited once for a module that handles it, 10.4 s in all, and none ever came"
    assert drone.title == "Nobody handles 'fly'"


def test_who_only_asks_is_no_module_of_a_run() -> None:
    story = stepping()
    for name in ("tca top", "tca resume"):
        story.module(name).say(facts.ModuleLeft(name, "it said goodbye"))
    assert summary(story.fold()).modules == summary(stepping().fold()).modules == 3


def test_only_the_longest_are_told() -> None:
    story = Story().module("legs", "move")
    for number in range(30):
        story.at(10.0 * number).queued(move := story.command("move", "user"), "legs")
        story.at(10.0 * number + number / 10).delivered(move, "legs").returned(move)
    (kind,) = waits(story.fold(), at_most=3)
    assert (kind.number, [round(wait.seconds, 3) for wait in kind.longest]) == (29, [2.9, 2.8, 2.7])


def test_how_busy_resources_were() -> None:
    run = stepping().fold()
    legs, planner = uses(run, 1.0, 10.3)
    assert near(legs.name, legs.busy, legs.share) == ("legs", 6.0, 0.645161)
    assert near(planner.handled, planner.busy, planner.waiting) == (4, 3.3, 0)
    assert near(planner.queued, planner.queue_seconds, planner.longest_queue) == (1, 0.1, 1)


def test_a_resource_of_several_slots_and_one_that_was_locked() -> None:
    story = Story().module("map", "where").say(facts.ResourceChanged("map", "map", 2))
    ids = [story.at(1.0).received("where", MessageClass.QUERY, "x") for _ in range(2)]
    story.delivered(ids[0], "map").delivered(ids[1], "map").at(3.0).returned(ids[0]).at(5.0).returned(ids[1])
    story.at(6.0).say(facts.Claimed(50, "map", "map", False, "eye", 0)).at(7.0).say(facts.Granted(50))
    story.at(9.0).say(facts.ClaimEnded(50, "released"), facts.ResourceChanged("map", "map", 0))
    (use,) = uses(story.fold(), 1.0, 11.0)
    assert near(use.capacity, use.busy, use.share, use.locked) == (2, 6.0, 0.3, 2.0)


def test_a_lock_of_copies_lasts_for_each_while_it_is_there() -> None:
    story = Story().at(1.0).module("legs", "move").module("legs#2", "move", resource="legs")
    for number, name in enumerate(["legs", "legs#2"]):
        story.at(2.0 + number).delivered(move := story.command("move", "user"), name, "legs").at(2.5 + number).returned(
            move
        )
    story.at(4.0).say(facts.Claimed(50, "legs", "legs", False, "eye", 0), facts.Granted(50))
    story.at(5.0).say(facts.ModuleLeft("legs#2", "it said goodbye"))
    story.at(9.0).say(facts.ClaimEnded(50, "released"))
    assert {use.key[0]: round(use.locked, 6) for use in uses(story.fold(), 1.0, 11.0)} == {"legs": 5.0, "legs#2": 1.0}


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
