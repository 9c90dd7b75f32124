"""The module library under a hostile central, and its direct lines under hostile modules.

There must be no exception, and the receivers must be able to read the library's packets.
"""

import logging
from collections import deque
from typing import Any

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import Grammar, damaged
from tca_module.direct.inbox import Inbox
from tca_module.direct.note_batch import NoteBatch
from tca_module.direct.path import DirectPath
from tca_module.errors import MisuseError
from tca_module.session import given_up
from tca_module.session.request import Request
from tca_module.session.session import HELLO_NUMBER, Session
from tca_wire.errors import ProtocolError
from tca_wire.packets import headers
from tca_wire.packets.codec import misfit, pack_item, unpack_to_central, unpack_to_module
from tca_wire.packets.direct import (
    FromEntrance,
    Greet,
    ToEntrance,
    unpack_from_entrance,
    unpack_to_entrance,
)
from tca_wire.packets.headers import PROTOCOL_VERSION, Fail, Hello, Reply, Send, ToCentral, ToModule
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.packets.routes import Entrance
from tca_wire.vocabulary import MessageClass

MOST_STEPS = 100
KEY = "the key"
_NAMES = ("walk", "move", "note", "where")
_CLASSES = (MessageClass.GOAL, MessageClass.COMMAND, MessageClass.INFORM, MessageClass.QUERY)
_SILENT = logging.getLogger("fuzz")
_SILENT.disabled = True


class _Steps:
    """The time, choices and grammar of the attackers."""

    def __init__(self, data: bytes) -> None:
        self.choices = Choices(data)
        self.now = 0.0

    def __iter__(self) -> "_Steps":
        return self

    def __next__(self) -> int:
        if self.choices.is_over or self.now > MOST_STEPS:
            raise StopIteration
        self.now += 1 + self.choices.below(3)
        return self.choices.below(12)

    def clock(self) -> float:
        """Return the present time."""
        return self.now


# --- a session ------------------------------------------------------------------------------------


class _Client:
    """A program with one connection."""

    def __init__(self, data: bytes) -> None:
        self.steps = _Steps(data)
        self.choices = self.steps.choices
        self.session = Session(
            Hello(HELLO_NUMBER, PROTOCOL_VERSION, "legs", "run of legs", 1, "legs")
        )
        self.requests: list[Request] = []
        self.deliveries: list[int] = []  #: that the session has got
        self._grammar = Grammar(
            self.choices,
            {
                "number": self._numbers,
                "delivery": lambda: [*self.deliveries[-4:], 1, 2],
                "message": lambda: _NAMES,
                "ahead": lambda: (0, 1, 2),
                "deliveries": lambda: self.deliveries[-4:],
                "epoch": lambda: ("one", "two"),
            },
        )
        formats = [
            MessageFormat(name, one, "{}") for name, one in zip(_NAMES, _CLASSES, strict=True)
        ]
        self.session.add_declared(formats, [HandlerFormat("move", "legs")], is_ready=True)
        self.session.receive(
            headers.Welcome(HELLO_NUMBER, PROTOCOL_VERSION, "legs", "one"), b"", 0.0
        )

    def _numbers(self) -> list[int]:
        return [one.header.number for one in self.requests[-6:]] + [0, HELLO_NUMBER]

    def step(self, kind: int) -> None:
        choices, session, now = self.choices, self.session, self.steps.now
        if kind < 6:
            header = self._grammar.header(choices.one_of(ToModule.__args__))
            packet = pack_item(header, choices.take(choices.below(6)))
            self.receive_packet(damaged(packet, choices) if kind == 0 else packet)
        elif kind == 6:
            self.receive_packet(choices.take(8 + choices.below(40)))
        elif kind == 7:
            self._ask()
        elif kind == 8:
            self._answer()
        elif kind == 9 and self.requests:
            given_up.abandon(session, self.requests.pop(choices.below(len(self.requests))))
        elif kind == 10:
            session.send_due(now, now - choices.below(60))
        else:
            session.break_off()
        self.send_all()

    def receive_packet(self, packet: bytes) -> None:
        """Receive a packet of central."""
        try:
            items = unpack_to_module(packet)
        except ProtocolError:
            return
        for header, body in items:
            self.session.receive(header, body, self.steps.now)

    def _ask(self) -> None:
        header = self._grammar.header(self.choices.one_of(ToCentral.__args__))
        if "number" not in header.__struct_fields__ or isinstance(header, Hello):
            if not misfit(header):
                self.session.post(header)
            return
        try:
            self.requests.append(
                self.session.request(header, b"\x07", wants_answer=self.choices.once_in(2))
            )
            task = Send(0, self.choices.one_of(_NAMES))
            self.requests.append(self.session.send(task, b"\x07", "a task"))
        except MisuseError:
            pass

    def _answer(self) -> None:
        session = self.session
        for queue in (session.deliveries, session.prefetched):
            if queue:
                header, _ = queue.popleft()
                self.deliveries.append(header.delivery)
        if self.deliveries:
            number = self.deliveries[-1]
            answer = Reply(number) if self.choices.once_in(2) else Fail(number, "slipped", "why")
            session.reply(answer, b"\xc0", self.steps.now)

    def send_all(self) -> None:
        """Send all that is due, and do the other work of the connection's thread."""
        session = self.session
        while session.pending_calls:
            session.pending_calls.popleft()()
        session.complaints.clear()
        session.routing.clear()
        for item in session.pop_outgoing(self.steps.clock):
            assert unpack_to_central(pack_item(*item)), "an empty packet"
        for request in self.requests:
            assert request.why_failed is not None


