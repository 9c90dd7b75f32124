"""A slot's entrance for direct messages.

Senders greet with the licence that central gave them, and number their messages: none is handled
twice, and an answer is kept for a while in case it is lost with a line. The slot takes a message
when it handles nothing else. When this is full, the rest waits in the socket and with the senders.
Bad bytes, unknown messages and strangers are refused.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

from tca_module.direct.note_batch import NoteBatch
from tca_wire.errors import ProtocolError
from tca_wire.packets import direct, headers
from tca_wire.packets.codec import pack, pack_item
from tca_wire.packets.direct import Begun, Direct, Greet, Greeting
from tca_wire.packets.headers import PROTOCOL_VERSION, Answer, Deliver, Fail, GiveUp, Refused, Reply
from tca_wire.packets.licences import number_of
from tca_wire.packets.routes import Note
from tca_wire.vocabulary import Limit, Outcome, Refusal, is_name

MOST_WAITING, MOST_BYTES = (
    2000,
    128 << 20,
)  # messages, and bytes of their data; more stay in the socket
MOST_SENDERS = 256
ANSWERS_KEPT, ANSWER_BYTES = 64, 1 << 20  # for each sender
BEGUN_EVERY, BEGUN_BYTES = 64, 1 << 20  # informs, or bytes, begun with before their sender is told
PACKETS = 256  # read at a time
_MOST_BARRED = 20_000
_MOST_MISSING = 2000  # numbers; senders have fewer on their way


class InboxSocket(Protocol):
    """A socket on which packets of many senders arrive."""

    is_paused: bool
    """Packets stay where they are."""

    def receive(self) -> tuple[bytes, list[bytes]] | None:
        """The sender and the frames of the next packet; None if there is none."""

    def send(self, to: bytes, packet: bytes) -> bool:
        """Whether it left."""

    def close(self) -> None:
        """Close; packets already sent still leave."""


class _RemoteSender:
    """One sender, and its messages."""

    def __init__(self, address: bytes, greet: Greet) -> None:
        self.address = address
        self.module = greet.module
        self.newest = greet.newest
        self.missing: set[int] = set()  #: numbers that did not arrive, and may come again
        self.open: dict[int, _Waiting] = {}  #: queries that were not answered
        self.answers: dict[int, tuple[Answer | Refused, bytes]] = {}  #: the newest, oldest first
        #: the highest number that was begun with, or of which nothing is known
        self.begun = greet.newest
        self.untold = 0  #: informs begun with, of which it was not told
        self.untold_bytes = 0
        self.is_behind = False  #: an answer could not be sent
        self.licence = ""  #: its number

    def remember(self, answer: Answer | Refused, body: bytes) -> None:
        self.answers[answer.number] = answer, body
        while (
            len(self.answers) > ANSWERS_KEPT
            or sum(len(kept) for _, kept in self.answers.values()) > ANSWER_BYTES
        ):
            del self.answers[next(iter(self.answers))]


class _Waiting:
    """A message that has arrived."""

    __slots__ = ("began", "body", "header", "is_given_up", "is_query", "sender")

    def __init__(
        self, sender: _RemoteSender, header: Direct, body: bytes, *, is_query: bool
    ) -> None:
        self.sender, self.header, self.body, self.is_query = sender, header, body, is_query
        self.is_given_up = False
        self.began = 0.0


class Inbox:
    """The receiving side of direct messages, for one slot."""

    def __init__(
        self,
        socket: InboxSocket,
        key: str,
        messages: Mapping[str, bool],
        notes: NoteBatch,
        clock: Callable[[], float],
        log: logging.Logger,
    ) -> None:
        self._socket = socket
        self._key = key
        self._messages = messages  #: messages handled here -> whether it is a query
        self._notes = notes
        self._clock = clock
        self._log = log
        self._barred: dict[str, None] = {}  #: licences that are not valid any more, oldest first
        self._senders: dict[bytes, _RemoteSender] = {}  #: by address
        self._sessions: dict[str, _RemoteSender] = {}  #: the one that greeted longest ago first
        self._waiting: deque[_Waiting] = deque()
        self._bytes = 0
        self._current: _Waiting | None = None  #: the message being handled
        self._delivery = 0  #: its number: they count down, to be told from central's

    @property
    def is_busy(self) -> bool:
        """Whether a message from here is handled."""
        return self._current is not None

    @property
    def has_message(self) -> bool:
        """Whether one waits to be handled."""
        return bool(self._waiting)

    def listen(self) -> None:
        """Take in arrived packets."""
        for _ in range(PACKETS):
            self._socket.is_paused = len(self._waiting) >= MOST_WAITING or self._bytes >= MOST_BYTES
            if self._socket.is_paused or (arrived := self._socket.receive()) is None:
                return
            address, frames = arrived
            try:
                if len(frames) != 1:
                    msg = f"{len(frames)} frames; a packet is one"
                    raise ProtocolError(msg)  # noqa: TRY301
                for header, body in direct.unpack_to_entrance(frames[0]):
                    self._take_in(address, header, body)
            except ProtocolError as error:
                self._refuse(address, str(error))

    def _refuse(
        self, address: bytes, text: str, number: int = 0, refusal: Refusal = Refusal.PROTOCOL
    ) -> None:
        self._log.warning("refused a direct message: %s", text)
        self._socket.send(address, pack_item(Refused(number, refusal, text)))

    def _take_in(self, address: bytes, header: Any, body: bytes) -> None:
        if isinstance(header, Greet):
            self._on_greet(address, header)
        elif (sender := self._senders.get(address)) is None:
            self._socket.send(address, pack_item(headers.Unknown()))
        elif isinstance(header, GiveUp):
            if (waiting := sender.open.get(header.request)) is not None:
                waiting.is_given_up = True
        else:
            self._on_direct(sender, header, body)

    def _on_greet(self, address: bytes, header: Greet) -> None:
        number = number_of(header.key, self._key)
        if header.version != PROTOCOL_VERSION or number is None or number in self._barred:
            self._refuse(
                address, f"version {header.version}, or no licence of central to send to this slot"
            )
            return
        if not (
            is_name(header.session) and is_name(header.module) and 0 <= header.newest < 1 << 62
        ):
            self._refuse(address, f"{header.session!r:.40} of {header.module!r:.40} is no sender")
            return
        sender = self._sessions.pop(header.session, None)
        if sender is None:
            sender = _RemoteSender(address, header)
            if len(self._sessions) >= MOST_SENDERS:
                session = next((name for name, one in self._sessions.items() if not one.open), None)
                self._senders.pop(
                    self._sessions.pop(session or next(iter(self._sessions))).address, None
                )
        self._sessions[header.session] = sender
        repeated = (
            [*sender.answers.values()] if sender.is_behind or sender.address != address else []
        )
        self._senders.pop(sender.address, None)
        sender.address, sender.is_behind, sender.licence = address, False, number
        self._senders[address] = sender
        first = max(sender.newest + 1, header.newest + 1 - _MOST_MISSING)
        sender.missing.update(range(first, header.newest + 1))
        sender.newest = max(sender.newest, header.newest)
        greeting = Greeting(header.newest, sorted(sender.missing), sorted(sender.open))
        self._socket.send(address, pack([*repeated, (greeting, b""), (Begun(sender.begun), b"")]))
        sender.missing = {
            number for number in sender.missing if number > header.newest - _MOST_MISSING
        }

    def bar(self, licences: Iterable[str]) -> None:
        """Take nothing more from those who have these licences. Who has a new one goes on where he
        was.
        """
        if not (barred := dict.fromkeys(licences)):
            return
        self._barred.update(barred)
        while len(self._barred) > _MOST_BARRED:
            del self._barred[next(iter(self._barred))]
        for address in [
            address for address, sender in self._senders.items() if sender.licence in self._barred
        ]:
            del self._senders[address]

    def _on_direct(self, sender: _RemoteSender, header: Direct, body: bytes) -> None:
        number, message = header.number, header.message
        if number <= sender.newest and number not in sender.missing:
            if number in sender.answers:
                self._socket.send(sender.address, pack([sender.answers[number]]))
            return  # it came twice
        sender.missing.discard(number)
        sender.newest = max(sender.newest, number)
        if message not in self._messages or len(body) > Limit.BODY:
            text, refusal = f"nothing here takes '{message:.60}' directly", Refusal.UNKNOWN
            if message in self._messages:
                text, refusal = (
                    f"a body of {len(body):,} bytes; at most {Limit.BODY:,} are allowed",
                    Refusal.PROTOCOL,
                )
            sender.remember(Refused(number, refusal, text), b"")
            self._refuse(sender.address, text, number, refusal)
            return
        waiting = _Waiting(sender, header, body, is_query=self._messages[message])
        if waiting.is_query:
            sender.open[number] = waiting
        self._waiting.append(waiting)
        self._bytes += len(body)

    def take(self) -> tuple[Deliver, bytes] | None:
        """The next message, to be handled now; None if there is none."""
        while self._waiting:
            waiting = self._waiting.popleft()
            self._bytes -= len(waiting.body)
            sender, number = waiting.sender, waiting.header.number
            sender.begun = max(sender.begun, number)
            if waiting.is_given_up:
                sender.open.pop(number, None)
                continue
            if not waiting.is_query:
                sender.untold += 1
                sender.untold_bytes += len(waiting.body)
            if sender.untold >= BEGUN_EVERY or sender.untold_bytes >= BEGUN_BYTES:
                sender.untold = sender.untold_bytes = 0
                self._socket.send(sender.address, pack_item(Begun(number)))
            self._current = waiting
            waiting.began = self._clock()
            self._delivery -= 1
            return Deliver(self._delivery, waiting.header.message), waiting.body
        return None

    def reply(self, header: Reply | Fail, body: bytes) -> None:
        """The handler has ended."""
        done, self._current = self._current, None
        if done is None:
            return
        outcome, failure, text = Outcome.DONE, "", ""
        if isinstance(header, Fail):
            outcome, failure, text = Outcome.FAILED, header.failure, header.text
        asked, sender, now = done.header, done.sender, self._clock()
        if done.is_query:
            answer = Answer(asked.number, outcome, failure, text)
            sender.open.pop(asked.number, None)
            sender.remember(answer, body)
            sender.is_behind |= not self._socket.send(sender.address, pack_item(answer, body))
        elif outcome is Outcome.FAILED:
            self._log.warning(
                "inform '%s' from %s failed: %s", asked.message, sender.module, failure
            )
        seconds = now - done.began
        note = Note(
            asked.message,
            sender.module,
            asked.origin,
            len(done.body),
            0.0,
            seconds,
            outcome,
            failure,
        )
        self._notes.handled(note, now)

    def close(self) -> None:
        """Begin with nothing more. Senders send their queries to somebody else; informs are lost
        and counted.
        """
        self.listen()
        while self._waiting:
            for waiting in self._waiting:
                if not waiting.is_query:
                    self._notes.lost(waiting.header.message, self._clock())
            self._waiting.clear()
            self._bytes = 0
            self.listen()
        for sender in self._senders.values():
            self._socket.send(
                sender.address, pack([(Begun(sender.newest), b""), (headers.Closing(), b"")])
            )
        self._socket.close()

    def drop(self) -> None:
        """Close without a word: begun messages have failed."""
        self._socket.close()
