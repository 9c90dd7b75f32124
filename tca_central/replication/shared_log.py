"""What central needs of a replicated log: an append that only one central's knowledge permits.

Each message has a sequence number, without gaps. An append names the last number that its writer
knows, and fails if the log has a later one. So whoever appends has read everything before, and two
centrals never both extend the log: the log itself is the lock.
"""

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import NamedTuple, Protocol

import msgspec

from tca_central.errors import CentralError
from tca_wire import log_address

PIECE_BYTES = 512 << 10
"""Bytes in one message at most. The engine's limit is a mebibyte, with its headers."""


class Kind(StrEnum):
    """What a message of the log holds."""

    TERM = "term"  #: the start of a leader's term
    TURN = "turn"  #: inputs that one turn of central's loop has handled
    IMAGE = "image"  #: the state after some turn


class Message(NamedTuple):
    """A message of the log: a record, or a piece of one."""

    sequence: int
    kind: Kind
    data: bytes
    part: int = 0  #: the number of the piece
    is_more: bool = False  #: whether another piece of the record follows


class Sign(msgspec.Struct, frozen=True):
    """A sign of life of a follower, which is not in the log."""

    member: str  #: the process, as "host:pid"
    address: str  #: where modules find it when it leads
    last: int  #: the last message that it has read
    is_manual: bool = False  #: whether a person must let it lead


class Deposed(CentralError):
    """Another central has appended to the log."""


class LogUnreachable(CentralError):
    """The log did not answer for too long: too few of its servers run, or none can be reached."""


class SharedLog(Protocol):
    """A replicated log of one run after the other, and the large bodies of the present one."""

    name: str
    """The name of the log."""
    gives_up: Callable[[], bool]
    """Whether calls that wait for the log fail, because this program must end."""

    def append(
        self,
        kind: Kind,
        pieces: Sequence[bytes],
        after: int,
        *,
        part: int = 0,
        is_more: bool = False,
    ) -> int:
        """Append pieces of a record after message *after*. Return the number of the last one.

        *part* is the number of the first piece. With *is_more* other pieces follow later. Raises
        Deposed if another writer's message follows *after*. Nothing is appended then, or pieces
        without an end, which readers discard. Raises LogUnreachable.
        """

    def read(self, after: int, seconds: float) -> list[Message]:
        """Return messages that follow *after*, in order.

        If there are none, wait up to *seconds* for one. The first number is higher than *after* + 1
        if messages were removed. Raises LogUnreachable.
        """

    def last(self) -> int:
        """Return the number of the last message; 0 if there was none. Raises LogUnreachable."""

    def remove(self, before: int) -> None:
        """Remove the messages before a number, soon or never."""

    def age(self) -> float:
        """Return the seconds since the last message, by the clock of the log.

        It is 0 if the log does not tell.
        """

    def give_sign(self, sign: Sign | None) -> None:
        """Give this sign of life from now on, several times a second; None: give no more."""

    def signs(self) -> list[tuple[float, Sign]]:
        """Return each follower's last sign of life, and the seconds since then."""

    def put_body(self, name: str, data: bytes) -> None:
        """Store a large body. One thread beside that of the log may call this.

        This and the next three raise LogUnreachable.
        """

    def body(self, name: str) -> bytes | None:
        """Return a large body; None if it is missing or incomplete."""

    def remove_body(self, name: str) -> None:
        """Remove a large body, soon or never."""

    def bodies(self) -> list[str]:
        """Return the names of all large bodies."""

    def close(self) -> None:
        """Give no more signs, and disconnect."""


def cut(data: bytes) -> list[bytes]:
    """Cut a record into pieces that fit into messages."""
    if len(data) <= PIECE_BYTES:
        return [data]
    view = memoryview(data)
    return [bytes(view[at : at + PIECE_BYTES]) for at in range(0, len(data), PIECE_BYTES)]


def log_in(address: str) -> tuple[list[str], str]:
    """Return the servers and the name in the address of a log. Raises CentralError."""
    try:
        return log_address.log_in(address)
    except ValueError as error:
        raise CentralError(str(error)) from None
