"""A handler whose work is void is woken once from any wait. It may then clean up. The tests use
real sockets.
"""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from inspect import iscoroutinefunction
from pathlib import Path
from typing import Any

import pytest
from module.real_central import SOON, RealCentral, until

from tca_module import (
    Client,
    Command,
    Goal,
    Module,
    MultiQuery,
    Outcome,
    Query,
    SentTask,
    Stopped,
    Task,
    TaskFailed,
    TaskKilled,
    connect,
)
from tca_wire.journal.facts import Failed, Returned

pytestmark = pytest.mark.usefixtures("short_timeouts")


ASK = Goal("ask", str)
NEVER, UNHANDLED = Command("never"), Query("nobody", reply=int)
BUSY = Query("busy", reply=int)
BIDS = MultiQuery("bids", reply=int)
HERE = Query("here", reply=str)

WAITS: dict[str, Callable[[Task], object]] = {
    "query": lambda task: task.query(UNHANDLED, timeout=None),
    "query with its usual timeout": lambda task: task.query(UNHANDLED, timeout=1000),
    "receive": lambda task: task.query_send(UNHANDLED).receive(None),
    "multi-query": lambda task: task.multi_query(BIDS, timeout=None),
    "multi-query, one by one": lambda task: next(task.multi_query_send(BIDS, timeout=None)),
    "execute": lambda task: task.execute(BUSY),
    "execute if handled": lambda task: task.execute_if_handled(BUSY),
    "a stranger's task": lambda task: task.tasks(NEVER)[0].wait(),
    "a stranger's point": lambda task: task.tasks(NEVER)[0].wait_for(
        task.tasks(NEVER)[0].handling.end
    ),
    "subtask": lambda task: task.command(NEVER).wait(),
    "result": lambda task: task.command(NEVER).result(),
    "lock": lambda task: task.lock("arm"),
    "reserve": lambda task: task.reserve("arm", timeout=1000),
    "until handled": lambda task: task.wait_until_handled(NEVER),
    "callback": lambda task: task.query_notify(UNHANDLED, None, lambda *_: None).wait(),
}


class Robot:
    """A handler that waits in each way, and modules that let it wait. ``seen`` holds the exception
    of its wait, and the answer to its query afterwards.
    """

    def __init__(self, folder: Path) -> None:
        self.central = RealCentral(f"ipc://{folder}/central.sock")
        self.legs, self.slow = (
            Module("legs", self.central.address),
            Module("slow", self.central.address),
        )
        self.seen = queue.Queue[tuple[type[BaseException] | None, str]]()
        self.asked = threading.Event()
        self.go_on = threading.Event()
        self.slow.resource("arm")
        self.slow.resource("here")
        for number, message in enumerate((BUSY, BIDS)):
            self.slow.handles(message, resource=f"slow {number}")(self.hang)
        self.slow.handles(Command("hold"), resource="arm")(lambda _: None)
        self.slow.handles(HERE, resource="here")(lambda _: "at home")
        self.legs.handles(ASK)(self.ask)

    def hang(self, _: Task) -> int:
        self.asked.set()
        assert self.go_on.wait(SOON)
        return 1

    def ask(self, task: Task, how: str) -> None:
        try:
            WAITS[how](task)
        except (TaskKilled, Stopped) as error:
            self.seen.put((type(error), task.query(HERE)))
            raise
        self.seen.put((None, ""))

    @contextmanager
    def running(self) -> Iterator[Client]:
        with ExitStack() as stack:
            stack.callback(self.central.close)
            user = stack.enter_context(connect("user", self.central.address))
            stack.enter_context(self.slow.running())
            stack.callback(self.go_on.set)
            stack.enter_context(connect("other", self.central.address)).lock("arm")
            user.command(NEVER, sequential=False)
            yield user

    @contextmanager
    def working(self, handler: Callable[[Task], Any]) -> Iterator[SentTask[None]]:
        """Send a command that the legs handle with *handler*. Yield the command when the handler
        has begun.
        """
        work, begun = Command("work"), threading.Event()

        def begin(task: Task) -> Any:
            begun.set()
            return handler(task)

        async def begin_coroutine(task: Task) -> None:
            await begin(task)

        self.legs.handles(work, resource="wheels")(
            begin_coroutine if iscoroutinefunction(handler) else begin
        )
        with self.running() as user, self.legs.running():
            working = user.command(work, sequential=False)
            assert begun.wait(SOON)
            yield working

    def until_waiting(self) -> None:
        """Wait until the handler waits."""
        until(lambda: self.central.open_requests_of("legs"), "the handler waits")


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path)


