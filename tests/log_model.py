"""A model of the replicated log's engine in memory, and a client of it with faults.

The client does what ``JetStreamLog`` does, without servers, threads and waits. Its link decides
which requests and answers are lost.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import count
from typing import NamedTuple, Protocol, TypeVar

from tca_central.replication.shared_log import (
    Deposed,
    Kind,
    LogUnreachable,
    Message,
    Sign,
    cut,
)

PATIENCE = 15.0
REPLY_WITHIN = 1.0
BATCH = 500

T = TypeVar("T")


class Stored(NamedTuple):
    """A message in the model."""

    message: Message
    mark: str  #: of the request that appended it
    at: float  #: when the engine got it


class Time:
    """A clock that moves only when a client waits."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __call__(self) -> float:
        """Return the seconds."""
        return self.seconds


class LogModel:
    """The engine: a stream of messages, the large bodies beside it, and its clients.

    Args:
        clock: Tells the time in seconds. By default it moves only when a client waits.
    """

    def __init__(self, clock: Callable[[], float] | None = None) -> None:
        self.clock = clock or Time()
        self.first = 1  #: the number of the first message that is kept
        self.kept: list[Stored] = []
        self.marks: list[str] = []  #: the marks of all messages ever appended
        self.bodies: dict[str, dict[int, tuple[bytes, int]]] = {}  #: pieces, with their number
        self.clients: list[ModelLog] = []

    @property
    def last(self) -> int:
        """The number of the last message ever appended."""
        return len(self.marks)

    def append(self, stored: Stored) -> bool:
        """Append a message if its number is the next one. Return whether it is."""
        if stored.message.sequence != self.last + 1:
            return False
        self.marks.append(stored.mark)
        self.kept.append(stored)
        return True

    def message(self, sequence: int) -> Stored | None:
        """Return a message; None if it is not there."""
        return self.kept[sequence - self.first] if self.first <= sequence <= self.last else None

    def read(self, after: int) -> list[Stored]:
        """Return messages that follow *after*."""
        begin = max(0, after + 1 - self.first)
        return self.kept[begin : begin + BATCH]

    def remove(self, before: int) -> None:
        """Remove the messages before a number."""
        if (number := min(before, self.last + 1) - self.first) > 0:
            del self.kept[:number]
            self.first += number


class Lost(Exception):
    """A request or its answer was lost."""


class Link(Protocol):
    """The way between a client and the engine. It decides about faults."""

    def send(self, apply: Callable[[], T]) -> T:
        """Carry a request to the engine, and its answer back.

        *apply* lets the engine handle the request. Call it never, later, or now. Raises Lost if no
        answer comes. Other errors go through the client: its process has ended.
        """

    def wait(self, seconds: float, is_over: Callable[[], bool]) -> None:
        """Wait some seconds, or until *is_over*."""

    def carries_signs(self) -> bool:
        """Whether others receive the client's signs of life now."""


