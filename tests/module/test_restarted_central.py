"""Central was restarted: what was attached is there again, and old numbers mean nobody's tasks."""

import asyncio
import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
from module.real_central import SOON, until

from tca_module import (
    AttachmentRef,
    Client,
    Command,
    Condition,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    Module,
    PollingMonitor,
    Query,
    Task,
)
from tca_module.sending.later_reply import LaterReply
from tca_module.testing import LocalCentral
from tca_wire.journal import facts

pytestmark = pytest.mark.usefixtures("attentive")

WALK = Goal("walk")
MOVE = Command("move", int)
CHECK = Command("check", int)
NOTE = Inform("note", int)
SLIP = Failure("slip", int)
RECOVER, REPLAN, STOP = (ExceptionHandler(name) for name in ("recover", "replan", "stop"))


class Robot:
    """Legs, and a program that watches over them; what both did."""

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

    def moves(self, leg: int, user: Client) -> list[str]:
        """What a move brings about now."""
        self.done.clear()
        user.command(MOVE, leg).wait(SOON)
        return self.done[:]


@pytest.fixture
def robot(central: LocalCentral) -> Robot:
    return Robot(central)


def restarted(central: LocalCentral, user: Client, epoch: str = "afresh") -> None:
    """Central has been restarted, and all modules are back."""
    central.restart(epoch)
    user.wait_until_handled(MOVE, CHECK, STOP, timeout=SOON)


def attached(user: Client) -> list[str]:
    known = user.status("attached")
    return [one["handler"] for one in known["exception_handlers"]] + [one["listener"] for one in known["wiretaps"]]


def test_moves_are_checked_as_before_and_whoever_sees_the_check_handled_may_rely_on_it(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    @robot.safety.at_start
    def begin(module: Module) -> None:
        module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK)
        module.on_failure(SLIP, STOP, of=MOVE)

    with robot.running():
        assert robot.moves(1, user) == ["check 1", "move 1"]
        before = len(central.facts)
        restarted(central, user)
        assert robot.moves(2, user) == ["check 2", "move 2"]
        assert robot.moves(-1, user) == ["check -1", "move -1", "stop"]
        anew = central.facts[before:]
        order = [type(fact) for fact in anew if getattr(fact, "module", "") != "legs" and type(fact) in ATTACHING]
    assert order[: order.index(facts.HandlerAdded)] == [facts.TapAdded, facts.Attached]


ATTACHING = (facts.TapAdded, facts.Attached, facts.HandlerAdded)


def test_what_a_handler_has_attached_is_there_again_in_its_place(
    central: LocalCentral, robot: Robot, user: Client
) -> None:
    """Every handler has a connection of its own; the module attaches for all of them."""

    @robot.safety.at_start
    def begin(module: Module) -> None:
        module.on_failure(SLIP, STOP, of=MOVE)

    @robot.safety.handles(WALK)
    def walk(task: Task) -> None:
        task.on_failure(SLIP, RECOVER, of=MOVE)
        robot.taps.append(task.tap(Condition.BEFORE_HANDLING, MOVE, CHECK))

    @robot.safety.handles(NOTE)
    def note(_: Task, __: int) -> None:
        robot.taps[0].remove()
        robot.done.append("removed")

    with robot.running():
        assert user.goal(WALK).wait(SOON)
        assert robot.moves(-1, user) == ["check -1", "move -1", "recover", "stop"]
        restarted(central, user)
        assert robot.moves(-1, user) == ["check -1", "move -1", "recover", "stop"]
        user.inform(NOTE, 1)
        until(lambda: "removed" in robot.done, "the handler has removed its wiretap")
        assert robot.moves(-1, user) == ["move -1", "recover", "stop"]


