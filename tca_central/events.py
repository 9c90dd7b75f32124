"""Events that reach central, and the effects that it asks for. The core sees nothing else of the world."""

from typing import NewType

import msgspec

from tca_wire.journal.facts import Entry
from tca_wire.packets.headers import ToCentral, ToModule

ConnectionId = NewType("ConnectionId", bytes)


class RequestReceived(msgspec.Struct, frozen=True):
    """A module's message arrived. *time* in seconds, as in every event, on a clock that never jumps."""

    time: float
    connection: ConnectionId
    header: ToCentral
    body: bytes = b""
    principal: str = ""
    """Who sent it: the name of a key, "uid:N" for another user of this computer, "" for the one who runs central."""


class BadBytes(msgspec.Struct, frozen=True):
    """Bytes arrived that are no message."""

    time: float
    connection: ConnectionId
    why: str


class ConnectionLost(msgspec.Struct, frozen=True):
    """A connection closed without Bye: its process died or the network failed."""

    time: float
    connection: ConnectionId
    why: str = "its connection closed"


class Tick(msgspec.Struct, frozen=True):
    """Time has passed: due timers fire, as they do before any other event."""

    time: float


class KeysChanged(msgspec.Struct, frozen=True):
    """Keys may connect that might not before, or may no more; their connections are lost with events of their own."""

    time: float
    allowed: list[str] = []
    revoked: list[str] = []


Event = KeysChanged | RequestReceived | BadBytes | ConnectionLost | Tick


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
