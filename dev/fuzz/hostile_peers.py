"""The module library under a hostile central.

There must be no exception, and central must be able to read the library's packets.
"""

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import Grammar, damaged
from tca_module.errors import MisuseError
from tca_module.session import given_up
from tca_module.session.request import Request
from tca_module.session.session import HELLO_NUMBER, Session
from tca_wire.errors import ProtocolError
from tca_wire.packets import headers
from tca_wire.packets.codec import misfit, pack_item, unpack_to_central, unpack_to_module
from tca_wire.packets.headers import PROTOCOL_VERSION, Fail, Hello, Reply, Send, ToCentral, ToModule
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import MessageClass

MOST_STEPS = 100
_NAMES = ("walk", "move", "note", "where")
_CLASSES = (MessageClass.GOAL, MessageClass.COMMAND, MessageClass.INFORM, MessageClass.QUERY)


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
        for item in session.pop_outgoing(self.steps.clock):
            assert unpack_to_central(pack_item(*item)), "an empty packet"
        for request in self.requests:
            assert request.why_failed is not None


def attack_session(data: bytes) -> None:
    """Let central send anything."""
    client = _Client(data)
    for kind in client.steps:
        client.step(kind)
