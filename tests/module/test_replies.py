"""Replies to queries: functions that are called with them, replies of many handlers, and the waits
in the journal.
"""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from module.real_central import SOON, Gate, until
from module.robot import COLLISION, HEALTH, MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall
from module.scripted_central import scripted_connection

from tca_module import (
    CentralLost,
    Client,
    Command,
    MisuseError,
    Module,
    QueryFailed,
    Sender,
    Task,
    Timeout,
)
from tca_module.testing import LocalCentral
from tca_tools.journal.fold import History
from tca_wire.journal.facts import Awaited, Dropped, Received


def test_reply_function_gets_sender_that_sends(legs: Module, user: Client) -> None:
    moved: list[Footfall] = []
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))

    def move(sender: Sender, stance: list[int]) -> None:
        moved.append(sender.command(MOVE_LEG, stance[0]).result(SOON))

    with legs.running():
        assert user.query_notify(STANCE, 3.0, move).wait(SOON)
        assert legs.query_notify(STANCE, 4.0, move).wait(SOON)
    assert [foot.leg for foot in moved] == [3, 4]


def test_reply_function_runs_after_handler_returned(
    legs: Module, eyes: Module, user: Client, central: LocalCentral
) -> None:
    """The function is called in the handler's thread, and sends under the root."""
    moved, returned = queue.Queue[str](), threading.Event()
    eyes.handles(STANCE)(lambda _, radius: [int(radius)] if returned.wait(SOON) else [])
    eyes.handles(MOVE_LEG, resource="other")(lambda _, leg: Footfall(leg, 0.0))

    @legs.handles(REST)
    def rest(task: Task) -> None:
        def move(sender: Sender, stance: list[int]) -> None:
            with pytest.raises(MisuseError, match="is used after its handler returned"):
                task.command(MOVE_LEG, 1)
            sender.command(MOVE_LEG, stance[0]).result(SOON)
            moved.put(threading.current_thread().name)

        task.query_notify(STANCE, 3.0, move)

    with legs.running(), eyes.running():
        user.goal(REST).result(SOON)
        returned.set()
        assert moved.get(timeout=SOON) == "legs 1"
    sent = [
        fact for fact in central.facts if isinstance(fact, Received) and fact.message == "move leg"
    ]
    assert [(fact.parent, fact.sender) for fact in sent] == [(0, "legs")]


