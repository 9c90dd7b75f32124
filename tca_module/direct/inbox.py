"""A slot's entrance for direct messages.

Senders greet with the licence that central gave them, and number their messages. No message is
handled twice. An answer is retained for a while, because it may be lost on its way. The slot starts
a direct message only when it handles nothing else. When the inbox is full, further messages wait in
the socket and at their senders. Malformed packets, unknown messages and senders without a licence
are refused.
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

MOST_WAITING, MOST_BYTES = 2000, 128 << 20  # waiting messages and bytes; more stay in the socket
# One more displaces the sender that greeted longest ago, if possible one without open queries.
MOST_SENDERS = 256
ANSWERS_KEPT, ANSWER_BYTES = 64, 1 << 20  # retained answers for each sender, in case they are lost
BEGUN_EVERY, BEGUN_BYTES = 64, 1 << 20  # informs, or bytes, begun before their sender gets a Begun
PACKETS = 256  # packets read at a time
_MOST_BARRED = 20_000  # licences that are remembered as no longer valid
_MOST_MISSING = 2000  # newest numbers of a sender that may count as missing; fewer are under way


class InboxSocket(Protocol):
    """A socket on which packets of many senders arrive."""

    is_paused: bool
    """While true, packets stay in the socket."""

    def receive(self) -> tuple[bytes, list[bytes]] | None:
        """Return the sender and the frames of the next packet, or None."""

    def send(self, to: bytes, packet: bytes) -> bool:
        """Send a packet; return whether it left."""

    def close(self) -> None:
        """Close. Packets already sent still leave."""


class _RemoteSender:
    """A sender, with the numbers of its messages and the answers to its queries."""

    def __init__(self, address: bytes, greet: Greet) -> None:
        self.address = address
        self.module = greet.module
        self.newest = greet.newest
        self.missing: set[int] = set()  #: lower numbers that have not arrived, and still may
        self.open_queries: dict[int, _DirectMessage] = {}  #: number -> unanswered query
        #: number -> answer; the newest ones, oldest first
        self.answers: dict[int, tuple[Answer | Refused, bytes]] = {}
        #: the highest number of a begun message, or of a message sent before the first greeting
        self.begun = greet.newest
        self.unreported = 0  #: number of informs begun since the last Begun
        self.unreported_bytes = 0
        self.is_behind = False  #: an answer could not be sent
        self.licence = ""  #: the number of its licence

    def remember(self, answer: Answer | Refused, body: bytes) -> None:
        self.answers[answer.number] = answer, body
        while (
            len(self.answers) > ANSWERS_KEPT
            or sum(len(kept) for _, kept in self.answers.values()) > ANSWER_BYTES
        ):
            del self.answers[next(iter(self.answers))]


class _DirectMessage:
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
        self._messages = messages  #: handled message -> whether it is a query
        self._notes = notes
        self._clock = clock
        self._log = log
        self._barred: dict[str, None] = {}  #: licences that are no longer valid, oldest first
        self._senders: dict[bytes, _RemoteSender] = {}  #: address -> sender
        #: session -> sender; the one that greeted longest ago first
        self._sessions: dict[str, _RemoteSender] = {}
        self._waiting: deque[_DirectMessage] = deque()
        self._bytes = 0
        self._current: _DirectMessage | None = None  #: the message being handled
        self._delivery = 0  #: number of the newest delivery: -1, -2, ...; central's are positive

    @property
    def is_busy(self) -> bool:
        """Whether a message of this inbox is being handled."""
        return self._current is not None

    @property
    def has_message(self) -> bool:
        """Whether a message waits to be handled."""
        return bool(self._waiting)

    def listen(self) -> None:
        """Process arrived packets."""
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
                    self._process(address, header, body)
            except ProtocolError as error:
                self._refuse(address, str(error))

    def _refuse(
        self, address: bytes, text: str, number: int = 0, refusal: Refusal = Refusal.PROTOCOL
    ) -> None:
        self._log.warning("refused a direct message: %s", text)
        self._socket.send(address, pack_item(Refused(number, refusal, text)))

    def _process(self, address: bytes, header: Any, body: bytes) -> None:
        if isinstance(header, Greet):
            self._on_greet(address, header)
        elif (sender := self._senders.get(address)) is None:
            self._socket.send(address, pack_item(headers.Unknown()))
        elif isinstance(header, GiveUp):
            if (query := sender.open_queries.get(header.request)) is not None:
                query.is_given_up = True
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
            text = f"{header.session!r:.40} of {header.module!r:.40} is not a sender"
            self._refuse(address, text)
            return
        sender = self._sessions.pop(header.session, None)
        if sender is None:
            sender = _RemoteSender(address, header)
            if len(self._sessions) >= MOST_SENDERS:
                session = next(
                    (name for name, one in self._sessions.items() if not one.open_queries), None
                )
                displaced = self._sessions.pop(session or next(iter(self._sessions)))
                self._senders.pop(displaced.address, None)
        self._sessions[header.session] = sender
        has_missed = sender.is_behind or sender.address != address
        repeated = list(sender.answers.values()) if has_missed else []
        self._senders.pop(sender.address, None)
        sender.address, sender.is_behind, sender.licence = address, False, number
        self._senders[address] = sender
        first = max(sender.newest + 1, header.newest + 1 - _MOST_MISSING)
        sender.missing.update(range(first, header.newest + 1))
        sender.newest = max(sender.newest, header.newest)
        greeting = Greeting(header.newest, sorted(sender.missing), sorted(sender.open_queries))
        self._socket.send(address, pack([*repeated, (greeting, b""), (Begun(sender.begun), b"")]))
        sender.missing = {
            number for number in sender.missing if number > header.newest - _MOST_MISSING
        }

    def bar(self, licences: Iterable[str]) -> None:
        """Refuse the senders with these licences.

        A sender that greets with a new licence continues where it was.
        """
        self._barred.update(dict.fromkeys(licences))
        while len(self._barred) > _MOST_BARRED:
            del self._barred[next(iter(self._barred))]
        for address, sender in list(self._senders.items()):
            if sender.licence in self._barred:
                del self._senders[address]

    def _on_direct(self, sender: _RemoteSender, header: Direct, body: bytes) -> None:
        number, message = header.number, header.message
        if number <= sender.newest and number not in sender.missing:  # a duplicate
            if number in sender.answers:
                self._socket.send(sender.address, pack([sender.answers[number]]))
            return
        sender.missing.discard(number)
        sender.newest = max(sender.newest, number)
        if message not in self._messages or len(body) > Limit.BODY:
            text, refusal = f"no handler here accepts '{message:.60}' directly", Refusal.UNKNOWN
            if message in self._messages:
                text = f"a body of {len(body):,} bytes; at most {Limit.BODY:,} are allowed"
                refusal = Refusal.PROTOCOL
            sender.remember(Refused(number, refusal, text), b"")
            self._refuse(sender.address, text, number, refusal)
            return
        arrived = _DirectMessage(sender, header, body, is_query=self._messages[message])
        if arrived.is_query:
            sender.open_queries[number] = arrived
        self._waiting.append(arrived)
        self._bytes += len(body)

    def next_message(self) -> tuple[Deliver, bytes] | None:
        """Return the next message, to be handled now, or None."""
        while self._waiting:
            message = self._waiting.popleft()
            self._bytes -= len(message.body)
            sender, number = message.sender, message.header.number
            sender.begun = max(sender.begun, number)
            if message.is_given_up:
                sender.open_queries.pop(number, None)
                continue
            if not message.is_query:
                sender.unreported += 1
                sender.unreported_bytes += len(message.body)
            if sender.unreported >= BEGUN_EVERY or sender.unreported_bytes >= BEGUN_BYTES:
                sender.unreported = sender.unreported_bytes = 0
                self._socket.send(sender.address, pack_item(Begun(number)))
            self._current = message
            message.began = self._clock()
            self._delivery -= 1
            return Deliver(self._delivery, message.header.message), message.body
        return None

    def reply(self, header: Reply | Fail, body: bytes) -> None:
        """Send the outcome of the handler that has ended."""
        done, self._current = self._current, None
        if done is None:
            return
        outcome, failure, text = Outcome.DONE, "", ""
        if isinstance(header, Fail):
            outcome, failure, text = Outcome.FAILED, header.failure, header.text
        asked, sender, now = done.header, done.sender, self._clock()
        if done.is_query:
            answer = Answer(asked.number, outcome, failure, text)
            sender.open_queries.pop(asked.number, None)
            sender.remember(answer, body)
            sender.is_behind |= not self._socket.send(sender.address, pack_item(answer, body))
        elif outcome is Outcome.FAILED:
            what = f"inform '{asked.message}' from {sender.module}"
            self._log.warning("%s failed: %s", what, failure)
        size, seconds = len(done.body), now - done.began
        self._notes.add_handled(
            Note(asked.message, sender.module, asked.origin, size, 0.0, seconds, outcome, failure),
            now,
        )

    def close(self) -> None:
        """Start nothing more, and close.

        Senders of waiting queries send them to other handlers. Waiting informs are lost, and the
        losses are counted.
        """
        self.listen()
        while self._waiting:
            for message in self._waiting:
                if not message.is_query:
                    self._notes.add_lost(message.header.message, self._clock())
            self._waiting.clear()
            self._bytes = 0
            self.listen()
        for sender in self._senders.values():
            last = pack([(Begun(sender.newest), b""), (headers.Closing(), b"")])
            self._socket.send(sender.address, last)
        self._socket.close()

    def drop(self) -> None:
        """Close without notice to senders, for whom begun messages then fail."""
        self._socket.close()
