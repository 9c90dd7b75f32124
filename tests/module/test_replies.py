"""Replies that call a function, that come one by one, or that are waited for."""

import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from module.real_central import SOON
from module.robot import COLLISION, HEALTH, MOVE_LEG, REST, STANCE, TEMPERATURE, Footfall
from module.test_connection import ScriptedCentral, connected

from tca_module import CentralLost, Client, Command, MisuseError, Module, QueryFailed, Sender, Task, Timeout
from tca_module.testing import LocalCentral
from tca_tools.run.fold import History
from tca_wire.journal.facts import Awaited, Dropped, Received
from tca_wire.packets.headers import Beat


def test_what_it_is_called_with_sends(legs: Module, user: Client) -> None:
    moved: list[Footfall] = []
    legs.handles(STANCE)(lambda _, radius: [int(radius)])
    legs.handles(MOVE_LEG)(lambda _, leg: Footfall(leg, 0.0))

    def move(sender: Sender, stance: list[int]) -> None:
        moved.append(sender.command(MOVE_LEG, stance[0]).result(SOON))

    with legs.running():
        assert user.query_notify(STANCE, 3.0, move).wait(SOON)
        assert legs.query_notify(STANCE, 4.0, move).wait(SOON)
    assert [foot.leg for foot in moved] == [3, 4]


def test_a_handler_need_not_stay_for_it(legs: Module, eyes: Module, user: Client, central: LocalCentral) -> None:
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
    sent = [fact for fact in central.facts if isinstance(fact, Received) and fact.message == "move leg"]
    assert [(fact.parent, fact.sender) for fact in sent] == [(0, "legs")]


def test_failures_are_told_or_logged(legs: Module, user: Client, caplog: pytest.LogCaptureFixture) -> None:
    failures: list[Exception] = []

    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        raise COLLISION(Footfall(1, radius), "rock")

    with legs.running():
        never: list[object] = []
        told = user.query_notify(STANCE, 3.0, lambda *_: never.append(1), lambda _, error: failures.append(error))
        assert told.wait(SOON)
        assert not caplog.records
        assert user.query_notify(STANCE, 3.0, lambda *_: never.append(1)).wait(SOON)
    assert not never
    assert isinstance(failures[0], QueryFailed)
    assert failures[0].data_as(COLLISION) == Footfall(1, 3.0)
    assert "QueryFailed: query 'stance' failed: collision: rock" in caplog.text


def test_an_error_in_a_function_is_logged(legs: Module, user: Client, caplog: pytest.LogCaptureFixture) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)

    def fails(sender: Sender, degrees: float) -> None:
        raise SystemExit(int(degrees))

    with legs.running():
        note = user.query_notify(TEMPERATURE, None, fails)
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
        assert note.wait(SOON)
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert "callback test_an_error_in_a_function_is_logged.<locals>.fails failed" in caplog.text
    assert "SystemExit: 36" in caplog.text


def test_functions_are_called_one_after_the_other_however_many(legs: Module, user: Client) -> None:
    """They would nest if one that waits let others be called meanwhile."""
    depth, deepest, count = 0, 0, 300

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


def test_one_function_does_not_wait_for_another(legs: Module, user: Client) -> None:
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


def test_a_query_that_was_given_up_calls_nothing(legs: Module, user: Client, central: LocalCentral) -> None:
    called: list[float] = []
    note = user.query_notify(TEMPERATURE, None, lambda _, degrees: called.append(degrees))
    assert not note.wait(0.0)
    note.cancel()
    note.cancel()
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
    assert not called
    assert [fact.where for fact in central.facts if isinstance(fact, Dropped)] == ["no module handles it"]


def test_a_reply_that_is_there_when_it_is_given_up_calls_nothing(legs: Module, user: Client) -> None:
    called: list[int] = []
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        first = user.query_notify(TEMPERATURE, None, lambda *_: second.cancel())
        second = user.query_notify(TEMPERATURE, None, lambda *_: called.append(2))
        assert first.wait(SOON)
        user.query(TEMPERATURE, timeout=SOON)
    assert not called


def test_a_reply_that_is_lost_is_a_failure(legs: Module, user: Client, central: LocalCentral) -> None:
    failures: list[Exception] = []
    note = user.query_notify(TEMPERATURE, None, lambda *_: None, lambda _, error: failures.append(error))
    central.restart("afresh")
    assert note.wait(SOON)
    assert isinstance(failures[0], CentralLost)


def test_replies_of_many_come_one_by_one(central: LocalCentral, user: Client) -> None:
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


def test_what_is_not_fetched_is_given_up(legs: Module, user: Client, central: LocalCentral) -> None:
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


def test_central_that_beats_and_does_not_answer(legs: Module) -> None:
    connection, central = connected()
    keep_beating(central)
    with pytest.raises(Timeout, match=r"the question for tree was not answered within 30 s, though central is alive"):
        Client(connection).status("tree")
    assert 130 <= central.now <= 131


