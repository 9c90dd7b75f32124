"""A handler leaves its reply to another thread, a timer or a device."""

import queue
import threading
from collections.abc import Callable

import pytest
from module.real_central import SOON, Gate
from module.robot import COLLISION, MOVE_LEG, STANCE, TEMPERATURE, Footfall

from tca_module import (
    BadData,
    Client,
    LaterReply,
    Module,
    Outcome,
    QueryFailed,
    Stopped,
    Task,
    TaskFailed,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Delivered, Failed, Returned

pytestmark = pytest.mark.usefixtures("short_timeouts")


@pytest.fixture
def owed(legs: Module) -> "queue.Queue[LaterReply[Footfall]]":
    """Return a queue of the replies that the handler of "move leg" owes."""
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
        )  # the answer must not leave during this wait
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
    """The timer runs in the thread of the handler. The thread is free until then."""

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
    """The nested handler leaves its answer to another thread. Meanwhile the outer handler blocks
    the slot.
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
        returned_another = r"called reply_later\(\) but returned 36.6: return the LaterReply"
        with pytest.raises(QueryFailed, match=returned_another):
            user.query(TEMPERATURE, timeout=SOON)
        with pytest.raises(QueryFailed, match="returned the LaterReply of another handler"):
            user.query(STANCE, 1.0, timeout=SOON)
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
        )  # the handler's thread listens
        pending = user.query_send(TEMPERATURE)  # for the same slot, which is busy until the answer
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
        later.reply(Footfall(1, 0.0))  # the task has failed already, so the reply has no effect
        central.restart("afresh")
        assert user.query(TEMPERATURE, timeout=SOON) == 36.6
