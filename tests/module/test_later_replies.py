"""A LaterReply ends its task in each case: dropped, killed, cancelled, and answered before its handler returned."""

import asyncio
import threading
from collections.abc import Iterator

import pytest
from module.real_central import SOON

from tca_module import Client, Command, LaterReply, Module, Outcome, Query, SentTask, Task, TaskFailed
from tca_module.testing import LocalCentral

MOVE, WHERE = Command("move", int, result=int, progress=int), Query("where", reply=int)
Owed = list[LaterReply[int]]


@pytest.fixture
def owed(legs: Module, user: Client) -> Iterator[Owed]:
    """All that the handlers of the legs owe; in the end, another message can use their slot."""
    owed = Owed()

    @legs.handles(MOVE, takes=["cancel"])
    def move(task: Task, _: int) -> LaterReply[int]:
        owed.append(task.reply_later())
        return owed[-1]

    legs.handles(WHERE)(lambda _: 5)
    with legs.running():
        yield owed
        assert user.query(WHERE, timeout=SOON) == 5


@pytest.fixture
def sent(owed: Owed, user: Client, central: LocalCentral) -> SentTask[int]:
    """A move whose handler has returned."""
    sent = user.command(MOVE, 1)
    central.until_quiet()
    return sent


def test_a_dropped_reply_fails_as_forgotten(sent: SentTask[int], owed: Owed) -> None:
    owed.clear()
    with pytest.raises(TaskFailed, match="keep it until you have called") as failed:
        sent.result(SOON)
    assert failed.value.failure == "forgotten"


@pytest.mark.parametrize("is_async", [False, True])
def test_a_reply_that_is_never_kept_is_forgotten(legs: Module, user: Client, *, is_async: bool) -> None:
    async def move(task: Task, _: int) -> LaterReply[int]:
        await asyncio.sleep(0)
        return task.reply_later()

    legs.handles(MOVE)(move if is_async else lambda task, _: task.reply_later())
    with legs.running(), pytest.raises(TaskFailed, match="forgotten"):
        user.command(MOVE, 1).result(SOON)


def test_a_dropped_reply_of_a_killed_task_just_ends(sent: SentTask[int], owed: Owed, central: LocalCentral) -> None:
    sent.kill("enough")
    central.until_quiet()
    assert owed[0].cancelled
    owed.clear()
    assert sent.wait(SOON) is Outcome.KILLED


@pytest.mark.parametrize("does_reply", [False, True])
def test_an_accepted_cancel_leaves_nothing_owed(
    sent: SentTask[int], owed: Owed, central: LocalCentral, *, does_reply: bool
) -> None:
    sent.cancel("enough")
    central.until_quiet()
    assert owed[0].request is not None
    owed[0].request.accept()
    if does_reply:
        owed[0].reply(1)
    assert (sent.wait(SOON), sent.state, owed[0].is_open) == (Outcome.KILLED, "cancelled", False)


@pytest.mark.parametrize("outcome", [Outcome.DONE, Outcome.FAILED])
def test_reports_come_in_order_when_the_handler_returns_last(legs: Module, user: Client, outcome: Outcome) -> None:
    @legs.handles(MOVE)
    def move(task: Task, _: int) -> LaterReply[int]:
        later = task.reply_later()
        device = threading.Thread(target=lambda: list(map(later.report, range(4))))
        device.start()
        device.join(SOON)
        if outcome is Outcome.FAILED:
            raise ValueError
        later.reply(4)
        return later

    with legs.running():
        sent = user.command(MOVE, 1, suspended=True)
        progress = sent.progress(int, timeout=SOON)
        sent.resume()
        assert list(progress) == [0, 1, 2, 3]
        assert sent.wait(SOON) is outcome
