"""The line between a sender and an entrance, without sockets. After any break, no message is
handled twice or forgotten.
"""

import logging
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tca_module.direct import path as direct_path
from tca_module.direct.inbox import MOST_SENDERS, Inbox
from tca_module.direct.note_batch import NEVER, NoteBatch
from tca_module.direct.path import MOST_UNDER_WAY, DirectPath
from tca_module.direct.routes import DirectRoutes
from tca_module.session.request import Request
from tca_module.session.session import Session
from tca_wire.packets.codec import pack_item
from tca_wire.packets.direct import Direct, Greet, unpack_from_entrance
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Fail,
    Hello,
    Refused,
    Reply,
    Send,
    Unknown,
    Welcome,
)
from tca_wire.packets.licences import licence
from tca_wire.packets.routes import Entrance, Loss, Noted
from tca_wire.vocabulary import Limit, Outcome, Refusal

KEY = "key"
LICENCE = licence(KEY, "test.1")


class Line:
    """A line that can break. Packets under way are then lost, and the far end knows the sender
    under a new address.
    """

    def __init__(self) -> None:
        self.there: deque[tuple[bytes, list[bytes]]] = deque()
        self.back: deque[bytes] = deque()
        self.number = 1
        self.is_connected = True

    @property
    def address(self) -> bytes:
        return b"%d" % self.number

    def cut(self) -> None:
        self.there.clear()
        self.back.clear()
        self.number += 1


class Near:
    """The sender's socket."""

    def __init__(self, line: Line) -> None:
        self.line = line

    @property
    def is_connected(self) -> bool:
        return self.line.is_connected

    def send(self, packet: bytes) -> bool:
        if self.line.is_connected:
            self.line.there.append((self.line.address, [packet]))
        return self.line.is_connected

    def receive(self) -> bytes | None:
        return self.line.back.popleft() if self.line.back else None

    def fileno(self) -> int:
        raise NotImplementedError

    def has_arrived(self) -> bool:
        return bool(self.line.back)

    def close(self) -> None:
        """Do nothing, because nothing is open."""


class Far:
    """The entrance's socket."""

    def __init__(self, line: Line) -> None:
        self.line = line
        self.is_paused = False

    def send(self, to: bytes, packet: bytes) -> bool:
        if to == self.line.address:
            self.line.back.append(packet)
        return to == self.line.address

    def receive(self) -> tuple[bytes, list[bytes]] | None:
        return self.line.there.popleft() if self.line.there else None

    def close(self) -> None:
        """Do nothing, because nothing is open."""


class Pair:
    """A sender and a slot."""

    def __init__(self) -> None:
        self.now = 0.0
        self.line = Line()
        self.notes = NoteBatch()
        self.inbox = Inbox(
            Far(self.line),
            KEY,
            {"height": True, "pose": False},
            self.notes,
            lambda: self.now,
            logging.getLogger("t"),
        )
        self.ended: list[Request] = []
        self.handed_over: list[Request] = []
        self.lost: list[str] = []
        self.handled: list[bytes] = []
        self.path = DirectPath(
            Entrance("ipc:///there", LICENCE),
            Near(self.line),
            "run/0/1",
            "user",
            end=self.record_end,
            hand_over=self.handed_over.append,
            lose=lambda what, number, _: self.lost.extend([what] * number),
        )

    def record_end(self, request: Request) -> None:
        assert not request.is_over
        request.is_over = True
        self.ended.append(request)

    def ask(self, body: bytes = b"?") -> Request:
        request = Request(Send(0, "height"), body, wants_answer=True)
        assert self.path.send_query(request, self.now)
        return request

    def greet(self) -> None:
        self.path.send_due(self.now)
        self.inbox.listen()
        self.path.receive()

    def handle(self) -> None:
        """Let the slot handle one message, if one waits."""
        self.inbox.listen()
        if (taken := self.inbox.next_message()) is not None:
            delivery, body = taken
            self.handled.append(body)
            self.inbox.reply(Reply(delivery.delivery), body)

    def run_until_idle(self) -> None:
        """Let time pass until all messages are handled."""
        for _ in range(4):
            self.now += 1.1
            for _ in range(60):
                self.path.send_due(self.now)
                self.handle()
                self.path.receive()