@pytest.mark.parametrize("how", WAITS)
def test_kill_wakes_waiting_handler_and_gives_up_its_request(
    robot: Robot, how: str, caplog: pytest.LogCaptureFixture
) -> None:
    with robot.running() as user, robot.legs.running():
        asking = user.goal(ASK, how, sequential=False)
        robot.until_waiting()
        asking.kill("enough")
        assert asking.wait(SOON) is Outcome.KILLED
        assert robot.seen.get(timeout=SOON) == (TaskKilled, "at home")
        until(lambda: not robot.central.open_requests_of("legs"), "no request of the legs is open")
    assert not robot.central.facts(Failed)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


@pytest.mark.parametrize("how", WAITS)
def test_module_end_wakes_waiting_handler(robot: Robot, how: str) -> None:
    with robot.running() as user:
        with robot.legs.running():
            asking = user.goal(ASK, how, sequential=False)
            robot.until_waiting()
        assert robot.seen.get(timeout=SOON) == (Stopped, "at home")
        with pytest.raises(TaskFailed, match="module lost"):
            asking.result(SOON)


@pytest.mark.parametrize("how", ["query", "lock", "a stranger's task", "until handled"])
def test_retry_wakes_waiting_handler(robot: Robot, how: str) -> None:
    with robot.running() as user, robot.legs.running():
        asking = user.goal(ASK, how, sequential=False)
        for _ in range(2):
            robot.until_waiting()
            asking.retry()
            assert robot.seen.get(timeout=SOON) == (TaskKilled, "at home")
            until(
                lambda: (info := asking.info()) is not None and info.module,
                "the task is handled again",
            )
        robot.until_waiting()
        asking.kill()
        assert asking.wait(SOON) is Outcome.KILLED


def test_woken_handler_learns_reason(robot: Robot) -> None:
    reasons, begun = queue.Queue[str](), queue.Queue[None]()

    def work(task: Task) -> None:
        begun.put(None)
        try:
            task.query(UNHANDLED, timeout=None)
        except TaskKilled as error:
            reasons.put(str(error))
            raise

    with robot.working(work) as working:
        robot.until_waiting()
        working.retry()
        again = f"{working} was killed: it is to be handled again; query 'nobody' is given up"
        assert reasons.get(timeout=SOON) == again
        for _ in range(2):
            begun.get(timeout=SOON)
        robot.until_waiting()
        working.kill("the floor is wet")
        killed = f"{working} was killed: the floor is wet (by user); query 'nobody' is given up"
        assert reasons.get(timeout=SOON) == killed
        with pytest.raises(TaskKilled) as found:
            working.result(SOON)
        assert found.value.why == "the floor is wet (by user)"


# --- A handler is woken once ----------------------------------------------------------------------


def test_kill_of_busy_handler_ends_its_next_wait(robot: Robot) -> None:
    killed = threading.Event()

    def work(task: Task) -> None:
        assert killed.wait(SOON)
        robot.ask(task, "query")

    with robot.working(work) as working:
        working.kill()
        killed.set()
        assert robot.seen.get(timeout=SOON) == (TaskKilled, "at home")


def test_handler_that_saw_cancellation_is_not_woken(robot: Robot) -> None:
    def work(task: Task) -> None:
        while not task.cancelled:
            pass
        robot.seen.put((None, task.query(HERE)))

    with robot.working(work) as working:
        working.kill()
        assert robot.seen.get(timeout=SOON) == (None, "at home")


