"""A LaterReply ends its task in each case: dropped, killed, cancelled, and answered before its handler returned."""

import asyncio
import gc
import threading
from collections.abc import Callable
from typing import Any

import pytest
from module.real_central import SOON

from tca_module import Change, Client, Command, LaterReply, Module, Outcome, Query, SentTask, Task, TaskFailed
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Failed

MOVE, WHERE = Command("move", int, result=int, progress=int), Query("where", reply=int)

pytestmark = pytest.mark.usefixtures("attentive")


@pytest.fixture
def owed(legs: Module) -> list[LaterReply[int]]:
    """All that the handlers of the legs owe."""
    owed = list[LaterReply[int]]()

    @legs.handles(MOVE, takes=["cancel"])
    def move(task: Task, _: int) -> LaterReply[int]:
        owed.append(task.reply_later())
        return owed[-1]

    legs.handles(WHERE)(lambda _: 5)
    return owed


def begun(user: Client, central: LocalCentral) -> SentTask[int]:
    """A move of which the handler has returned: its slot hears of what comes."""
    sent = user.command(MOVE, 1)
    central.until_quiet()
    return sent


@pytest.mark.parametrize("is_cyclic", [False, True])
def test_a_dropped_reply_fails_as_forgotten(
    legs: Module, owed: list[LaterReply[int]], user: Client, central: LocalCentral, *, is_cyclic: bool
) -> None:
    with legs.running():
        sent = begun(user, central)
        if is_cyclic:
            owed[0].itself = owed[0]  # type: ignore[attr-defined]
        owed.clear()
        gc.collect()
        with pytest.raises(TaskFailed, match="keep it until you have called") as failed:
            sent.result(SOON)
        assert failed.value.failure == "forgotten"
        assert user.query(WHERE, timeout=SOON) == 5
    assert [fact.failure for fact in central.facts if isinstance(fact, Failed)] == ["forgotten"]


def test_a_reply_that_nobody_kept_is_forgotten_at_once(legs: Module, user: Client) -> None:
    legs.handles(MOVE)(lambda task, _: task.reply_later())

    @legs.handles(WHERE, resource="head")
    async def where(task: Task) -> LaterReply[int]:
        await asyncio.sleep(0)
        return task.reply_later()

    with legs.running():
        with pytest.raises(TaskFailed, match="forgotten"):
            user.command(MOVE, 1).result(SOON)
        with pytest.raises(Exception, match="forgotten"):
            user.query(WHERE, timeout=SOON)


def test_a_dropped_reply_of_a_killed_task_just_ends(
    legs: Module, owed: list[LaterReply[int]], user: Client, central: LocalCentral
) -> None:
    with legs.running():
        sent = begun(user, central)
        sent.kill("enough")
        central.until_quiet()
        assert owed[0].cancelled
        owed.clear()
        assert sent.wait(SOON) is Outcome.KILLED
        assert user.query(WHERE, timeout=SOON) == 5


@pytest.mark.parametrize("does_reply", [False, True])
def test_an_accepted_cancel_leaves_nothing_owed(
    legs: Module, owed: list[LaterReply[int]], user: Client, central: LocalCentral, *, does_reply: bool
) -> None:
    with legs.running():
        sent = begun(user, central)
        sent.cancel("enough")
        central.until_quiet()
        request = owed[0].request
        assert request is not None
        request.accept()
        if does_reply:
            owed[0].reply(1)
        assert sent.wait(SOON) is Outcome.KILLED
        assert sent.state == "cancelled"
        assert not owed[0].is_open
        assert user.query(WHERE, timeout=SOON) == 5


def ends_well(later: LaterReply[int]) -> LaterReply[int]:
    later.reply(4)
    return later


def fails(_: LaterReply[int]) -> LaterReply[int]:
    raise ValueError


@pytest.mark.parametrize(("ends", "outcome"), [(ends_well, Outcome.DONE), (fails, Outcome.FAILED)])
def test_reports_come_in_order_when_the_handler_returns_last(
    legs: Module, user: Client, central: LocalCentral, ends: Callable[[Any], Any], outcome: Outcome
) -> None:
    @legs.handles(MOVE)
    def move(task: Task, _: int) -> LaterReply[int]:
        later = task.reply_later()

        def work() -> None:
            for number in range(4):
                later.report(number)

        device = threading.Thread(target=work)
        device.start()
        device.join(SOON)
        return ends(later)  # type: ignore[no-any-return]

    seen: list[Any] = []

    @legs.observes(MOVE)
    def note(change: Change) -> None:
        seen.append("end" if change.is_over else change.data)

    with legs.running():
        assert user.command(MOVE, 1).wait(SOON) is outcome
        central.until_quiet()
    assert seen[-5:] == [0, 1, 2, 3, "end"]