def attack_session(data: bytes) -> None:
    """Let central send anything."""
    client = _Client(data)
    for kind in client.steps:
        client.step(kind)


# --- direct lines ---------------------------------------------------------------------------------


class _Socket:
    """Both kinds of sockets of direct lines, filled by hand."""

    is_paused = False
    is_connected = True

    def __init__(self, choices: Choices, unpack: Any) -> None:
        self.arrived: deque[Any] = deque()
        self._choices = choices
        self._unpack = unpack

    def receive(self) -> Any:
        """Return the next packet."""
        return self.arrived.popleft() if self.arrived else None

    def send(self, *to_and_packet: bytes) -> bool:
        """Return whether the packet was sent: a random choice."""
        assert self._unpack(to_and_packet[-1]), "an empty packet"
        return not self._choices.once_in(8)

    def close(self) -> None:
        """Do nothing."""

    def fileno(self) -> int:
        """Return no file."""
        return -1

    def has_arrived(self) -> bool:
        """Return whether there is something to receive."""
        return bool(self.arrived)


def attack_entrance(data: bytes) -> None:
    """Let modules send anything to a slot, with its key and without."""
    steps = _Steps(data)
    choices = steps.choices
    socket, notes = _Socket(choices, unpack_from_entrance), NoteBatch()
    inbox = Inbox(socket, KEY, {"note": False, "where": True}, notes, steps.clock, _SILENT)
    grammar = Grammar(
        choices,
        {
            "key": lambda: (KEY,),
            "version": lambda: (PROTOCOL_VERSION,),
            "session": lambda: ("one", "two"),
            "message": lambda: ("note", "where"),
            "number": lambda: range(1, 9),
            "newest": lambda: range(9),
        },
    )
    session = Session(Hello(HELLO_NUMBER, PROTOCOL_VERSION, "legs", "run of legs"))
    session.receive(headers.Welcome(HELLO_NUMBER, PROTOCOL_VERSION, "legs", "one"), b"", 0.0)
    for kind in steps:
        address = b"%d" % choices.below(4)
        if kind < 8:
            header = grammar.header(Greet if kind == 0 else choices.one_of(ToEntrance.__args__))
            packet = pack_item(header, choices.take(choices.below(6)))
            frames = [damaged(packet, choices) if kind == 1 else packet] * (1 + (kind == 2))
            socket.arrived.append((address, frames))
        elif kind == 8:
            socket.arrived.append((address, [choices.take(choices.below(40))]))
        elif inbox.is_busy:
            inbox.reply(Reply(-1) if kind % 2 else Fail(-1, "slipped", "why"), b"\xc0")
        else:
            inbox.next_message()
        inbox.listen()
        notes.report(session, steps.now)
        for item in session.pop_outgoing(steps.clock):
            assert unpack_to_central(pack_item(*item)), "an empty packet"
    inbox.close()


def attack_path(data: bytes) -> None:
    """Let a slot send anything to a module that sends direct messages to this slot."""
    steps = _Steps(data)
    choices = steps.choices
    finished: list[Request] = []
    handed_over: list[Request] = []
    lost: list[tuple[str, int, str]] = []
    socket = _Socket(choices, unpack_to_entrance)
    path = DirectPath(
        Entrance("ipc:///there", KEY),
        socket,
        "one",
        "user",
        end=finished.append,
        hand_over=handed_over.append,
        lose=lambda message, number, why: lost.append((message, number, why)),
    )
    grammar = Grammar(choices, {"number": lambda: range(1, 9), "newest": lambda: range(9)})
    asked, informed = 0, 0
    for kind in steps:
        if kind < 5:
            header = grammar.header(choices.one_of(FromEntrance.__args__))
            packet = pack_item(header, choices.take(choices.below(6)))
            socket.arrived.append(damaged(packet, choices) if kind == 0 else packet)
        elif kind == 5:
            socket.arrived.append(choices.take(choices.below(40)))
        elif kind < 8 and path.is_usable:
            asked += path.send_query(
                Request(Send(0, "where"), b"\x07", wants_answer=True), steps.now
            )
        elif kind < 10 and path.is_usable:
            informed += path.send_inform(Send(0, "note"), b"\x07")
        elif kind == 11 and choices.once_in(16):
            path.on_disconnected("it is gone", steps.now, lost=choices.once_in(2))
        path.receive()
        path.send_due(steps.now)
    path.lose_all("it is over")
    assert len(finished) + len(handed_over) == asked, "each query must end exactly once"
    assert sum(number for _, number, _ in lost) <= informed, "more messages are lost than were sent"
