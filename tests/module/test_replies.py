"""Replies that call a function, come one by one, are waited for, or are given later."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from module.real_central import SOON, Gate, until
from module.robot import COLLISION, HEALTH, MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall
from module.test_connection import connected

from tca_module import (
    BadData,
    CentralLost,
    Client,
    Command,
    LaterReply,
    MisuseError,
    Module,
    Outcome,
    QueryFailed,
    Sender,
    Stopped,
    Task,
    TaskFailed,
    Timeout,
)
from tca_module.testing import LocalCentral
from tca_tools.journal.fold import History
from tca_wire.journal.facts import Awaited, Delivered, Dropped, Failed, Received, Returned


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
        told = user.query_notify(
            STANCE, 3.0, lambda *_: never.append(1), lambda _, error: failures.append(error)
        )
        assert told.wait(SOON)
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
    """They would nest if one that waits let others be called meanwhile."""
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

    def waits(sender: Sender, degrees: float) -> None:
        note = sender.query_notify(TEMPERATURE, None, lambda *_: None)
        with pytest.raises(MisuseError, match="a callback waits for another one") as error:
            note.wait(SOON)
        caught.append(error.value)

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query_notify(TEMPERATURE, None, waits).wait(SOON)
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
        "nobody replied: legs has not answered",
        "nobody replied: legs (queued, busy with health {1}) has not answered",
    ]


def test_status_times_out_when_central_only_beats() -> None:
    connection, central = connected()
    central.beat()
    with pytest.raises(
        Timeout,
        match=r"the question for tree was not answered within 30 s, though central is alive",
    ):
        Client(connection).status("tree")
    assert 130 <= central.now <= 131


def test_handler_task_used_in_other_thread_is_misuse(legs: Module, user: Client) -> None:
    """The thread that serves holds the connection: others must not wait for it for ever."""
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


# --- Whenever a handler's thread waits for a reply the journal says so, in whatever way it asks ---


ASK = Command("ask")
ASK_LATER = Command("ask later")
Way = Callable[[Task], object]


def waits(central: LocalCentral, delivery: int) -> list[int]:
    """What the handler of a delivery waits for, as the journal tells it."""
    with central._lock:
        history = History.until(list(central.entries))
    runs = [run for run in history.handlings if run.delivery == delivery and run.end is None]
    return [wait.awaited for run in runs for wait in run.waits if wait.end is None]


def once_seen(central: LocalCentral, deliveries: list[int]) -> Callable[[Task], float]:
    """A handler that answers when the journal says that the first of these waits."""

    def answer(_: Task) -> float:
        until(lambda: waits(central, deliveries[0]), "it is seen to wait")
        return 1.0

    return answer


def fetched(task: Task) -> object:
    return task.query_send(TEMPERATURE).receive(SOON)


def called_back(task: Task) -> object:
    heard: list[float] = []
    task.query_notify(TEMPERATURE, None, lambda _, degrees: heard.append(degrees)).wait(SOON)
    return heard[0]


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
    answer = once_seen(central, deliveries)

    @legs.handles(ASK)
    def ask(task: Task) -> None:
        deliveries.append(int(task.id))
        assert float(WAYS[way](task)) == 1.0  # type: ignore[arg-type]

    eyes.handles(TEMPERATURE)(answer)
    eyes.handles(HEALTH)(lambda task: str(answer(task)))
    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert not waits(central, deliveries[0])


def test_coroutine_await_of_reply_is_journaled(
    central: LocalCentral, legs: Module, eyes: Module, user: Client
) -> None:
    deliveries: list[int] = []

    @legs.handles(ASK)
    async def ask(task: Task) -> None:
        deliveries.append(int(task.id))
        assert await task.query_send(TEMPERATURE) == 1.0

    eyes.handles(TEMPERATURE)(once_seen(central, deliveries))
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
        assert not waits(central, int(task.id))
        until(lambda: not task.cancelled and pending.request.is_over, "the reply is there")
        assert pending.receive() == 36.6

    @eyes.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        is_asked.set()
        return 36.6

    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert not [
        fact for fact in central.facts if isinstance(fact, Awaited)
    ]  # the reply was there when it was wanted


@contextmanager
def busy(eyes: Module, client: Client) -> Iterator[None]:
    """The eyes have a question that they do not answer before the end of the block."""
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

    with legs.running(), busy(eyes, user):
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
    assert wait.end == history.messages[wait.awaited].written("dropped")
    (why,) = (fact.where for fact in central.facts if isinstance(fact, Dropped))
    assert why == "it is queued for eyes, busy with temperature {1}"


# --- Handlers that leave the answer to somebody else ----------------------------------------------


pytestmark = pytest.mark.usefixtures("attentive")


@pytest.fixture
def owed(legs: Module) -> "queue.Queue[LaterReply[Footfall]]":
    """What the handler of "move leg" leaves to others."""
    owed = queue.Queue[LaterReply[Footfall]]()

    @legs.handles(MOVE_LEG)
    def move_leg(task: Task, leg: int) -> LaterReply[Footfall]:
        later = task.reply_later()
        owed.put(later)
        return later

    return owed


Owed = queue.Queue[LaterReply[Footfall]]


def test_later_reply_keeps_resource_slot_busy(
    legs: Module, owed: Owed, user: Client, central: LocalCentral
) -> None:
    with legs.running():
        moves = [user.command(MOVE_LEG, leg, sequential=False) for leg in range(3)]
        for leg in range(3):
            later = owed.get(timeout=SOON)
            user.status()
            assert owed.empty()
            later.reply(Footfall(leg, 0.0))
        assert [move.result(SOON).leg for move in moves] == [0, 1, 2]
    order = [
        type(fact).__name__ for fact in central.facts if isinstance(fact, Delivered | Returned)
    ]
    assert order == ["Delivered", "Returned"] * 3


def test_early_later_reply_waits_for_handler_return(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> LaterReply[list[int]]:
        later = task.reply_later()
        assert task.reply_later() is later
        thread = threading.Thread(target=later.reply, args=([1],))
        thread.start()
        thread.join(SOON)
        assert (
            task.query(TEMPERATURE, timeout=SOON) == 36.6
        )  # a wait in which the answer does not leave yet
        assert not [
            fact
            for fact in central.facts
            if isinstance(fact, Returned) and fact.id == task.delivery
        ]
        return later

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query(STANCE, 1.0, timeout=SOON) == [1]


@pytest.mark.parametrize("is_coroutine", [False, True])
def test_timer_gives_later_reply(legs: Module, user: Client, *, is_coroutine: bool) -> None:
    """In the thread of the handler itself, which is free meanwhile."""

    def temperature(task: Task) -> LaterReply[float]:
        later = task.reply_later()
        legs.after(0.01, lambda: later.reply(36.6), resource="legs")
        return later

    async def temperature_of_coroutine(task: Task) -> LaterReply[float]:
        return temperature(task)

    legs.handles(TEMPERATURE)(temperature_of_coroutine if is_coroutine else temperature)
    with legs.running():
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6


def test_later_reply_to_nested_query_wakes_waiting_slot(legs: Module, user: Client) -> None:
    """The handler of a nested query leaves the answer to another thread, while the outer handler
    blocks the slot.
    """

    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        return [int(task.query(TEMPERATURE, timeout=SOON))]

    @legs.handles(TEMPERATURE)
    def temperature(task: Task) -> LaterReply[float]:
        later = task.reply_later()
        threading.Thread(target=later.reply, args=(36.6,)).start()
        return later

    with legs.running():
        assert user.query(STANCE, 1.0, timeout=SOON) == [36]


def collides() -> BaseException:
    return COLLISION(Footfall(1, 0.5), "rock")


@pytest.mark.parametrize(
    ("error", "failure", "text"),
    [
        (collides, "collision", "rock"),
        (lambda: OSError("motor 3 is hot"), "handler error", "OSError: motor 3 is hot"),
    ],
)
def test_later_reply_may_fail(
    legs: Module,
    owed: Owed,
    user: Client,
    error: Callable[[], BaseException],
    failure: str,
    text: str,
) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        owed.get(timeout=SOON).fail(error())
        with pytest.raises(TaskFailed) as failed:
            move.result(SOON)
        assert failed.value.failure == failure
        assert failed.value.text.startswith(text)


def test_wrong_data_leaves_later_reply_open(legs: Module, owed: Owed, user: Client) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        with pytest.raises(BadData, match="the handler of command 'move leg' must return"):
            later.reply("left")  # type: ignore[arg-type]
        assert later.is_open
        later.reply(Footfall(1, 0.0))
        assert move.result(SOON) == Footfall(1, 0.0)


def test_handler_must_return_its_own_later_reply(legs: Module, user: Client) -> None:
    kept: list[LaterReply[float]] = []

    @legs.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        kept.append(task.reply_later())
        return 36.6

    legs.handles(STANCE)(lambda _, _radius: kept[0])  # type: ignore[arg-type,return-value]
    with legs.running():
        asks: list[Callable[[], object]] = [
            lambda: user.query(TEMPERATURE, timeout=SOON),
            lambda: user.query(STANCE, 1.0, timeout=SOON),
        ]
        for ask in asks:
            with pytest.raises(
                QueryFailed, match=r"called reply_later\(\) and returned .*: return what that gave"
            ):
                ask()
    with pytest.raises(
        Stopped, match="'temperature' can't be answered any more: its handler failed: MisuseError"
    ):
        kept[0].reply(36.6)


def test_error_in_handler_closes_later_reply(legs: Module, user: Client) -> None:
    kept: list[LaterReply[float]] = []

    @legs.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        kept.append(task.reply_later())
        kept[0].reply(36.6)
        raise COLLISION(Footfall(1, 0.0))

    with legs.running():
        with pytest.raises(QueryFailed, match="collision"):
            user.query(TEMPERATURE, timeout=SOON)
        assert not kept[0].is_open


def test_later_reply_learns_that_task_was_killed(legs: Module, owed: Owed, user: Client) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        assert not later.cancelled
        move.kill("enough")
        never = threading.Event()
        assert any(
            later.cancelled or never.wait(0.005) for _ in range(1000)
        )  # the thread of its handler listens
        pending = user.query_send(TEMPERATURE)  # for the same slot, which is taken until the answer
        later.reply(Footfall(1, 0.0))
        assert move.wait(SOON) is Outcome.KILLED
        assert pending.receive(SOON) == 36.6
        assert not later.cancelled


def test_module_end_fails_owed_replies(
    legs: Module, owed: Owed, user: Client, central: LocalCentral
) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
    with pytest.raises(TaskFailed, match="module lost: its module ended before it was answered"):
        move.result(SOON)
    with pytest.raises(
        Stopped, match=r"move leg \{1\} can't be answered any more: its module has ended"
    ):
        later.reply(Footfall(1, 0.0))
    assert [fact.failure for fact in central.facts if isinstance(fact, Failed)] == ["module lost"]


def test_reply_just_before_module_end_is_sent(legs: Module, owed: Owed, user: Client) -> None:
    busy = Gate()
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        legs.after(0.0, busy, resource="legs")
        assert busy.begun.wait(SOON)
        legs.stop()
        later.reply(Footfall(1, 0.0))
        busy.go_on.set()
    assert move.result(SOON) == Footfall(1, 0.0)


def test_connection_break_fails_owed_replies(
    legs: Module, owed: Owed, user: Client, central: LocalCentral
) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        central.cut("legs")
        with pytest.raises(TaskFailed, match="module lost"):
            move.result(SOON)
        later.reply(Footfall(1, 0.0))  # nobody wants it any more, which does no harm
        central.restart("afresh")
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
