"""Events that reach central, and the effects that it asks for. The core sees nothing else of the
world.

An *input* is what the log of inputs keeps, in the order in which it was handled: a packet as it
came, which holds a request or more, or any other event. The same inputs always give the same
effects.
"""

from typing import NewType

import msgspec

from tca_wire.journal.facts import Entry, EntryTime
from tca_wire.packets.headers import ToCentral, ToModule
from tca_wire.vocabulary import Permission

ConnectionId = NewType("ConnectionId", bytes)

AWAY = b"away "
"""Begins the id of a connection that is awaited after a restart; a client that calls itself so is
turned away.
"""


class RequestReceived(msgspec.Struct, frozen=True):
    """A module's message arrived. *time* in seconds, as in every event, on a clock that never
    jumps.
    """

    time: EntryTime
    connection: ConnectionId
    header: ToCentral
    body: bytes = b""
    principal: str = ""
    """Who sent it: the name of a key, "uid:N" for another user of this computer, "" for the one who
    runs central.
    """


class Arrived(msgspec.Struct, frozen=True, array_like=True, tag="p"):
    """A packet has arrived, as an input."""

    time: EntryTime
    connection: ConnectionId
    packet: bytes
    principal: str = ""


class BadBytes(msgspec.Struct, frozen=True, array_like=True, tag="b"):
    """Bytes arrived that are no message."""

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


class TellAll(msgspec.Struct, frozen=True, array_like=True, tag="a"):
    """Those who were not told yet of the quiet tasks that they have sent are to be told now."""

    time: EntryTime


class KeysChanged(msgspec.Struct, frozen=True, array_like=True, tag="k"):
    """Keys may connect that might not before, or may no more; their connections are lost with
    events of their own.
    """

    time: EntryTime
    allowed: list[str] = []
    revoked: list[str] = []


class AccessRule(msgspec.Struct, frozen=True, array_like=True):
    """What the owners of some keys may do, as some modules. All are patterns, in which * stands for
    any text.
    """

    keys: tuple[str, ...]
    modules: tuple[str, ...] = ("*",)
    allowed: tuple[tuple[Permission, tuple[str, ...]], ...] = ()


class PermissionsChanged(msgspec.Struct, frozen=True, array_like=True, tag="c"):
    """From now on these rules say who may do what; None: whoever gets in may do everything."""

    time: EntryTime
    rules: tuple[AccessRule, ...] | None
    source: str = ""
    """Where they come from, for people."""


class DiskSpace(msgspec.Struct, frozen=True, array_like=True, tag="d"):
    """The disk of the journal has become nearly full (*is low*), or has room again."""

    time: EntryTime
    is_low: bool


class LimitsSet(msgspec.Struct, frozen=True, array_like=True, tag="m"):
    """From now on these limits hold."""

    time: EntryTime
    memory: int
    """Bytes that central may hold of what modules send."""
    tap_depth: int
    """Listeners of wiretaps in one chain of causes."""
    task_depth: int
    """Tasks above one another."""


class Restarted(msgspec.Struct, frozen=True, array_like=True, tag="r"):
    """Central was away, and is back with all that it knew; every connection has broken
    meanwhile.
    """

    time: EntryTime
    away: EntryTime
    """Seconds, as far as they are known (0: not)."""
    grace: EntryTime
    """Seconds after which a connection that has not come back counts as lost."""
    hold: bool = False
    """No task starts until somebody says so, not only until all are back."""
    skipped: int = 0
    """Numbers that are not given: they may have been, and that was lost with the disk's last
    second.
    """
    aside: int = 0
    """Entries that the journal had of what was lost."""


class Spared(msgspec.Struct, frozen=True, array_like=True, tag="s"):
    """As an input: central failed in this request of the packet before, which is refused when it
    comes back.
    """

    index: int


OfAll = TellAll | KeysChanged | PermissionsChanged | DiskSpace | LimitsSet | Restarted
Event = RequestReceived | BadBytes | ConnectionLost | Tick | OfAll
Input = Arrived | BadBytes | ConnectionLost | Tick | OfAll | Spared


class Transmit(msgspec.Struct, frozen=True):
    """Send this message to that connection."""

    connection: ConnectionId
    header: ToModule
    body: bytes = b""


class Record(msgspec.Struct, frozen=True):
    """Write this entry to the journal before any Transmit of the same event leaves."""

    entry: Entry
    failed: dict[int, str] = {}
    """The parts of it that failed, in words for people, by their ids in the facts."""


Effect = Record | Transmit