def test_module_end_wakes_killed_handler_that_waits_again(
    robot: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    """The module's end is a second reason to wake the handler. The handler's task was killed, so it
    has not failed.
    """

    def work(task: Task) -> None:
        try:
            task.query(UNHANDLED, timeout=None)
        except TaskKilled:
            robot.seen.put((TaskKilled, ""))
            task.wait_until_handled(NEVER)

    with robot.working(work) as working:
        robot.until_waiting()
        working.kill()
        assert robot.seen.get(timeout=SOON) == (TaskKilled, "")
        robot.until_waiting()
    assert [fact.outcome for fact in robot.central.facts(Returned) if fact.id == working.id] == [
        Outcome.DONE
    ]
    assert not robot.central.facts(Failed)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_abandoned_replies_are_over_after_kill(robot: Robot) -> None:
    reasons = queue.Queue[object]()

    def work(task: Task) -> None:
        pending, bids = task.query_send(UNHANDLED), task.multi_query_send(BIDS, timeout=None)
        with pytest.raises(TaskKilled):
            next(bids)
        reasons.put(list(bids))
        reasons.put(task.cancelled)
        pending.cancel()

    with robot.working(work) as working:
        assert robot.asked.wait(SOON)
        working.kill()
        assert (reasons.get(timeout=SOON), reasons.get(timeout=SOON)) == ([], True)


# --- Other waits are not disturbed ----------------------------------------------------------------


def test_kill_does_not_wake_nested_handler(robot: Robot) -> None:
    """The inner handler works for its own message. The outer handler is woken only after the inner
    one.
    """
    inner, answered = Query("inner", reply=str), threading.Event()

    @robot.legs.handles(inner, resource="wheels")
    def answer(task: Task) -> str:
        assert task.query(BUSY, timeout=SOON) == 1
        answered.set()
        return ""

    with robot.working(lambda task: task.query(inner, timeout=None)) as working:
        assert robot.asked.wait(SOON)
        working.kill()
        robot.go_on.set()
        assert answered.wait(SOON)
        assert working.wait(SOON) is Outcome.KILLED


def pending_names(robot: Robot, module: str) -> list[str]:
    return [due.message.name for due in robot.central.open_requests_of(module)]


def test_kill_does_not_wake_callback_or_other_thread(robot: Robot) -> None:
    answers = queue.Queue[int]()

    def elsewhere() -> None:
        with connect("thread", robot.central.address) as client:
            answers.put(client.query(BUSY, timeout=SOON))

    def work(task: Task) -> None:
        threading.Thread(target=elsewhere).start()
        task.query_notify(
            HERE, None, lambda sender, _: answers.put(sender.query(BUSY, timeout=SOON))
        )
        task.query(UNHANDLED, timeout=None)

    with robot.working(work) as working:
        for module in ("legs", "thread"):
            until(lambda module=module: BUSY.name in pending_names(robot, module), "is asked")  # type: ignore[misc]
        working.kill()
        robot.go_on.set()
        assert [answers.get(timeout=SOON) for _ in range(2)] == [1, 1]
        assert working.wait(SOON) is Outcome.KILLED


@pytest.mark.parametrize(
    "waits", [lambda task: task.query(UNHANDLED, timeout=None), lambda task: task.lock("arm")]
)
def test_kill_wakes_blocking_coroutine(robot: Robot, waits: Callable[[Task], Any]) -> None:
    """The coroutine is not cancelled as well, because the exception suffices."""

    async def work(task: Task) -> None:
        try:
            waits(task)
        except TaskKilled:
            robot.seen.put((TaskKilled, await task.query_send(HERE)))
            raise

    with robot.working(work) as working:
        robot.until_waiting()
        working.kill()
        assert robot.seen.get(timeout=SOON) == (TaskKilled, "at home")
        assert working.wait(SOON) is Outcome.KILLED
