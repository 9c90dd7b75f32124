"""A restarted central gives strangers' tasks the numbers of forgotten ones: whatever one has of those never means these.

Each way in which a program names a task is tried with a task that is forgotten, when the program has heard of the
restart already, and when it hears of it only in that call.
"""

import pickle
import queue
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from module.real_central import SOON
from module.test_connection import connected

from tca_module import (
    CentralLost,
    Client,
    Command,
    Condition,
    Constraint,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    Module,
    PointMonitor,
    PollingMonitor,
    Query,
    SentTask,
    Task,
    Variable,
    connect,
    this,
)
from tca_module.sending.delivery_context import MonitorRef
from tca_module.sending.task_ref import AttachmentRef
from tca_module.session.epoch_numbers import with_epoch
from tca_module.testing import LocalCentral
from tca_wire.packets import headers
from tca_wire.packets.headers import Register, Send, Unknown, Welcome
from tca_wire.points import Moment, Point, TaskId

WORK, WALK, STOP, NOTE = Command("work", result=int), Goal("walk"), Command("stop"), Inform("note")
STUCK, FREE = Failure("stuck"), ExceptionHandler("free")
IS_LOW = Query("is low", reply=bool)
BATTERY, CUPS = PollingMonitor("battery", condition=IS_LOW, action=STOP), DemonMonitor("cups", action=STOP)
LEVEL = Variable("level", int)
CHECK = PointMonitor("check", condition=IS_LOW, action=STOP)


@dataclass
class Had:
    """What a program still has of tasks that were forgotten, and a task that it sent since."""

    user: Client
    goal: SentTask[None]
    """Number 1 of the old central."""
    task: SentTask[int]
    monitor: MonitorRef[Any]
    removal: AttachmentRef
    new: Callable[[], SentTask[int]]


CALLS: dict[str, Callable[[Had], object]] = {
    # points
    "constrain what comes after it": lambda had: had.user.constrain(had.task.achieving.end <= had.new().handling.start),
    "constrain it": lambda had: had.user.constrain(had.new().achieving.end <= had.task.handling.start),
    "constrain, later": lambda had: had.user.constrain(had.task.achieving.end + 1 <= had.new().handling.start),
    "constrain without <=": lambda had: had.user.constrain(
        Constraint(had.task.achieving.end, had.new().achieving.start)
    ),
    "constrain two of them": lambda had: had.user.constrain(had.goal.achieving.end <= had.task.achieving.start),
    "send after it": lambda had: had.user.command(WORK, constraints=[had.task.achieving.end <= this.achieving.start]),
    "kill after it": lambda had: had.new().kill(after=had.task.achieving.end),
    "wait for its point": lambda had: had.new().wait_for(had.task.handling.start, SOON),
    "a deadline for its point": lambda had: had.new().deadline(3, had.task.achieving.end),
    "watch until it ends": lambda had: had.user.monitor(BATTERY, period=1, until=had.task.achieving.end),
    "watch after it": lambda had: had.user.monitor(
        CHECK, constraints=[had.task.achieving.end <= this.achieving.start], sequential=False
    ),
    "listen until it ends": lambda had: had.user.tap(
        Condition.WHILE_ACHIEVING, WALK, BATTERY, period=1, until=had.task.achieving.end
    ),
    # handles
    "kill": lambda had: had.task.kill(),
    "wait": lambda had: had.task.wait(SOON),
    "result": lambda had: had.task.result(SOON),
    "deadline": lambda had: had.task.deadline(3),
    "fail": lambda had: had.task.fail(STUCK()),
    "retry": lambda had: had.task.retry(),
    "suspend": lambda had: had.task.suspend(),
    "resume": lambda had: had.task.resume(),
    "keep": lambda had: had.task.keep(),
    "release": lambda had: had.task.release(),
    "info": lambda had: had.task.info(),
    "children": lambda had: had.goal.children(),
    "on failure": lambda had: had.task.on_failure(STUCK, FREE),
    "on failure of": lambda had: had.user.on_failure(STUCK, FREE, of=had.task),
    "on termination": lambda had: had.task.on_termination(STOP),
    "tap": lambda had: had.user.tap(Condition.AFTER_ACHIEVED, had.task, NOTE),
    "fire": lambda had: had.monitor.fire(STOP),
    "end": lambda had: had.monitor.end(),
    # what is sent under it
    "a command under it": lambda had: had.user.under(had.goal).command(WORK),
    "a goal under it": lambda had: had.user.under(had.goal).goal(WALK),
    "a monitor under it": lambda had: had.user.under(had.goal).monitor(BATTERY, period=1),
    # its number
    "by its number": lambda had: had.user.task(had.task.id),
    "by a copy of its number": lambda had: had.user.task(pickle.loads(pickle.dumps(had.task.id))),
}


LOST = (
    r"^(walk|work|cups) \{[123]\} is lost: central was restarted and has forgotten its tree; "
    "send it again$"
)


def had_by(user: Client) -> Had:
    goal, task = user.goal(WALK), user.command(WORK)
    monitor = user.monitor(CUPS, for_ever=True)
    removal = task.on_failure(STUCK, FREE)
    return Had(user, goal, task, monitor, removal, lambda: user.command(WORK, sequential=False))