# --- Single breaks and departures -----------------------------------------------------------------


@pytest.fixture
def pair() -> Pair:
    pair = Pair()
    pair.greet()
    return pair


def test_path_is_unusable_before_greeting_is_answered() -> None:
    pair = Pair()
    assert not pair.path.is_usable
    pair.path.send_due(0.0)
    pair.inbox.listen()
    assert not pair.path.is_usable
    pair.path.receive()
    assert pair.path.is_usable


def test_direct_query_is_answered_and_inform_is_not(pair: Pair) -> None:
    request = pair.ask(b"how high")
    assert pair.path.send_inform(Send(0, "pose"), b"here")
    pair.run_until_idle()
    ((answer, body),) = request.answers
    assert (answer.outcome, body) == (Outcome.DONE, b"how high")
    assert pair.handled == [b"how high", b"here"]
    assert not pair.path.requests


def test_leaving_sender_learns_that_informs_arrived(pair: Pair) -> None:
    pair.path.send_inform(Send(0, "pose"), b"1")
    assert pair.path.unconfirmed == 1
    pair.path.must_ask = True
    pair.greet()
    assert (pair.path.unconfirmed, pair.handled) == (0, [])


def test_lost_query_is_resent_and_lost_inform_is_counted(pair: Pair) -> None:
    first = pair.ask(b"1")
    pair.path.send_inform(Send(0, "pose"), b"2")
    pair.line.cut()
    second = pair.ask(b"3")  # the sender has not noticed the break
    pair.run_until_idle()
    assert sorted(pair.handled) == [b"1", b"3"]
    assert first.answers[0][1] == b"1"
    assert second.answers[0][1] == b"3"
    assert pair.lost == ["pose"]


def test_lost_answer_is_repeated(pair: Pair) -> None:
    request = pair.ask()
    pair.handle()
    pair.line.cut()
    pair.run_until_idle()
    assert len(pair.handled) == 1
    assert request.answers


def test_discarded_answer_is_lost_and_query_not_handled_again(pair: Pair) -> None:
    request = pair.ask(bytes(2 << 20))
    pair.handle()
    pair.line.cut()
    pair.run_until_idle()
    assert len(pair.handled) == 1
    assert request.why_lost == "the line to the module broke before the answer came"


def test_forgotten_sender_repeats_no_query(pair: Pair) -> None:
    request = pair.ask()
    pair.handle()
    pair.path.socket.receive()  # the answer is lost
    for number in range(MOST_SENDERS):
        greet = Greet(PROTOCOL_VERSION, LICENCE, f"other {number}", "other")
        pair.line.there.append((b"other %d" % number, [pack_item(greet)]))
        pair.inbox.listen()
    pair.run_until_idle()
    assert request.why_lost
    assert pair.ask().is_over is False
    pair.run_until_idle()
    assert len(pair.handled) == 2