class SoundLink:
    """A link without faults and waits."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock

    def send(self, apply: Callable[[], T]) -> T:
        """Handle a request at once."""
        return apply()

    def wait(self, seconds: float, is_over: Callable[[], bool]) -> None:
        """Move the clock, if it moves only so."""
        if isinstance(self._clock, Time) and not is_over():
            self._clock.seconds += seconds

    def carries_signs(self) -> bool:
        """Return True."""
        return True


class ModelLog:
    """A client of the model. See ``SharedLog`` for its methods.

    Args:
        model: The engine.
        link: The way to it (default: one without faults).
        name: The mark of its messages.
    """

    def __init__(self, model: LogModel, link: Link | None = None, name: str = "") -> None:
        self.model, self._link = model, link or SoundLink(model.clock)
        self.name = name or f"client {len(model.clients)}"
        self.is_closed = False
        self.gives_up: Callable[[], bool] = lambda: False
        self.patience = PATIENCE  #: seconds after which it gives up the engine
        self._serials = count()
        self._sign: Sign | None = None
        self._heard: tuple[float, Sign] | None = None  #: the last sign that others received
        self._opened, self._stamp = model.clock(), 0.0
        self._has_read = False
        model.clients.append(self)

    # --- messages ---------------------------------------------------------------------------------

    def append(
        self,
        kind: Kind,
        pieces: Sequence[bytes],
        after: int,
        *,
        part: int = 0,
        is_more: bool = False,
    ) -> int:
        """Append pieces of a record after message *after*, one after the other."""
        for number, data in enumerate(pieces):
            follows = is_more or number + 1 < len(pieces)
            message = Message(after + number + 1, kind, data, part + number, follows)
            self._append_one(Stored(message, f"{self.name} {next(self._serials)}", 0.0))
        return after + len(pieces)

    def _append_one(self, stored: Stored) -> None:
        model, until = self.model, self.model.clock() + self.patience
        while not self._until_answered(lambda: model.append(stored._replace(at=model.clock()))):
            if self._is_appended(stored):
                return
            self._link.wait(0.05, lambda: False)
            if model.clock() > until:
                raise _unreachable()

    def _is_appended(self, stored: Stored) -> bool:
        """Whether an earlier attempt, whose answer was lost, has appended a message."""
        model, number = self.model, stored.message.sequence
        last = self._until_answered(lambda: model.last)
        found = self._until_answered(lambda: model.message(number))
        if found is not None and found.mark == stored.mark:
            return True
        if found is not None or last >= number:
            raise Deposed("another central leads: it has written to the log")
        return False

    def read(self, after: int, seconds: float) -> list[Message]:
        """Return messages that follow *after*; wait for one if there are none."""
        model = self.model
        found = self._until_answered(lambda: model.read(after))
        if not found:
            self._link.wait(seconds, lambda: model.last > after)
            found = self._until_answered(lambda: model.read(after))
        if found:
            self._stamp, self._has_read = found[-1].at, True
        return [one.message for one in found]

    def last(self) -> int:
        """Return the number of the last message."""
        return self._until_answered(lambda: self.model.last)

    def remove(self, before: int) -> None:
        """Remove the messages before a number, or none."""
        self._once(lambda: self.model.remove(before))

    def age(self) -> float:
        """Return the seconds since the last message that was read."""
        return self.model.clock() - self._stamp if self._has_read else 0.0

    # --- signs of life ----------------------------------------------------------------------------

    def give_sign(self, sign: Sign | None) -> None:
        """Give this sign of life from now on; None: give no more."""
        self._note_heard()
        self._sign = sign
        self._note_heard()

    def signs(self) -> list[tuple[float, Sign]]:
        """Return each follower's last sign of life since this client began."""
        newest: dict[str, tuple[float, Sign]] = {}
        for one in self.model.clients:
            one._note_heard()
            if (heard := one._heard) is not None and heard[0] >= self._opened:
                known = newest.get(heard[1].member)
                if known is None or known[0] <= heard[0]:
                    newest[heard[1].member] = heard
        now = self.model.clock()
        return [(now - at, sign) for at, sign in newest.values()]

    def _note_heard(self) -> None:
        if self._sign is not None and not self.is_closed and self._link.carries_signs():
            self._heard = self.model.clock(), self._sign

    # --- large bodies -----------------------------------------------------------------------------

    def put_body(self, name: str, data: bytes) -> None:
        """Store a large body, piece by piece."""
        pieces = cut(data)
        for number, piece in enumerate(pieces):
            self._until_answered(partial(self._put, name, number, piece, len(pieces)))

    def _put(self, name: str, number: int, piece: bytes, pieces: int) -> None:
        self.model.bodies.setdefault(name, {})[number] = piece, pieces

    def body(self, name: str) -> bytes | None:
        """Return a large body; None if it is missing or incomplete."""
        found = self._until_answered(lambda: dict(self.model.bodies.get(name, {})))
        if 0 not in found:
            return None
        wanted = range(found[0][1])
        return b"".join(found[one][0] for one in wanted) if found.keys() >= set(wanted) else None

    def remove_body(self, name: str) -> None:
        """Remove a large body, or leave it."""
        self._once(lambda: self.model.bodies.pop(name, None))

    def bodies(self) -> list[str]:
        """Return the names of all large bodies."""
        return self._until_answered(
            lambda: [name for name, one in self.model.bodies.items() if 0 in one]
        )

    def close(self) -> None:
        """Give no more signs, and disconnect."""
        self._note_heard()
        self.is_closed = True

    # --- requests ---------------------------------------------------------------------------------

    def _until_answered(self, apply: Callable[[], T]) -> T:
        """Repeat a request until the engine answers. Raises LogUnreachable."""
        until = self.model.clock() + self.patience
        while True:
            try:
                return self._link.send(apply)
            except Lost:
                if not self._may_retry(until):
                    raise _unreachable() from None

    def _once(self, apply: Callable[[], object]) -> None:
        with suppress(Lost):
            self._link.send(apply)

    def _may_retry(self, until: float) -> bool:
        """Wait for an answer that does not come. Return whether another attempt is due."""
        self._link.wait(REPLY_WITHIN, lambda: False)
        return self.model.clock() < until


def _unreachable() -> LogUnreachable:
    return LogUnreachable("the log does not answer: more than half of its servers must run")
