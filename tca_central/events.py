"""Events that reach central, and the effects that it asks for.

The core sees nothing else of the world.

An *input* is an entry of the log of inputs: a packet with one or more requests, or any other event.
The log has them in the order in which they were handled. The same inputs always give the same
effects.
"""

from typing import NewType

import msgspec

from tca_wire.journal.facts import Entry, EntryTime
from tca_wire.packets.headers import ToCentral, ToModule
from tca_wire.vocabulary import Permission

ConnectionId = NewType("ConnectionId", bytes)

AWAY = b"away "
"""The start of the ids of connections that are awaited after a restart.

A client with such an id is refused.
"""


class RequestReceived(msgspec.Struct, frozen=True):
    """A request of a module has arrived.

    *time*, as in every event, is in seconds on a clock that never jumps.
    """

    time: EntryTime
    connection: ConnectionId
    header: ToCentral
    body: bytes = b""
    principal: str = ""
    """The sender's owner: a key's name, or "uid:N" for another user of this computer.

    It is "" for central's own user.
    """


class Arrived(msgspec.Struct, frozen=True, array_like=True, tag="p"):
    """A packet has arrived, as an input."""

    time: EntryTime
    connection: ConnectionId
    packet: bytes
    principal: str = ""


class BadBytes(msgspec.Struct, frozen=True, array_like=True, tag="b"):
    """Bytes have arrived that are not a packet."""

    time: EntryTime
    connection: ConnectionId
    why: str


class ConnectionLost(msgspec.Struct, frozen=True, array_like=True, tag="l"):
    """A connection closed without Bye: its process died or the network failed."""

    time: EntryTime
    connection: ConnectionId
    why: str = "its connection closed"


class Tick(msgspec.Struct, frozen=True, array_like=True, tag="t"):
    """Time has passed: due timers fire, as they do before any other event."""

    time: EntryTime


class ConfirmTasks(msgspec.Struct, frozen=True, array_like=True, tag="a"):
    """It is time to send the ids of unconfirmed tasks to their senders."""

    time: EntryTime


class KeysChanged(msgspec.Struct, frozen=True, array_like=True, tag="k"):
    """Keys were allowed or revoked. Connections of revoked keys are lost by events of their own."""

    time: EntryTime
    allowed: list[str] = []
    revoked: list[str] = []


class AccessRule(msgspec.Struct, frozen=True, array_like=True):
    """A permission for owners of some keys, as some modules. In patterns, * stands for any text."""

    keys: tuple[str, ...]
    modules: tuple[str, ...] = ("*",)
    allowed: tuple[tuple[Permission, tuple[str, ...]], ...] = ()


class PermissionsChanged(msgspec.Struct, frozen=True, array_like=True, tag="c"):
    """These rules apply from now on; None: all users may do everything."""

    time: EntryTime
    rules: tuple[AccessRule, ...] | None
    source: str = ""
    """The origin of the rules, for people."""


class DiskSpace(msgspec.Struct, frozen=True, array_like=True, tag="d"):
    """The disk of the journal has become nearly full (*is_low*), or has space again."""

    time: EntryTime
    is_low: bool


class LimitsSet(msgspec.Struct, frozen=True, array_like=True, tag="m"):
    """These limits apply from now on."""

    time: EntryTime
    memory: int
    """Bytes that central may hold for modules."""
    tap_depth: int
    """Listeners of wiretaps in one chain of causes."""
    task_depth: int
    """Depth of the task tree."""


class Restarted(msgspec.Struct, frozen=True, array_like=True, tag="r"):
    """Central was restarted with its whole state. Every connection has broken."""

    time: EntryTime
    away: EntryTime
    """Seconds without central (0: unknown)."""
    grace: EntryTime
    """Seconds after which a connection that is not back counts as lost."""
    hold: bool = False
    """No task starts until an operator resumes them, even if all connections are back."""
    skipped: int = 0
    """Number of ids to skip, which may have been given in a last second that the disk has lost."""
    aside: int = 0
    """Number of journal entries that were moved aside: no input leads to them."""


class Spared(msgspec.Struct, frozen=True, array_like=True, tag="s"):
    """Central crashed in a request of the packet before this. A replay refuses that request."""

    index: int


AdminEvent = ConfirmTasks | KeysChanged | PermissionsChanged | DiskSpace | LimitsSet | Restarted
Event = RequestReceived | BadBytes | ConnectionLost | Tick | AdminEvent
Input = Arrived | BadBytes | ConnectionLost | Tick | AdminEvent | Spared


class Transmit(msgspec.Struct, frozen=True):
    """Send a message to a connection."""

    connection: ConnectionId
    header: ToModule
    body: bytes = b""


class Record(msgspec.Struct, frozen=True):
    """Write an entry to the journal, before any Transmit of the same event."""

    entry: Entry
    failed: dict[int, str] = {}
    """The failed messages of the entry, in words for people, by their ids in the facts."""


Effect = Record | Transmit