def test_query_failure_reaches_failure_function_or_log(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    failures: list[Exception] = []

    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        raise COLLISION(Footfall(1, radius), "rock")

    with legs.running():
        never: list[object] = []
        notification = user.query_notify(
            STANCE, 3.0, lambda *_: never.append(1), lambda _, error: failures.append(error)
        )
        assert notification.wait(SOON)
        assert not caplog.records
        assert user.query_notify(STANCE, 3.0, lambda *_: never.append(1)).wait(SOON)
    assert not never
    assert isinstance(failures[0], QueryFailed)
    assert failures[0].data_as(COLLISION) == Footfall(1, 3.0)
    assert "QueryFailed: query 'stance' failed: collision: rock" in caplog.text


def test_error_in_reply_function_is_logged(
    legs: Module, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)

    def fails(sender: Sender, degrees: float) -> None:
        raise SystemExit(int(degrees))

    with legs.running():
        note = user.query_notify(TEMPERATURE, None, fails)
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
        assert note.wait(SOON)
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert "callback test_error_in_reply_function_is_logged.<locals>.fails failed" in caplog.text
    assert "SystemExit: 36" in caplog.text


def test_reply_functions_never_nest(legs: Module, user: Client) -> None:
    """The functions would nest if a function that waits let others be called."""
    depth, deepest, count = 0, 0, 100

    def ask(sender: Sender, degrees: float) -> None:
        nonlocal depth, deepest
        depth += 1
        deepest = max(deepest, depth)
        assert sender.query(TEMPERATURE, timeout=SOON) == degrees
        depth -= 1

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        notes = [user.query_notify(TEMPERATURE, None, ask) for _ in range(count)]
        assert all(note.wait(SOON) for note in notes)
    assert deepest == 1


def test_wait_for_other_callback_inside_callback_is_misuse(legs: Module, user: Client) -> None:
    caught: list[BaseException] = []

    def wait_for_other(sender: Sender, degrees: float) -> None:
        note = sender.query_notify(TEMPERATURE, None, lambda *_: None)
        with pytest.raises(MisuseError, match="a callback waits for another callback") as error:
            note.wait(SOON)
        caught.append(error.value)

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query_notify(TEMPERATURE, None, wait_for_other).wait(SOON)
    assert len(caught) == 1


def test_abandoned_query_calls_no_function(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    called: list[float] = []
    note = user.query_notify(TEMPERATURE, None, lambda _, degrees: called.append(degrees))
    assert not note.wait(0.0)
    note.cancel()
    note.cancel()
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert not called
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == [
        "no module handles it"
    ]


def test_cancelled_query_calls_no_function_for_arrived_reply(legs: Module, user: Client) -> None:
    called: list[int] = []
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        first = user.query_notify(TEMPERATURE, None, lambda *_: second.cancel())
        second = user.query_notify(TEMPERATURE, None, lambda *_: called.append(2))
        assert first.wait(SOON)
        user.query(TEMPERATURE, timeout=SOON)
    assert not called


def test_lost_reply_calls_failure_function(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    failures: list[Exception] = []
    note = user.query_notify(
        TEMPERATURE, None, lambda *_: None, lambda _, error: failures.append(error)
    )
    central.restart("afresh")
    assert note.wait(SOON)
    assert isinstance(failures[0], CentralLost)


def test_multi_query_send_yields_replies_as_they_come(central: LocalCentral, user: Client) -> None:
    names = ["legs", "eyes", "battery"]
    modules = [Module(name, central) for name in names]
    turns = {name: threading.Event() for name in names}
    for name, module in zip(names, modules, strict=True):
        module.handles(HEALTH)(lambda _, name=name: name if turns[name].wait(SOON) else "late")
    with modules[0].running(), modules[1].running(), modules[2].running():
        replies = user.multi_query_send(HEALTH, timeout=SOON)
        for name in ("eyes", "battery", "legs"):
            turns[name].set()
            assert next(replies) == name
        assert list(replies) == []
        first, second = user.multi_query_send(HEALTH, maximum=2, timeout=SOON)
        assert first != second
        assert len(list(user.multi_query_send(HEALTH, maximum=9, timeout=None))) == 3


def test_unfetched_multi_query_is_given_up(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    go = threading.Event()
    legs.handles(HEALTH)(lambda _: "well" if go.wait(SOON) else "late")
    with legs.running():
        replies = user.multi_query_send(HEALTH, timeout=0.01)
        assert list(replies) == []
        assert list(replies) == []
        again = user.multi_query_send(HEALTH)
        again.cancel()
        again.cancel()
        assert list(again) == []
        go.set()
        assert user.multi_query(HEALTH, timeout=SOON) == ["well"]
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == [
        "no module replied: legs has not answered",
        "no module replied: legs (queued, busy with health {1}) has not answered",
    ]


def test_status_times_out_when_central_only_beats() -> None:
    connection, central = scripted_connection()
    central.beat()
    with pytest.raises(
        Timeout,
        match=r"the question for tree was not answered within 30 s, though central is alive",
    ):
        Client(connection).status("tree")
    assert 130 <= central.now <= 131


def test_handler_task_used_in_other_thread_is_misuse(legs: Module, user: Client) -> None:
    """The serving thread holds the connection. Other threads must not wait for the connection for
    ever.
    """
    caught = queue.Queue[str]()

    def elsewhere(task: Task) -> None:
        calls: list[Callable[[], object]] = [
            lambda: task.query(TEMPERATURE),
            lambda: task.cancelled,
        ]
        for call in calls:
            try:
                call()
            except MisuseError as error:
                caught.put(str(error))

    @legs.handles(REST)
    def rest(task: Task) -> None:
        thread = threading.Thread(target=elsewhere, args=(task,))
        thread.start()
        thread.join(SOON)

    with legs.running():
        user.goal(REST).result(SOON)
    for _ in range(2):
        assert "belongs to thread " in caught.get(timeout=SOON)


pytestmark = pytest.mark.usefixtures("short_timeouts")


# --- The journal shows a handler's wait for a reply, however it asks ------------------------------


ASK = Command("ask")
ASK_LATER = Command("ask later")
Way = Callable[[Task], object]


def open_waits(central: LocalCentral, delivery: int) -> list[int]:
    """Return the open waits of a delivery's handler in the journal."""
    with central._lock:
        history = History.until(list(central.entries))
    runs = [run for run in history.handlings if run.delivery == delivery and run.end is None]
    return [wait.awaited for run in runs for wait in run.waits if wait.end is None]


def answer_once_waiting(central: LocalCentral, deliveries: list[int]) -> Callable[[Task], float]:
    """Return a handler that answers once the journal shows the wait of the first delivery."""

    def answer(_: Task) -> float:
        until(lambda: open_waits(central, deliveries[0]), "the journal shows the wait")
        return 1.0

    return answer


def fetched(task: Task) -> object:
    return task.query_send(TEMPERATURE).receive(SOON)


def called_back(task: Task) -> object:
    replies: list[float] = []
    task.query_notify(TEMPERATURE, None, lambda _, degrees: replies.append(degrees)).wait(SOON)
    return replies[0]


WAYS: dict[str, Way] = {
    "query": lambda task: task.query(TEMPERATURE),
    "query for ever": lambda task: task.query(TEMPERATURE, timeout=None),
    "query_send and receive": fetched,
    "query_notify and wait": called_back,
    "execute": lambda task: task.execute(TEMPERATURE),
    "execute_if_handled": lambda task: task.execute_if_handled(TEMPERATURE),
    "multi_query": lambda task: task.multi_query(HEALTH, timeout=SOON)[0],
    "multi_query_send": lambda task: next(iter(task.multi_query_send(HEALTH, timeout=SOON))),
}


@pytest.mark.parametrize("way", WAYS)
def test_handler_wait_for_reply_is_journaled(
    central: LocalCentral, legs: Module, eyes: Module, user: Client, way: str
) -> None:
    deliveries: list[int] = []
    answer = answer_once_waiting(central, deliveries)

    @legs.handles(ASK)
    def ask(task: Task) -> None:
        deliveries.append(int(task.id))
        assert float(WAYS[way](task)) == 1.0  # type: ignore[arg-type]

    eyes.handles(TEMPERATURE)(answer)
    eyes.handles(HEALTH)(lambda task: str(answer(task)))
    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert not open_waits(central, deliveries[0])


def test_coroutine_await_of_reply_is_journaled(
    central: LocalCentral, legs: Module, eyes: Module, user: Client
) -> None:
    deliveries: list[int] = []

    @legs.handles(ASK)
    async def ask(task: Task) -> None:
        deliveries.append(int(task.id))
        assert await task.query_send(TEMPERATURE) == 1.0

    eyes.handles(TEMPERATURE)(answer_once_waiting(central, deliveries))
    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert [fact.blocking for fact in central.facts if isinstance(fact, Received)] == [False, False]


def test_query_send_alone_is_no_journaled_wait(
    central: LocalCentral, legs: Module, eyes: Module, user: Client
) -> None:
    is_asked = threading.Event()

    @legs.handles(ASK)
    def ask(task: Task) -> None:
        pending = task.query_send(TEMPERATURE)
        assert is_asked.wait(SOON)
        assert not open_waits(central, int(task.id))
        until(lambda: not task.cancelled and pending.request.is_over, "the reply has arrived")
        assert pending.receive() == 36.6

    @eyes.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        is_asked.set()
        return 36.6

    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert not [
        fact for fact in central.facts if isinstance(fact, Awaited)
    ]  # the reply had arrived before it was fetched


@contextmanager
def busy_eyes(eyes: Module, client: Client) -> Iterator[None]:
    """Run a block while the eyes have a question. They answer it only after the block."""
    gate = Gate(36.6)
    eyes.handles(TEMPERATURE)(gate)
    with eyes.running():
        first = client.query_send(TEMPERATURE)
        assert gate.begun.wait(SOON)
        yield
        gate.go_on.set()
        assert first.receive(SOON) == 36.6


def test_short_timeout_is_journaled_and_says_where_query_stood(
    central: LocalCentral, legs: Module, eyes: Module, user: Client
) -> None:
    @legs.handles(ASK)
    def ask(task: Task) -> None:
        task.query(TEMPERATURE, timeout=0.02)

    with legs.running(), busy_eyes(eyes, user):
        asked = user.command(ASK)
        assert asked.wait(SOON) == "failed"
        with pytest.raises(
            Exception, match=r"within 0.02 s: it is queued for eyes, busy with tempe"
        ):
            asked.result(SOON)
    history = History.until(central.entries)
    (run,) = (run for run in history.handlings if run.name == "ask")
    (wait,) = run.waits
    assert history.messages[wait.awaited].received == wait.start
    assert wait.end == history.messages[wait.awaited].written_at("dropped")
    (why,) = (fact.where for fact in central.facts if isinstance(fact, Dropped))
    assert why == "it is queued for eyes, busy with temperature {1}"
