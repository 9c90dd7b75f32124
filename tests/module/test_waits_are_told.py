"""Whenever a handler's thread waits for a reply the journal says so, in whatever way it asks; and who gives up hears why."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from module.gait_messages import HEALTH, TEMPERATURE

from tca_module import Client, Command, Module, Task
from tca_module.testing import LocalCentral
from tca_tools.run.fold import History
from tca_wire.journal.facts import Awaited, Dropped, Received

SOON = 10.0
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