def keep_beating(central: ScriptedCentral) -> None:
    for second in range(60):
        central.say(Beat(), at=central.now + second)


def test_a_handlers_task_is_for_its_thread(legs: Module, user: Client) -> None:
    """The thread that serves holds the connection: others must not wait for it for ever."""
    caught = queue.Queue[str]()

    def elsewhere(task: Task) -> None:
        calls: list[Callable[[], object]] = [lambda: task.query(TEMPERATURE), lambda: task.cancelled]
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
        assert "belongs to the one that opened it" in caught.get(timeout=SOON)


# --- Whenever a handler's thread waits for a reply the journal says so, in whatever way it asks ----------------------


ASK = Command("ask")
ASK_LATER = Command("ask later")
Way = Callable[[Task], object]


def waits(central: LocalCentral, delivery: int) -> list[int]:
    """What the handler of a delivery waits for, as the journal tells it."""
    with central._lock:
        history = History.until(list(central.entries))
    runs = [run for run in history.handlings if run.delivery == delivery and run.end is None]
    return [wait.awaited for run in runs for wait in run.waits if wait.end is None]


def soon(is_so: Callable[[], bool]) -> bool:
    """Wait until something is so; whether it came to that."""
    until = time.monotonic() + SOON
    while not (so := is_so()) and time.monotonic() < until:
        time.sleep(0.002)
    return so


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
def test_a_handler_that_waits_for_a_reply_is_seen_to_wait(
    central: LocalCentral, legs: Module, eyes: Module, user: Client, way: str
) -> None:
    deliveries: list[int] = []

    def answer(task: Task) -> float:
        return float(soon(lambda: bool(waits(central, deliveries[0]))))

    @legs.handles(ASK)
    def ask(task: Task) -> None:
        deliveries.append(int(task.id))
        assert float(WAYS[way](task)) == 1.0  # type: ignore[arg-type]

    eyes.handles(TEMPERATURE)(answer)
    eyes.handles(HEALTH)(lambda task: str(answer(task)))
    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert not waits(central, deliveries[0])


def test_a_coroutine_that_awaits_a_reply_is_seen_to_wait(
    central: LocalCentral, legs: Module, eyes: Module, user: Client
) -> None:
    deliveries: list[int] = []

    @legs.handles(ASK)
    async def ask(task: Task) -> None:
        deliveries.append(int(task.id))
        assert await task.query_send(TEMPERATURE) == 1.0

    eyes.handles(TEMPERATURE)(lambda _: float(soon(lambda: bool(waits(central, deliveries[0])))))
    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert [fact.blocking for fact in central.facts if isinstance(fact, Received)] == [False, False]


def test_who_asks_and_goes_on_does_not_wait(central: LocalCentral, legs: Module, eyes: Module, user: Client) -> None:
    is_asked = threading.Event()

    @legs.handles(ASK)
    def ask(task: Task) -> None:
        pending = task.query_send(TEMPERATURE)
        assert is_asked.wait(SOON)
        assert not waits(central, int(task.id))
        assert soon(lambda: not task.cancelled and pending.request.is_over)
        assert pending.receive() == 36.6

    @eyes.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        is_asked.set()
        return 36.6

    with legs.running(), eyes.running():
        user.command(ASK).result(SOON)
    assert not [fact for fact in central.facts if isinstance(fact, Awaited)]  # the reply was there when it was wanted


@contextmanager
def busy(eyes: Module, client: Client) -> Iterator[None]:
    """The eyes have a question that they do not answer before the end of the block."""
    begun, go = threading.Event(), threading.Event()

    @eyes.handles(TEMPERATURE)
    def temperature(task: Task) -> float:
        begun.set()
        return 36.6 if go.wait(SOON) else 0.0

    with eyes.running():
        first = client.query_send(TEMPERATURE)
        assert begun.wait(SOON)
        yield
        go.set()
        assert first.receive(SOON) == 36.6


def test_who_gives_up_soon_has_waited_and_hears_where_the_question_stood(
    central: LocalCentral, legs: Module, eyes: Module, user: Client
) -> None:
    @legs.handles(ASK)
    def ask(task: Task) -> None:
        task.query(TEMPERATURE, timeout=0.02)

    with legs.running(), busy(eyes, user):
        asked = user.command(ASK)
        assert asked.wait(SOON) == "failed"
        with pytest.raises(Exception, match=r"within 0.02 s: it is queued for eyes, busy with tempe"):
            asked.result(SOON)
    history = History.until(central.entries)
    (run,) = (run for run in history.handlings if run.name == "ask")
    (wait,) = run.waits
    assert history.messages[wait.awaited].received == wait.start
    assert wait.end == history.messages[wait.awaited].written("dropped")
    (why,) = (fact.where for fact in central.facts if isinstance(fact, Dropped))
    assert why == "it is queued for eyes, busy with temperature {1}"
