"""Handlers that leave the answer to somebody else."""

import queue
import threading
from collections.abc import Callable

import pytest
from module.real_central import SOON
from module.robot import COLLISION, MOVE_LEG, STANCE, TEMPERATURE, Footfall

from tca_module import BadData, Client, LaterReply, Module, Outcome, QueryFailed, Stopped, Task, TaskFailed
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Delivered, Failed, Returned

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


def test_until_then_the_place_in_the_resource_is_taken(
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
    order = [type(fact).__name__ for fact in central.facts if isinstance(fact, Delivered | Returned)]
    assert order == ["Delivered", "Returned"] * 3


def test_an_answer_that_comes_before_the_handler_returns_waits_for_it(
    legs: Module, user: Client, central: LocalCentral
) -> None:
    @legs.handles(STANCE)
    def stance(task: Task, radius: float) -> LaterReply[list[int]]:
        later = task.reply_later()
        assert task.reply_later() is later
        thread = threading.Thread(target=later.reply, args=([1],))
        thread.start()
        thread.join(SOON)
        assert task.query(TEMPERATURE, timeout=SOON) == 36.6  # a wait in which the answer does not leave yet
        assert not [fact for fact in central.facts if isinstance(fact, Returned) and fact.id == task.delivery]
        return later

    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        assert user.query(STANCE, 1.0, timeout=SOON) == [1]


@pytest.mark.parametrize("is_coroutine", [False, True])
def test_a_timer_answers(legs: Module, user: Client, *, is_coroutine: bool) -> None:
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


def test_what_answers_its_own_query_later_is_heard_within_the_wait(legs: Module, user: Client) -> None:
    """The handler of a nested query leaves the answer to another thread, while the outer handler blocks the slot."""

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
    [(collides, "collision", "rock"), (lambda: OSError("motor 3 is hot"), "handler error", "OSError: motor 3 is hot")],
)
def test_it_may_fail(
    legs: Module, owed: Owed, user: Client, error: Callable[[], BaseException], failure: str, text: str
) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        owed.get(timeout=SOON).fail(error())
        with pytest.raises(TaskFailed) as failed:
            move.result(SOON)
        assert failed.value.failure == failure
        assert failed.value.text.startswith(text)


def test_wrong_data_do_not_answer(legs: Module, owed: Owed, user: Client) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        with pytest.raises(BadData, match="the handler of command 'move leg' must return"):
            later.reply("left")  # type: ignore[arg-type]
        assert later.is_open
        later.reply(Footfall(1, 0.0))
        assert move.result(SOON) == Footfall(1, 0.0)


def test_who_calls_reply_later_returns_what_it_gives(legs: Module, user: Client) -> None:
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
            with pytest.raises(QueryFailed, match=r"called reply_later\(\) and returned .*: return what that gave"):
                ask()
    with pytest.raises(Stopped, match="'temperature' can't be answered any more: its handler failed: MisuseError"):
        kept[0].reply(36.6)


def test_a_handler_that_raises_has_answered(legs: Module, user: Client) -> None:
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


def test_it_is_told_that_its_task_was_killed(legs: Module, owed: Owed, user: Client) -> None:
    legs.handles(TEMPERATURE)(lambda _: 36.6)
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        assert not later.cancelled
        move.kill("enough")
        never = threading.Event()
        assert any(later.cancelled or never.wait(0.005) for _ in range(1000))  # the thread of its handler listens
        pending = user.query_send(TEMPERATURE)  # for the same slot, which is taken until the answer
        later.reply(Footfall(1, 0.0))
        assert move.wait(SOON) is Outcome.KILLED
        assert pending.receive(SOON) == 36.6
        assert not later.cancelled


def test_a_module_that_ends_fails_what_it_owes(legs: Module, owed: Owed, user: Client, central: LocalCentral) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
    with pytest.raises(TaskFailed, match="module lost: its module ended before it was answered"):
        move.result(SOON)
    with pytest.raises(Stopped, match=r"move leg \{1\} can't be answered any more: its module has ended"):
        later.reply(Footfall(1, 0.0))
    assert [fact.failure for fact in central.facts if isinstance(fact, Failed)] == ["module lost"]


def test_an_answer_just_before_the_end_still_leaves(legs: Module, owed: Owed, user: Client) -> None:
    with legs.running():
        move = user.command(MOVE_LEG, 1)
        later = owed.get(timeout=SOON)
        legs.stop()
        later.reply(Footfall(1, 0.0))
    assert move.result(SOON) == Footfall(1, 0.0)


def test_a_connection_that_breaks_fails_what_is_owed(
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
