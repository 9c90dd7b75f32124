"""A LaterReply ends its task in each case: if it is dropped, killed, cancelled, or used before its
handler returned.
"""

import asyncio
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from module.real_central import SOON

from tca_module import (
    Client,
    Command,
    LaterReply,
    Module,
    Outcome,
    Query,
    SentTask,
    Task,
    TaskFailed,
)
from tca_module.session.joined_replies import HeldReplies
from tca_module.testing import LocalCentral
from tca_wire.packets.headers import Fail, Recalled, Replies, Reply

MOVE, WHERE = Command("move", int, result=int, progress=int), Query("where", reply=int)
Owed = list[LaterReply[int]]


@pytest.fixture
def owed(legs: Module, user: Client) -> Iterator[Owed]:
    """Yield all replies that the legs owe. At the end, check that the slot of the legs is free
    again.
    """
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
    """Return a move whose handler has returned."""
    sent = user.command(MOVE, 1)
    central.until_quiet()
    return sent


def test_dropped_reply_fails_as_forgotten(sent: SentTask[int], owed: Owed) -> None:
    owed.clear()
    with pytest.raises(TaskFailed, match="until you have called") as failed:
        sent.result(SOON)
    assert failed.value.failure == "forgotten"


@pytest.mark.parametrize("is_async", [False, True])
def test_unkept_reply_fails_as_forgotten(legs: Module, user: Client, *, is_async: bool) -> None:
    async def move(task: Task, _: int) -> LaterReply[int]:
        await asyncio.sleep(0)
        return task.reply_later()

    legs.handles(MOVE)(move if is_async else lambda task, _: task.reply_later())
    with legs.running(), pytest.raises(TaskFailed, match="forgotten"):
        user.command(MOVE, 1).result(SOON)


def test_dropped_reply_of_killed_task_ends_it(
    sent: SentTask[int], owed: Owed, central: LocalCentral
) -> None:
    sent.kill("enough")
    central.until_quiet()
    assert owed[0].cancelled
    owed.clear()
    assert sent.wait(SOON) is Outcome.KILLED


@pytest.mark.parametrize("does_reply", [False, True])
def test_accepted_cancel_closes_later_reply(
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
def test_reports_keep_order_when_handler_returns_last(
    legs: Module, user: Client, outcome: Outcome
) -> None:
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


# --- Joined replies are equal to the single replies of the handlers -------------------------------


NIL = b"\xc0"
BODIES = st.sampled_from([NIL, b"\x07", bytes(100), bytes(50_000), bytes(100_000)])


def run(
    held: HeldReplies, delivery: int, began: float, ended: float, body: bytes = NIL
) -> tuple[Any, bytes]:
    """Run a handler within a turn."""
    held.begin(delivery, began)
    header = Reply(delivery, ended - began)
    assert held.hold(header, ended)
    return header, body


def replies_of(header: Any) -> list[Any]:
    if isinstance(header, Replies):
        return header.ended
    return [header] if isinstance(header, Reply) else []


def separate_replies(items: list[tuple[Any, bytes]]) -> list[tuple[int, bytes]]:
    """Return the replies among *items*, each with its body."""
    found = []
    for header, body in items:
        at = 0
        for one in replies_of(header):
            size = getattr(one, "size", len(body))
            found.append((one.delivery, body[at : at + size] or NIL))
            at += size
        assert at == len(body) or isinstance(header, Recalled | Fail)
    return found


@given(st.lists(BODIES | st.sampled_from([Recalled([1]), Fail(99, "slipped")]), max_size=12))
def test_joined_replies_keep_content_and_order(given_: list[Any]) -> None:
    held, items = HeldReplies(), []
    for number, one in enumerate(given_, 1):
        items.append(
            run(held, number, number, number + 0.5, one) if isinstance(one, bytes) else (one, b"")
        )
    joined = held.joined(items, 20.0)
    assert separate_replies(joined) == [
        (header.delivery, body) for header, body in items if isinstance(header, Reply)
    ]
    assert [header for header, _ in joined if not isinstance(header, Replies | Reply)] == [
        header for header, _ in items if not isinstance(header, Reply)
    ]
    assert not held.ended


def test_joined_header_gives_end_times_and_next_start() -> None:
    held = HeldReplies()
    items = [
        run(held, 1, 10.0, 11.0),
        run(held, 2, 11.0, 13.0),
        (Recalled([]), b""),
        run(held, 3, 13.5, 14.0),
    ]
    held.begin(4, 15.0)
    (first, _), _, (second, _) = held.joined(items, 16.0)
    assert [(one.delivery, one.ago, one.took) for one in first.ended] == [
        (1, 5.0, 1.0),
        (2, 3.0, 2.0),
    ]
    assert first.begun == 2.5
    assert (second.ended[0].delivery, second.begun) == (3, 1.0)


def test_big_replies_do_not_share_header() -> None:
    held = HeldReplies()
    items = [run(held, number, number, number + 1, bytes(40_000)) for number in range(3)]
    assert [len(body) for _, body in held.joined(items, 9.0)] == [40_000] * 3


def test_lone_reply_without_successor_is_plain() -> None:
    held = HeldReplies()
    item = run(held, 1, 10.0, 11.0)
    assert held.joined([item], 11.0) == [item]


def test_only_replies_of_current_turn_are_held() -> None:
    held = HeldReplies()
    held.begin(1, 0.0)
    assert not held.hold(Fail(1, "slipped"), 1.0)
    assert not held.hold(Reply(2), 1.0)
    held.stop()
    assert not held.hold(Reply(1), 1.0)