def test_direct_query_over_limit_is_refused_at_once(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    requests = [pair.ask() for _ in range(MOST_UNDER_WAY)]
    refused = pair.ask()
    assert refused.refused == Refused(
        0, Refusal.OVERLOAD, "1000 direct messages wait for the handler of 'height': try later"
    )
    assert pair.path.send_inform(Send(0, "pose"), b"")
    assert pair.lost == ["pose"]
    pair.inbox.listen()
    for _ in range(10):
        pair.handle()
    pair.path.receive()
    assert sum(request.is_over for request in requests) == 10
    assert not pair.ask().is_over
    monkeypatch.setattr(direct_path, "MOST_BYTES", 100)
    assert pair.ask(bytes(101)).refused


def test_acknowledged_informs_free_the_path(pair: Pair) -> None:
    for number in range(3 * MOST_UNDER_WAY):
        assert pair.path.send_inform(Send(0, "pose"), b"%d" % number)
        pair.handle()
        pair.path.receive()
    assert not pair.lost
    assert len(pair.handled) == 3 * MOST_UNDER_WAY


def test_leaving_receiver_returns_unbegun_queries(pair: Pair) -> None:
    begun, waiting = pair.ask(b"1"), pair.ask(b"2")
    pair.path.send_inform(Send(0, "pose"), b"3")
    pair.handle()
    unread = pair.ask(b"4")
    pair.inbox.close()
    pair.path.receive()
    assert begun.answers
    assert pair.handed_over == [waiting, unread]
    assert not pair.path.is_usable
    assert pair.notes.due != NEVER


def test_informs_unbegun_at_receiver_death_are_lost(pair: Pair) -> None:
    for number in range(10):
        pair.path.send_inform(Send(0, "pose"), b"%d" % number)
    for _ in range(4):
        pair.handle()
    pair.now += direct_path.REPEAT
    pair.greet()
    pair.handle()  # the sender is not notified of this message
    assert (pair.path.unconfirmed, pair.lost) == (0, [])
    pair.path.on_disconnected("module 'map' was lost: it fell", pair.now, lost=True)
    assert pair.lost == ["pose"] * 6
    assert not pair.path.is_needed


def test_lost_informs_are_counted_once_when_receiver_leaves(
    pair: Pair,
) -> None:
    for number in range(10):
        pair.path.send_inform(Send(0, "pose"), b"%d" % number)
    for _ in range(4):
        pair.handle()
    pair.inbox.close()
    pair.path.send_inform(Send(0, "pose"), b"unread")
    pair.path.receive()
    assert pair.lost == ["pose"]
    session = Session(Hello(0, PROTOCOL_VERSION, "map", "run"))
    session.receive(Welcome(1, PROTOCOL_VERSION, "map", "epoch"), b"", 0.0)
    pair.notes.report(session, pair.now, at_once=True)
    (noted,) = [header for header, _ in session.outgoing if isinstance(header, Noted)]
    assert (len(noted.notes), noted.losses) == (4, [Loss("pose", 6)])


def test_reconnected_sender_learns_begun_informs_and_continues(pair: Pair) -> None:
    for _ in range(MOST_UNDER_WAY):
        pair.path.send_inform(Send(0, "pose"), b"")
        pair.handle()
    pair.line.cut()
    pair.run_until_idle()
    pair.path.send_inform(Send(0, "pose"), b"next")
    pair.run_until_idle()
    assert (pair.handled[-1], pair.lost) == (b"next", [])


def test_unanswered_direct_query_fails_when_receiver_dies(pair: Pair) -> None:
    answered, open_ = pair.ask(), pair.ask()
    pair.handle()  # the answer has arrived, but was not read yet
    pair.path.on_disconnected("module 'map' was lost: it fell", pair.now, lost=True)
    assert answered.answers[0][0].outcome is Outcome.DONE
    ((answer, _),) = open_.answers
    assert (answer.outcome, answer.failure, answer.text) == (
        Outcome.FAILED,
        "module lost",
        "module 'map' was lost: it fell",
    )


def test_late_answer_of_departed_receiver_is_accepted(pair: Pair) -> None:
    answered, silent = pair.ask(), pair.ask()
    pair.path.on_disconnected("it said goodbye", pair.now, lost=False)
    pair.handle()
    pair.path.receive()
    assert answered.answers
    assert not silent.is_over
    pair.now += direct_path.LEAVE_WITHIN
    pair.path.send_due(pair.now)
    assert silent.answers[0][0].failure == "module lost"


def test_abandoned_query_is_not_handled(pair: Pair) -> None:
    pair.path.abandon(pair.ask(b"1"))
    kept = pair.ask(b"2")
    pair.run_until_idle()
    assert pair.handled == [b"2"]
    assert kept.answers


def test_failure_is_returned_to_direct_sender(pair: Pair) -> None:
    request = pair.ask()
    pair.inbox.listen()
    taken = pair.inbox.next_message()
    assert taken is not None
    pair.inbox.reply(Fail(taken[0].delivery, "fog", "can't see"), b"data")
    pair.path.receive()
    ((answer, body),) = request.answers
    assert (answer.failure, answer.text, body) == ("fog", "can't see", b"data")


def entrance_answers(pair: Pair, *frames: bytes) -> list[Any]:
    """Return the answers of the entrance to *frames*."""
    pair.line.back.clear()
    pair.line.there.append((pair.line.address, list(frames)))
    pair.inbox.listen()
    return [header for packet in pair.line.back for header, _ in unpack_from_entrance(packet)]


@pytest.mark.parametrize(
    ("frames", "why"),
    [
        ((b"garbage!!!!!",), "an item claims"),
        ((b"",), "a packet of 0 bytes"),
        ((b"a", b"b"), "2 frames"),
        ((pack_item(Reply(1)),), "not a message to a slot"),
        ((pack_item(Greet(PROTOCOL_VERSION, "guess", "s", "m")),), "no licence of central"),
        ((pack_item(Greet(PROTOCOL_VERSION, KEY, "s", "m")),), "no licence of central"),
        (
            (pack_item(Greet(PROTOCOL_VERSION, LICENCE.replace("1", "2", 1), "s", "m")),),
            "no licence of central",
        ),
        (
            (pack_item(Greet(PROTOCOL_VERSION + 1, LICENCE, "s", "m")),),
            f"version {PROTOCOL_VERSION + 1}",
        ),
        ((pack_item(Greet(PROTOCOL_VERSION, LICENCE, "s" * 200, "m")),), "is not a sender"),
        ((pack_item(Greet(PROTOCOL_VERSION, LICENCE, "s", "m", -1)),), "is not a sender"),
        ((pack_item(Greet(PROTOCOL_VERSION, LICENCE, "s", "\x1b[2J")),), "is not a sender"),
    ],
)
def test_malformed_packet_at_entrance_is_refused(frames: tuple[bytes, ...], why: str) -> None:
    pair = Pair()
    (answer,) = entrance_answers(pair, *frames)
    assert answer.refusal is Refusal.PROTOCOL
    assert why in answer.text
    (answer,) = entrance_answers(pair, pack_item(Direct(1, "height")))
    assert isinstance(answer, Unknown)
    assert pair.inbox.next_message() is None


def test_unhandled_message_is_refused_and_number_gap_is_bounded(pair: Pair) -> None:
    for number in (5, 1 << 61, -1):
        answers = entrance_answers(pair, pack_item(Direct(number, "move leg")))
        assert [answer.refusal for answer in answers] == [Refusal.UNKNOWN] * (number > 0)
    greet = Greet(PROTOCOL_VERSION, LICENCE, "far ahead", "m", 1 << 61, is_first=False)
    greeting, _ = entrance_answers(pair, pack_item(greet))
    assert greeting.missing == []
    greeting, _ = entrance_answers(
        pair, pack_item(Greet(PROTOCOL_VERSION, LICENCE, "far ahead", "m", (1 << 61) + 10_000))
    )
    assert len(greeting.missing) == 2000


def test_oversized_direct_data_is_refused_with_both_sizes(pair: Pair) -> None:
    entrance_answers(pair, pack_item(Greet(PROTOCOL_VERSION, LICENCE, "s", "m")))
    (answer,) = entrance_answers(pair, pack_item(Direct(1, "height"), bytes(Limit.BODY + 1)))
    assert answer.text == "a body of 8,388,609 bytes; at most 8,388,608 are allowed"
    assert not pair.inbox.has_message


def test_full_inbox_leaves_packets_in_socket(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tca_module.direct.inbox.MOST_WAITING", 5)
    for number in range(1, 11):
        pair.line.there.append((pair.line.address, [pack_item(Direct(number, "pose"))]))
    pair.inbox.listen()
    assert len(pair.line.there) == 5
    for _ in range(10):
        pair.handle()
    assert len(pair.handled) == 10


class RandomPair(Pair):
    """A pair to which anything may happen, in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.greet()
        self.asked: list[Request] = []
        self.informed: list[bytes] = []
        self.given_up: set[Request] = set()

    def asks(self, body: bytes) -> None:
        request = Request(Send(0, "height"), body, wants_answer=True)
        if self.path.is_usable and self.path.send_query(request, self.now):
            self.asked.append(request)

    def tells(self, body: bytes) -> None:
        if self.path.is_usable and self.path.send_inform(Send(0, "pose"), body):
            self.informed.append(body)

    def gives_up(self, _: bytes) -> None:
        for request in self.asked[-1:]:
            self.path.abandon(request)
            self.given_up.add(request)

    def waits(self, _: bytes) -> None:
        self.now += 1.1

    def unplugs(self, _: bytes) -> None:
        self.line.is_connected = not self.line.is_connected


STEPS: dict[str, Callable[[RandomPair, bytes], object]] = {
    "ask": RandomPair.asks,
    "tell": RandomPair.tells,
    "give up": RandomPair.gives_up,
    "handle": lambda pair, _: pair.handle(),
    "listen": lambda pair, _: pair.inbox.listen(),
    "receive": lambda pair, _: pair.path.receive(),
    "send_due": lambda pair, _: pair.path.send_due(pair.now),
    "wait": RandomPair.waits,
    "cut": lambda pair, _: pair.line.cut(),
    "unplug": RandomPair.unplugs,
}


@settings(max_examples=150)
@given(st.lists(st.sampled_from(sorted(STEPS)), max_size=60))
def test_direct_messages_are_handled_once_despite_breaks(steps: list[str]) -> None:
    pair = RandomPair()
    for number, step in enumerate(steps):
        STEPS[step](pair, b"%d" % number)
    pair.line.is_connected = True
    pair.run_until_idle()
    pair.ask(b"last")  # an inform that is lost is noticed only when another message follows
    pair.run_until_idle()
    assert len(set(pair.handled)) == len(pair.handled)
    for request in pair.asked:
        assert request.is_over or request in pair.given_up
        assert bool(request.answers) <= (request.body in pair.handled)
    poses = [body for body in pair.handled if body in pair.informed]
    assert poses == sorted(poses, key=int)
    assert len(poses) + len(pair.lost) == len(pair.informed)
    assert not pair.path.is_needed  # the slot has reported everything, so its death loses nothing


@pytest.mark.parametrize("usable", [(False, True), (True, False), (False, False), (True, True)])
def test_routes_rotate_over_usable_slots(usable: tuple[bool, bool]) -> None:
    routes = DirectRoutes.__new__(DirectRoutes)
    paths: list[Any] = [SimpleNamespace(is_usable=one) for one in usable]
    routes._routes = {"height": deque(paths)}
    chosen = [routes._path_for("height") for _ in range(4)]
    assert {id(one) for one in chosen if one is not None} == {
        id(one) for one in paths if one.is_usable
    }
    assert routes._path_for("unknown") is None


def test_sender_with_withdrawn_licence_is_cut_off() -> None:
    pair = Pair()
    pair.greet()
    pair.handle()
    asked, accepted = pair.ask(b"before"), pair.path.send_inform(Send(0, "pose"), b"")
    assert accepted
    pair.inbox.bar(["test.1"])
    pair.run_until_idle()
    assert pair.handled == []
    assert pair.path.is_over
    assert pair.ended == [asked]
    assert "no licence" in asked.why_lost
    assert pair.lost == ["pose"]


def test_sender_with_renewed_licence_continues() -> None:
    pair = Pair()
    pair.greet()
    first = pair.ask(b"1")
    pair.inbox.listen()
    pair.inbox.bar(["test.1"])
    pair.path.entrance = Entrance("ipc:///there", licence(KEY, "test.2"))
    second = pair.ask(b"2")
    pair.run_until_idle()
    assert pair.ended == [first, second]
    assert pair.handled == [b"1", b"2"]
