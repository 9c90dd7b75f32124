"""What central needs of a replicated log: an append that only one central's knowledge permits.

Each message has a sequence number, without gaps. An append names the last number that its writer
knows, and fails if the log has a later one. So whoever appends has read everything before, and two
centrals never both extend the log: the log itself is the lock.
"""

import re
from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple, Protocol

import msgspec

from tca_central.errors import CentralError

PIECE_BYTES = 512 << 10
"""Bytes in one message at most. The engine's limit is a mebibyte, with its headers."""

_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")


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
    is_more: bool = False  #: whether the next message continues the record


class Sign(msgspec.Struct, frozen=True):
    """A sign of life of a central, which is not in the log."""

    member: str  #: the process, as "host:pid"
    address: str  #: where modules find it when it leads
    is_leader: bool
    last: int  #: the last message that it has written or read


class Deposed(CentralError):
    """Another central has appended to the log."""


class LogUnreachable(CentralError):
    """The log did not answer for too long: too few of its servers run, or none can be reached."""


class SharedLog(Protocol):
    """A replicated log of one run after the other."""

    def append(
        self, kind: Kind, pieces: Sequence[bytes], after: int, *, is_more: bool = False
    ) -> int:
        """Append a record in pieces after message *after*. Return the number of its last piece.

        With *is_more* other pieces of the record follow later. Raises Deposed if another writer's
        message follows *after*. Nothing is appended then, or pieces without an end, which readers
        discard. Raises LogUnreachable.
        """

    def read(self, after: int, seconds: float) -> list[Message]:
        """Return messages that follow *after*, in order.

        If there are none, wait up to *seconds* for one. The first number is higher than *after* + 1
        if messages were removed. Raises LogUnreachable.
        """

    def remove(self, before: int) -> None:
        """Remove the messages before a number, soon or never."""

    def give_sign(self, sign: Sign) -> None:
        """Give this sign of life from now on, several times a second."""

    def signs(self) -> dict[str, tuple[float, Sign]]:
        """Return each member's last sign of life, and the seconds since then."""

    def close(self) -> None:
        """Give no more signs, and disconnect."""


def cut(data: bytes) -> list[bytes]:
    """Cut a record into pieces that fit into messages."""
    if len(data) <= PIECE_BYTES:
        return [data]
    view = memoryview(data)
    return [bytes(view[at : at + PIECE_BYTES]) for at in range(0, len(data), PIECE_BYTES)]


def log_in(address: str) -> tuple[list[str], str]:
    """Return the servers and the name in the address of a log. Raises CentralError.

    Example:
        >>> log_in("nats://10.0.0.1:4222,10.0.0.2/rover")
        (['nats://10.0.0.1:4222', 'nats://10.0.0.2'], 'rover')
    """
    scheme, _, rest = address.partition("://")
    servers, _, name = rest.partition("/")
    found = [f"nats://{one.strip()}" for one in servers.split(",") if one.strip()]
    if scheme != "nats" or not found or not _NAME.fullmatch(name := name or "robot"):
        msg = (
            f"'{address}' is not the address of a log: use nats://host:port,host:port/NAME, "
            "with letters, digits, - and _ in NAME"
        )
        raise CentralError(msg)
    return found, name