def strangers_in(central: LocalCentral, stranger: Client) -> None:
    """Tasks of somebody else with the same numbers."""
    for _ in range(4):
        stranger.goal(WALK, sequential=False)
    stranger.tasks(WALK)[0].on_failure(STUCK, FREE)
    assert [task.id for task in stranger.tasks()] == [1, 2, 3, 4]
    assert central.core.epoch == "two"


def state_of(stranger: Client) -> tuple[Any, Any]:
    return [task.info() for task in stranger.tasks(WALK)], stranger.status("attached")


@pytest.mark.parametrize("has_heard", [True, False], ids=["known", "unheard"])
@pytest.mark.parametrize("call", CALLS)
def test_a_forgotten_task_is_nobody_elses(central: LocalCentral, user: Client, call: str, *, has_heard: bool) -> None:
    had = had_by(user)
    central.restart("two")
    with connect("stranger", central) as stranger:
        strangers_in(central, stranger)
        before = state_of(stranger)
        if has_heard:
            user.modules()
            new = had.new()
            had.new = lambda: new
        with pytest.raises(CentralLost, match=LOST):
            CALLS[call](had)
        assert state_of(stranger) == before


def test_what_was_attached_to_it_is_not_removed_from_others(central: LocalCentral, user: Client) -> None:
    had = had_by(user)
    central.restart("two")
    with connect("stranger", central) as stranger:
        strangers_in(central, stranger)
        before = state_of(stranger)
        had.removal.remove()
        user.modules()
        had.removal.remove()
        assert state_of(stranger) == before


HANDLERS_CALLS: dict[str, Callable[[Task], object]] = {
    "command": lambda task: task.command(STOP),
    "inform": lambda task: task.inform(NOTE),
    "query": lambda task: task.query(IS_LOW),
    "lock": lambda task: task.lock("legs"),
    "variable": lambda task: task.set_variable(LEVEL, 1),
    "its own point": lambda task: task.constrain(task.achieving.end <= task.ref.achieving.end),
    "its handle": lambda task: task.ref.kill(),
}


@pytest.mark.parametrize("call", HANDLERS_CALLS)
def test_a_handler_of_a_forgotten_task_sends_nothing_as_anothers(
    central: LocalCentral, user: Client, legs: Module, call: str
) -> None:
    begun, go_on, raised = threading.Event(), threading.Event(), queue.Queue[BaseException]()

    @legs.handles(WALK)
    def walk(task: Task) -> None:
        begun.set()
        go_on.wait(SOON)
        with pytest.raises(CentralLost) as lost:
            HANDLERS_CALLS[call](task)
        raised.put(lost.value)

    with legs.running(), connect("stranger", central) as stranger:
        user.goal(WALK)
        assert begun.wait(SOON)
        central.restart("two")
        stranger.modules()
        strangers = [stranger.command(WORK, sequential=False) for _ in range(3)]
        go_on.set()
        text = str(raised.get(timeout=SOON))
        assert re.search(LOST, text)
        assert "walk {1}" in text
        assert [task.id for task in stranger.tasks()] == [task.id for task in strangers]


def test_what_others_made_is_known_to_who_has_not_heard_of_the_restart(central: LocalCentral, user: Client) -> None:
    first = user.command(WORK)
    central.restart("two")
    with connect("other", central) as other:
        second = other.command(WORK)
        third = other.command(WORK, sequential=False)
        assert (first.id, second.id, third.id) == (1, 1, 2)
        user.constrain(second.achieving.end <= third.handling.start)
        user.command(STOP, constraints=[third.achieving.end <= this.handling.start])
    with pytest.raises(CentralLost, match=r"work \{1\} is lost"):
        first.kill()


def test_monitors_follow_no_forgotten_sibling(central: LocalCentral, user: Client) -> None:
    with user.parallel():
        user.command(WORK)
    with user.sequence():
        user.command(WORK)
        central.restart("two")
        with connect("stranger", central) as stranger:
            strangers_in(central, stranger)
            user.modules()
            check = user.monitor(CHECK)
            info = check.info()
            assert info is not None
            assert info.held == {}


def test_numbers_and_points_travel_as_data_and_are_plain_then(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    which, until = Command("which", int, result=int), Command("until", Point, result=str)
    legs.handles(which)(lambda _, number: number)
    legs.handles(until)(lambda task, point: str(task.task(point.task)))
    with legs.running():
        task = user.command(WORK)
        assert user.command(which, task.id, sequential=False).result(SOON) == task.id == 1
        assert user.command(until, task.achieving.end, sequential=False).result(SOON) == "work {1}"
        assert f"{task.id} {task.id!r} {task.id:03d}" == "1 1 001"


def test_a_number_of_the_old_central_is_known_as_one_whatever_says_it() -> None:
    connection, central = connected()
    task, delivery = with_epoch(TaskId(3), "one", "walk {3}"), with_epoch(8, "one", "walk {3}")
    central.say(Unknown(), Welcome(1, 1, "legs", "two"))
    with pytest.raises(CentralLost, match=r"walk \{3\} is lost: central was restarted and has forgotten its tree; "):
        connection.call(Send(0, "walk", parent=task), "goal 'walk'")  # by this call it is known
    with pytest.raises(CentralLost, match=r"walk \{3\} is lost"):
        connection.post(Send(0, "position", origin=delivery), b"")
    with pytest.raises(CentralLost, match=r"walk \{3\} is lost"):
        connection.request(headers.AwaitPoint(0, Point(task, Moment.END_ACHIEVING)), wants_answer=True)
    assert {type(header) for header in central.heard} == {Register}
