"""After a restart of central, attachments return, and an old number never names another task."""

import asyncio
import pickle
import queue
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import pytest
from module.real_central import SOON, until
from module.scripted_central import scripted_connection

from tca_module import (
    AttachmentRef,
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
from tca_module.sending.later_reply import LaterReply
from tca_module.session.epoch_numbers import with_epoch
from tca_module.testing import LocalCentral
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.headers import Register, Send, Unknown, Welcome
from tca_wire.points import Moment, Point, TaskId

pytestmark = pytest.mark.usefixtures("short_timeouts")

WALK = Goal("walk")
MOVE = Command("move", int)
CHECK = Command("check", int)
NOTE = Inform("note", int)
SLIP = Failure("slip", int)
RECOVER, REPLAN, STOP = (ExceptionHandler(name) for name in ("recover", "replan", "stop"))


class Robot:
    """Legs, and a program that watches over them. ``done`` has the actions of both."""

    def __init__(self, central: LocalCentral) -> None:
        self.central = central
        self.done: list[str] = []
        self.legs, self.safety = Module("legs", central), Module("safety", central)
        self.taps: list[AttachmentRef] = []

        @self.legs.handles(MOVE)
        def move(_: Task, leg: int) -> None:
            self.done.append(f"move {leg}")
            if leg < 0:
                raise SLIP(leg)

        @self.safety.handles(CHECK)
        def check(_: Task, leg: int) -> None:
            self.done.append(f"check {leg}")

        for handler in (RECOVER, REPLAN, STOP):
            self.safety.handles(handler)(self.fix)

    def fix(self, task: Task) -> None:
        self.done.append(task.message)
        if task.message != "stop":
            raise task.trouble.reissue()

    @contextmanager
    def running(self) -> Iterator[None]:
        with self.legs.running(), self.safety.running():
            yield

    def effects_of_move(self, leg: int, user: Client) -> list[str]:
        """Return the actions that a move causes now."""
        self.done.clear()
        user.command(MOVE, leg).wait(SOON)
        return self.done[:]


@pytest.fixture
def robot(central: LocalCentral) -> Robot:
    return Robot(central)


def restarted(central: LocalCentral, user: Client, epoch: str = "afresh") -> None:
    """Restart central, and wait until all modules are back."""
    central.restart(epoch)
    user.wait_until_handled(MOVE, CHECK, STOP, timeout=SOON)


def attached(user: Client) -> list[str]:
    attachments = user.status("attached")
    return [one["handler"] for one in attachments["exception_handlers"]] + [
        one["listener"] for one in attachments["wiretaps"]
    ]


def test_attachments_of_module_return_before_its_handlers(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    @robot.safety.at_start
    def begin(module: Module) -> None:
        module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)
        module.on_failure(SLIP, STOP, of=MOVE)

    with robot.running():
        assert robot.effects_of_move(1, user) == ["check 1", "move 1"]
        before = len(central.facts)
        restarted(central, user)
        assert robot.effects_of_move(2, user) == ["check 2", "move 2"]
        assert robot.effects_of_move(-1, user) == ["check -1", "move -1", "stop"]
        renewed = central.facts[before:]
        order = [
            type(fact)
            for fact in renewed
            if getattr(fact, "module", "") != "legs" and type(fact) in ATTACHING
        ]
    assert order[: order.index(facts.HandlerAdded)] == [facts.TapAdded, facts.Attached]


ATTACHING = (facts.TapAdded, facts.Attached, facts.HandlerAdded)


def test_attachments_of_handler_return_in_place_after_restart(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    """Every handler has a connection of its own. The module attaches again for all its handlers."""

    @robot.safety.at_start
    def begin(module: Module) -> None:
        module.on_failure(SLIP, STOP, of=MOVE)

    @robot.safety.handles(WALK)
    def walk(task: Task) -> None:
        task.on_failure(SLIP, RECOVER, of=MOVE)
        robot.taps.append(task.tap(Condition.BEFORE_HANDLING, MOVE, CHECK))

    @robot.safety.handles(NOTE)
    def remove_tap(_: Task, __: int) -> None:
        robot.taps[0].remove()
        robot.done.append("removed")

    with robot.running():
        assert user.goal(WALK).wait(SOON)
        assert robot.effects_of_move(-1, user) == ["check -1", "move -1", "recover", "stop"]
        restarted(central, user)
        assert robot.effects_of_move(-1, user) == ["check -1", "move -1", "recover", "stop"]
        user.inform(NOTE, 1)
        until(lambda: "removed" in robot.done, "the handler has removed its wiretap")
        assert robot.effects_of_move(-1, user) == ["move -1", "recover", "stop"]


def test_tapped_monitor_returns_with_its_parts_after_restart(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    steady = Query("steady?", reply=bool)
    watch = PollingMonitor("watch", condition=steady, action=Command("note it"))

    @robot.safety.at_start
    def begin(module: Module) -> None:
        module.on_failure(None, STOP, of=watch)
        module.tap(Condition.WHILE_HANDLING, MOVE, watch, period=0.5, maximum=3)

    with robot.running():
        before = user.status("attached")
        assert attached(user) == ["stop", "watch"]
        restarted(central, user)
        assert user.status("attached") == before


def test_restart_keeps_removals_and_renumbers_attachments(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    with robot.running():
        gone = user.on_failure(SLIP, RECOVER, of=MOVE)
        tap = user.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)
        gone.remove()
        before = tap.id
        restarted(central, user)
        assert attached(user) == ["check"]
        assert [one["id"] for one in user.status("attached")["wiretaps"]] == [tap.id] != [before]
        tap.remove()
        tap.remove()
        gone.remove()
        assert attached(user) == []
        restarted(central, user, "once more")
        assert attached(user) == []


def test_attachment_to_task_is_gone_after_restart(central: LocalCentral, user: Client) -> None:
    user.goal(WALK).on_failure(SLIP, RECOVER)
    central.restart("afresh")
    assert attached(user) == []


def test_attachment_detached_by_operator_returns_after_restart(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    """The module that attached the wiretap still needs it. The wiretap returns as after a restart
    of that module.
    """

    @robot.safety.at_start
    def begin(module: Module) -> None:
        robot.taps.append(module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK))

    with robot.running():
        assert user.detach(robot.taps[0].id)
        assert robot.effects_of_move(1, user) == ["move 1"]
        restarted(central, user)
        assert robot.effects_of_move(1, user) == ["check 1", "move 1"]


# --- A restarted central gives new messages the numbers of old ones -------------------------------


WORK = Command("work", str, result=str)
UNHANDLED, LAST = Query("nobody", reply=int), Query("last", reply=int)


def check_that_new_task_gets_own_answer(
    central: LocalCentral, user: Client, begun: "queue.Queue[str]"
) -> None:
    """Send the same work to the old central, and to the new one under the same number."""
    assert user.command(WORK, "old").id == 1
    old = begun.get(timeout=SOON)
    central.restart("afresh")
    user.wait_until_handled(WORK, timeout=SOON)
    new = user.command(WORK, "new")
    assert begun.get(timeout=SOON) == old.replace("old", "new")
    assert new.result(SOON) == "new"


def test_forgotten_coroutine_does_not_answer_new_task(central: LocalCentral, user: Client) -> None:
    module, begun, go_on = Module("worker", central), queue.Queue[str](), threading.Event()

    @module.handles(WORK)
    async def work(task: Task, data: str) -> str:
        begun.put(f"{data} {task.id}")
        if data == "old":
            with suppress(asyncio.CancelledError):
                await task.query_send(UNHANDLED)
            await asyncio.to_thread(go_on.wait, SOON)
        else:
            go_on.set()
            for _ in range(50):  # meanwhile the old handler returns
                await task.query_send(LAST)
        return data

    module.handles(LAST)(lambda _: 1)
    with module.running():
        check_that_new_task_gets_own_answer(central, user, begun)


def test_forgotten_later_reply_does_not_answer_new_task(
    central: LocalCentral, user: Client
) -> None:
    module, begun, owed = Module("worker", central), queue.Queue[str](), list[LaterReply[str]]()

    @module.handles(WORK)
    def work(task: Task, data: str) -> str | LaterReply[str]:
        begun.put(f"{data} {task.id}")
        if data == "old":
            owed.append(task.reply_later())
            return owed[0]
        owed[0].reply("old")
        task.query_send(LAST).receive(SOON)  # the reply leaves in this wait
        return data

    module.handles(LAST, resource="last")(lambda _: 1)
    with module.running():
        check_that_new_task_gets_own_answer(central, user, begun)


def test_forgotten_later_reply_reads_as_cancelled(central: LocalCentral, user: Client) -> None:
    module, owed = Module("worker", central), queue.Queue[LaterReply[str]]()

    @module.handles(WORK)
    def work(task: Task, _: str) -> LaterReply[str]:
        owed.put(later := task.reply_later())
        return later

    with module.running():
        assert user.command(WORK, "old").id == 1
        old = owed.get(timeout=SOON)
        central.restart("afresh")
        user.wait_until_handled(WORK, timeout=SOON)
        task = user.command(WORK, "new")
        new = owed.get(timeout=SOON)
        assert (old.cancelled, new.cancelled) == (True, False)
        new.reply("new")
        assert task.result(SOON) == "new"


def test_forgotten_task_is_cancelled_and_no_longer_suspended(
    central: LocalCentral, user: Client
) -> None:
    module, read, go_on = Module("worker", central), queue.Queue[bool](), threading.Event()

    @module.handles(WORK)
    def work(task: Task, data: str) -> str:
        until(lambda: task.suspended, "its task is suspended")
        read.put(True)
        go_on.wait(SOON)
        until(lambda: not task.suspended, "the suspension is over")
        read.put(task.cancelled and not task.suspended)
        return data

    with module.running():
        user.command(WORK, "old").suspend()
        assert read.get(timeout=SOON)
        central.restart("afresh")
        go_on.set()
        assert read.get(timeout=SOON)


# --- A restarted central gives tasks of strangers the numbers of forgotten ones -------------------


LABOUR, STRIDE, HALT, NOTICE = (
    Command("work", result=int),
    Goal("walk"),
    Command("stop"),
    Inform("note"),
)
STUCK, FREE = Failure("stuck"), ExceptionHandler("free")
IS_LOW = Query("is low", reply=bool)
BATTERY, CUPS = (
    PollingMonitor("battery", condition=IS_LOW, action=HALT),
    DemonMonitor("cups", action=HALT),
)
LEVEL = Variable("level", int)
PROBE = PointMonitor("check", condition=IS_LOW, action=HALT)


@dataclass
class Forgotten:
    """A program's handles of forgotten tasks, and a task that the program has sent since."""

    user: Client
    goal: SentTask[None]
    """The goal with number 1 of the old central."""
    task: SentTask[int]
    monitor: MonitorRef[Any]
    removal: AttachmentRef
    new: Callable[[], SentTask[int]]


CALLS: dict[str, Callable[[Forgotten], object]] = {
    # points
    "constrain successor": lambda forgotten: forgotten.user.constrain(
        forgotten.task.achieving.end <= forgotten.new().handling.start
    ),
    "constrain predecessor": lambda forgotten: forgotten.user.constrain(
        forgotten.new().achieving.end <= forgotten.task.handling.start
    ),
    "constrain with delay": lambda forgotten: forgotten.user.constrain(
        forgotten.task.achieving.end + 1 <= forgotten.new().handling.start
    ),
    "constrain without <=": lambda forgotten: forgotten.user.constrain(
        Constraint(forgotten.task.achieving.end, forgotten.new().achieving.start)
    ),
    "constrain both": lambda forgotten: forgotten.user.constrain(
        forgotten.goal.achieving.end <= forgotten.task.achieving.start
    ),
    "send successor": lambda forgotten: forgotten.user.command(
        LABOUR, constraints=[forgotten.task.achieving.end <= this.achieving.start]
    ),
    "kill after": lambda forgotten: forgotten.new().kill(after=forgotten.task.achieving.end),
    "wait for point": lambda forgotten: forgotten.new().wait_for(
        forgotten.task.handling.start, SOON
    ),
    "deadline for point": lambda forgotten: forgotten.new().deadline(
        3, forgotten.task.achieving.end
    ),
    "monitor until": lambda forgotten: forgotten.user.monitor(
        BATTERY, period=1, until=forgotten.task.achieving.end
    ),
    "monitor after": lambda forgotten: forgotten.user.monitor(
        PROBE, constraints=[forgotten.task.achieving.end <= this.achieving.start], sequential=False
    ),
    "tap until": lambda forgotten: forgotten.user.tap(
        Condition.WHILE_ACHIEVING, STRIDE, BATTERY, period=1, until=forgotten.task.achieving.end
    ),
    # handles
    "kill": lambda forgotten: forgotten.task.kill(),
    "wait": lambda forgotten: forgotten.task.wait(SOON),
    "result": lambda forgotten: forgotten.task.result(SOON),
    "deadline": lambda forgotten: forgotten.task.deadline(3),
    "fail": lambda forgotten: forgotten.task.fail(STUCK()),
    "retry": lambda forgotten: forgotten.task.retry(),
    "suspend": lambda forgotten: forgotten.task.suspend(),
    "resume": lambda forgotten: forgotten.task.resume(),
    "keep": lambda forgotten: forgotten.task.keep(),
    "release": lambda forgotten: forgotten.task.release(),
    "info": lambda forgotten: forgotten.task.info(),
    "children": lambda forgotten: forgotten.goal.children(),
    "on failure": lambda forgotten: forgotten.task.on_failure(STUCK, FREE),
    "on failure of": lambda forgotten: forgotten.user.on_failure(STUCK, FREE, of=forgotten.task),
    "on termination": lambda forgotten: forgotten.task.on_termination(HALT),
    "tap": lambda forgotten: forgotten.user.tap(Condition.AFTER_ACHIEVED, forgotten.task, NOTICE),
    "fire": lambda forgotten: forgotten.monitor.fire(HALT),
    "end": lambda forgotten: forgotten.monitor.end(),
    # tasks sent under a forgotten goal
    "subcommand": lambda forgotten: forgotten.user.under(forgotten.goal).command(LABOUR),
    "subgoal": lambda forgotten: forgotten.user.under(forgotten.goal).goal(STRIDE),
    "submonitor": lambda forgotten: forgotten.user.under(forgotten.goal).monitor(BATTERY, period=1),
    # numbers of forgotten tasks
    "number": lambda forgotten: forgotten.user.task(forgotten.task.id),
    "copied number": lambda forgotten: forgotten.user.task(
        pickle.loads(pickle.dumps(forgotten.task.id))
    ),
}


LOST = (
    r"^(walk|work|cups) \{[123]\} is lost: central was restarted and has forgotten its tree; "
    "send it again$"
)


def send_tasks(user: Client) -> Forgotten:
    goal, task = user.goal(STRIDE), user.command(LABOUR)
    monitor = user.monitor(CUPS, waited_for=True)
    removal = task.on_failure(STUCK, FREE)
    return Forgotten(
        user, goal, task, monitor, removal, lambda: user.command(LABOUR, sequential=False)
    )


def add_tasks_of_stranger(central: LocalCentral, stranger: Client) -> None:
    """Send tasks of another client, which get the same numbers."""
    for _ in range(4):
        stranger.goal(STRIDE, sequential=False)
    stranger.tasks(STRIDE)[0].on_failure(STUCK, FREE)
    assert [task.id for task in stranger.tasks()] == [1, 2, 3, 4]
    assert central.core.epoch == "two"


def state_of(stranger: Client) -> tuple[Any, Any]:
    return [task.info() for task in stranger.tasks(STRIDE)], stranger.status("attached")


@pytest.mark.parametrize("has_heard", [True, False], ids=["known", "unheard"])
@pytest.mark.parametrize("call", CALLS)
def test_call_on_forgotten_task_raises_and_harms_no_stranger(
    central: LocalCentral, user: Client, call: str, *, has_heard: bool
) -> None:
    forgotten = send_tasks(user)
    central.restart("two")
    with connect("stranger", central) as stranger:
        add_tasks_of_stranger(central, stranger)
        before = state_of(stranger)
        if has_heard:
            user.modules()
            new = forgotten.new()
            forgotten.new = lambda: new
        with pytest.raises(CentralLost, match=LOST):
            CALLS[call](forgotten)
        assert state_of(stranger) == before


def test_removing_forgotten_attachment_harms_no_stranger(
    central: LocalCentral, user: Client
) -> None:
    forgotten = send_tasks(user)
    central.restart("two")
    with connect("stranger", central) as stranger:
        add_tasks_of_stranger(central, stranger)
        before = state_of(stranger)
        forgotten.removal.remove()
        user.modules()
        forgotten.removal.remove()
        assert state_of(stranger) == before


HANDLERS_CALLS: dict[str, Callable[[Task], object]] = {
    "command": lambda task: task.command(HALT),
    "inform": lambda task: task.inform(NOTICE),
    "query": lambda task: task.query(IS_LOW),
    "lock": lambda task: task.lock("legs"),
    "variable": lambda task: task.set_variable(LEVEL, 1),
    "own point": lambda task: task.constrain(task.achieving.end <= task.ref.achieving.end),
    "own ref": lambda task: task.ref.kill(),
}


@pytest.mark.parametrize("call", HANDLERS_CALLS)
def test_handler_of_forgotten_task_cannot_send(
    central: LocalCentral, user: Client, legs: Module, call: str
) -> None:
    begun, go_on, raised = threading.Event(), threading.Event(), queue.Queue[BaseException]()

    @legs.handles(STRIDE)
    def walk(task: Task) -> None:
        begun.set()
        go_on.wait(SOON)
        with pytest.raises(CentralLost) as lost:
            HANDLERS_CALLS[call](task)
        raised.put(lost.value)

    with legs.running(), connect("stranger", central) as stranger:
        assert user.goal(STRIDE).id == 1
        assert begun.wait(SOON)
        central.restart("two")
        stranger.modules()
        strangers = [stranger.command(LABOUR, sequential=False) for _ in range(3)]
        go_on.set()
        text = str(raised.get(timeout=SOON))
        assert re.search(LOST, text)
        assert "walk {1}" in text
        assert [task.id for task in stranger.tasks()] == [task.id for task in strangers]


def test_client_unaware_of_restart_may_name_new_foreign_tasks(
    central: LocalCentral, user: Client
) -> None:
    first = user.command(LABOUR)
    assert first.id == 1
    central.restart("two")
    with connect("other", central) as other:
        second = other.command(LABOUR)
        third = other.command(LABOUR, sequential=False)
        assert (second.id, third.id) == (1, 2)
        user.constrain(second.achieving.end <= third.handling.start)
        user.command(HALT, constraints=[third.achieving.end <= this.handling.start])
    with pytest.raises(CentralLost, match=r"work \{1\} is lost"):
        first.kill()


def test_monitor_is_not_ordered_after_forgotten_sibling(
    central: LocalCentral, user: Client
) -> None:
    with user.parallel():
        user.command(LABOUR)
    with user.sequence():
        assert user.command(LABOUR).id == 2
        central.restart("two")
        with connect("stranger", central) as stranger:
            add_tasks_of_stranger(central, stranger)
            user.modules()
            check = user.monitor(PROBE)
            info = check.info()
            assert info is not None
            assert info.held == {}


def test_task_numbers_and_points_travel_as_plain_data(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    which, until = Command("which", int, result=int), Command("until", Point, result=str)
    legs.handles(which)(lambda _, number: number)
    legs.handles(until)(lambda task, point: str(task.task(point.task)))
    with legs.running():
        task = user.command(LABOUR)
        assert user.command(which, task.id, sequential=False).result(SOON) == task.id == 1
        assert user.command(until, task.achieving.end, sequential=False).result(SOON) == "work {1}"
        assert f"{task.id} {task.id!r} {task.id:03d}" == "1 1 001"


def test_request_naming_forgotten_number_is_lost() -> None:
    connection, central = scripted_connection()
    task, delivery = with_epoch(TaskId(3), "one", "walk {3}"), with_epoch(8, "one", "walk {3}")
    central.deliver(Unknown(), Welcome(1, 1, "legs", "two"))
    with pytest.raises(
        CentralLost, match=r"walk \{3\} is lost: central was restarted and has forgotten its tree; "
    ):
        connection.call(
            Send(0, "walk", parent=task), "goal 'walk'"
        )  # this call learns of the restart
    with pytest.raises(CentralLost, match=r"walk \{3\} is lost"):
        connection.post(Send(0, "position", origin=delivery), b"")
    with pytest.raises(CentralLost, match=r"walk \{3\} is lost"):
        connection.request(
            headers.AwaitPoint(0, Point(task, Moment.END_ACHIEVING)), wants_answer=True
        )
    assert {type(header) for header in central.received} == {Register}