def test_monitors_are_declared_with_their_parts_and_listen_as_before(
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


def test_what_was_removed_is_not_attached_anew_and_a_handle_goes_on_under_the_new_number(
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


def test_what_was_attached_to_a_task_is_gone_with_it(central: LocalCentral, user: Client) -> None:
    user.goal(WALK).on_failure(SLIP, RECOVER)
    central.restart("afresh")
    assert attached(user) == []


def test_what_an_operator_took_away_is_there_again(central: LocalCentral, robot: Robot, user: Client) -> None:
    """Whoever attached it wants it still: as after a restart of that module."""

    @robot.safety.at_start
    def begin(module: Module) -> None:
        robot.taps.append(module.tap(Condition.BEFORE_HANDLING, MOVE, CHECK))

    with robot.running():
        assert user.detach(robot.taps[0].id)
        assert robot.moves(1, user) == ["move 1"]
        restarted(central, user)
        assert robot.moves(1, user) == ["check 1", "move 1"]


# --- before the handlers ---------------------------------------------------------------------------------------------


# --- A restarted central gives its first messages the numbers of old ones --------------------------------------------


WORK = Command("work", str, result=str)
NOBODY, LAST = Query("nobody", reply=int), Query("last", reply=int)


def the_new_one_has_the_number_and_its_own_answer(
    central: LocalCentral, user: Client, begun: "queue.Queue[str]"
) -> None:
    """The same work once in the old central, and in the new one under the same number."""
    user.command(WORK, "old")
    old = begun.get(timeout=SOON)
    central.restart("afresh")
    user.wait_until_handled(WORK, timeout=SOON)
    new = user.command(WORK, "new")
    assert begun.get(timeout=SOON) == old.replace("old", "new")
    assert new.result(SOON) == "new"


def test_a_coroutine_that_cleans_up_does_not_answer_for_a_new_one(central: LocalCentral, user: Client) -> None:
    module, begun, go_on = Module("worker", central), queue.Queue[str](), threading.Event()

    @module.handles(WORK)
    async def work(task: Task, data: str) -> str:
        begun.put(f"{data} {task.id}")
        if data == "old":
            with suppress(asyncio.CancelledError):
                await task.query_send(NOBODY)
            await asyncio.to_thread(go_on.wait, SOON)
        else:
            go_on.set()
            for _ in range(50):  # while the old one returns
                await task.query_send(LAST)
        return data

    module.handles(LAST)(lambda _: 1)
    with module.running():
        the_new_one_has_the_number_and_its_own_answer(central, user, begun)


def test_an_answer_that_was_owed_to_the_old_central_is_not_given_to_the_new_one(
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
        task.query_send(LAST).receive(SOON)  # in this wait it leaves
        return data

    module.handles(LAST, resource="last")(lambda _: 1)
    with module.running():
        the_new_one_has_the_number_and_its_own_answer(central, user, begun)


def test_who_owes_an_answer_to_the_old_central_reads_that_it_is_void(central: LocalCentral, user: Client) -> None:
    module, owed = Module("worker", central), queue.Queue[LaterReply[str]]()

    @module.handles(WORK)
    def work(task: Task, _: str) -> LaterReply[str]:
        owed.put(later := task.reply_later())
        return later

    with module.running():
        user.command(WORK, "old")
        old = owed.get(timeout=SOON)
        central.restart("afresh")
        user.wait_until_handled(WORK, timeout=SOON)
        task = user.command(WORK, "new")
        new = owed.get(timeout=SOON)
        assert (old.cancelled, new.cancelled) == (True, False)
        new.reply("new")
        assert task.result(SOON) == "new"


def test_a_handler_that_holds_while_its_task_is_suspended_holds_no_forgotten_one(
    central: LocalCentral, user: Client
) -> None:
    module, read, go_on = Module("worker", central), queue.Queue[bool](), threading.Event()

    @module.handles(WORK)
    def work(task: Task, data: str) -> str:
        until(lambda: task.suspended, "its task is suspended")
        read.put(True)
        go_on.wait(SOON)
        until(lambda: not task.suspended, "it holds no longer")
        read.put(task.cancelled and not task.suspended)
        return data

    with module.running():
        user.command(WORK, "old").suspend()
        assert read.get(timeout=SOON)
        central.restart("afresh")
        go_on.set()
        assert read.get(timeout=SOON)
