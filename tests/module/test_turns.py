"""Replies that leave together are the replies that handlers gave, each when it was."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from tca_module.session.joined_replies import HeldReplies
from tca_wire.packets.headers import Fail, Recalled, Replies, Reply

NIL = b"\xc0"
BODIES = st.sampled_from([NIL, b"\x07", bytes(100), bytes(50_000), bytes(100_000)])


def run(held: HeldReplies, delivery: int, began: float, ended: float, body: bytes = NIL) -> tuple[Any, bytes]:
    """A handler has run in a turn."""
    held.begin(delivery, began)
    header = Reply(delivery, ended - began)
    assert held.take(header, ended)
    return header, body


def apart(items: list[tuple[Any, bytes]]) -> list[tuple[int, bytes]]:
    """The replies among items, each with its body."""
    found = []
    for header, body in items:
        at = 0
        for one in header.ended if isinstance(header, Replies) else [header] if isinstance(header, Reply) else []:
            size = getattr(one, "size", len(body))
            found.append((one.delivery, body[at : at + size] or NIL))
            at += size
        assert at == len(body) or isinstance(header, Recalled | Fail)
    return found


@given(st.lists(BODIES | st.sampled_from([Recalled([1]), Fail(99, "slipped")]), max_size=12))
def test_joined_replies_are_the_same_in_the_same_order(given_: list[Any]) -> None:
    held, items = HeldReplies(), []
    for number, one in enumerate(given_, 1):
        items.append(run(held, number, number, number + 0.5, one) if isinstance(one, bytes) else (one, b""))
    joined = held.joined(items, 20.0)
    assert apart(joined) == [(header.delivery, body) for header, body in items if isinstance(header, Reply)]
    assert [header for header, _ in joined if not isinstance(header, Replies | Reply)] == [
        header for header, _ in items if not isinstance(header, Reply)
    ]
    assert not held.ended


def test_a_header_says_when_its_handlers_ended_and_when_the_next_began() -> None:
    held = HeldReplies()
    items = [run(held, 1, 10.0, 11.0), run(held, 2, 11.0, 13.0), (Recalled([]), b""), run(held, 3, 13.5, 14.0)]
    held.begin(4, 15.0)
    (first, _), _, (second, _) = held.joined(items, 16.0)
    assert [(one.delivery, one.ago, one.took) for one in first.ended] == [(1, 5.0, 1.0), (2, 3.0, 2.0)]
    assert first.begun == 2.5
    assert (second.ended[0].delivery, second.begun) == (3, 1.0)


def test_big_replies_do_not_share_a_header() -> None:
    held = HeldReplies()
    items = [run(held, number, number, number + 1, bytes(40_000)) for number in range(3)]
    assert [len(body) for _, body in held.joined(items, 9.0)] == [40_000] * 3


def test_a_lone_reply_after_which_nothing_has_begun_is_a_plain_one() -> None:
    held = HeldReplies()
    item = run(held, 1, 10.0, 11.0)
    assert held.joined([item], 11.0) == [item]


def test_what_is_not_of_the_turn_is_not_held() -> None:
    held = HeldReplies()
    held.begin(1, 0.0)
    assert not held.take(Fail(1, "slipped"), 1.0)
    assert not held.take(Reply(2), 1.0)
    held.stop()
    assert not held.take(Reply(1), 1.0)
