"""Events that reach central, and the effects that central asks for.

The core sees nothing else of the world.

An *input* is an entry of the log of inputs: a packet with one or more requests, or any other event.
The log has the inputs in the order in which central handled them. The same inputs always give the
same effects.
"""

from typing import NewType

import msgspec

from tca_wire.journal.facts import Entry, EntryTime
from tca_wire.packets.headers import ToCentral, ToModule
from tca_wire.vocabulary import Permission

ConnectionId = NewType("ConnectionId", bytes)

AWAY = b"away "
"""The first bytes of a connection's id after a restart, until the connection is back.

A client that uses such an id itself is refused.
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
    """A packet has arrived. The core gets its requests one by one (inputs.py)."""

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
    """A connection closed without a ``Bye``: its process died or the network failed."""

    time: EntryTime
    connection: ConnectionId
    why: str = "its connection closed"


class Tick(msgspec.Struct, frozen=True, array_like=True, tag="t"):
    """Time has passed: due timers fire, as they do before any other event."""

    time: EntryTime


class ConfirmTasks(msgspec.Struct, frozen=True, array_like=True, tag="a"):
    """It is time to send the ids of ``quiet`` tasks (``Send.quiet``) to the senders."""

    time: EntryTime


class KeysChanged(msgspec.Struct, frozen=True, array_like=True, tag="k"):
    """Keys were allowed or revoked.

    For each connection of a revoked key, a ``ConnectionLost`` follows.
    """

    time: EntryTime
    allowed: list[str] = []
    revoked: list[str] = []


class AccessRule(msgspec.Struct, frozen=True, array_like=True):
    """A rule: programs with one of *keys* and a name of *modules* may do what *allowed* lists.

    All names are patterns, in which * stands for any text.
    """

    keys: tuple[str, ...]
    modules: tuple[str, ...] = ("*",)
    allowed: tuple[tuple[Permission, tuple[str, ...]], ...] = ()


class PermissionsChanged(msgspec.Struct, frozen=True, array_like=True, tag="c"):
    """New rules apply from now on. If *rules* is None, all users may do everything."""

    time: EntryTime
    rules: tuple[AccessRule, ...] | None
    source: str = ""
    """The origin of the rules, as a text for people."""


class DiskSpace(msgspec.Struct, frozen=True, array_like=True, tag="d"):
    """The disk of the journal has become nearly full (*is_low*), or has space again."""

    time: EntryTime
    is_low: bool


class Standby(msgspec.Struct, frozen=True, array_like=True):
    """A central that follows the replicated log, and may lead later."""

    process: str
    """The process, as "host:pid"."""
    address: str
    """Where modules find it when it leads."""
    behind: int = 0
    """How many seconds ago the leader appended what it has yet to read, roughly."""
    is_manual: bool = False
    """Whether a person must let it lead."""


class MembersChanged(msgspec.Struct, frozen=True, array_like=True, tag="n"):
    """The centrals with the same replicated log have changed: process *leader* leads."""

    time: EntryTime
    leader: str
    address: str
    standbys: tuple[Standby, ...] = ()


class LimitsSet(msgspec.Struct, frozen=True, array_like=True, tag="m"):
    """New limits apply from now on."""

    time: EntryTime
    memory: int
    """The most bytes that central may hold for modules."""
    tap_depth: int
    """The greatest number of wiretaps' listeners in one chain of causes."""
    task_depth: int
    """The greatest depth of the task tree."""
    keeps_inputs: bool = True
    """Whether inputs are stored, so that the run can continue after a restart."""


class Restarted(msgspec.Struct, frozen=True, array_like=True, tag="r"):
    """Central was restarted with its whole state. Every connection has broken."""

    time: EntryTime
    away: EntryTime
    """Seconds without central (0: unknown)."""
    grace: EntryTime
    """Seconds after which a connection that is not back counts as lost."""
    hold: bool = False
    """Whether tasks wait until an operator lets them start, even if all connections are back."""
    skipped: int = 0
    """Number of ids to skip.

    The disk may have lost the last second before a power cut. Central may have given these ids in
    that second.
    """
    aside: int = 0
    """Number of journal entries that were moved to another file.

    The replay of the inputs did not produce these entries.
    """


class RequestSkipped(msgspec.Struct, frozen=True, array_like=True, tag="s"):
    """The input before this one is a packet. Central crashed in one of its requests.

    A replay of the packet refuses that request.
    """

    index: int
    """The index of the request in the packet."""


AdminEvent = (
    ConfirmTasks
    | KeysChanged
    | PermissionsChanged
    | DiskSpace
    | MembersChanged
    | LimitsSet
    | Restarted
)
Event = RequestReceived | BadBytes | ConnectionLost | Tick | AdminEvent
Input = Arrived | BadBytes | ConnectionLost | Tick | AdminEvent | RequestSkipped


class Transmit(msgspec.Struct, frozen=True):
    """Send a message to a connection."""

    connection: ConnectionId
    header: ToModule
    body: bytes = b""


class Record(msgspec.Struct, frozen=True):
    """Write an entry to the journal, before any Transmit of the same event."""

    entry: Entry
    failed: dict[int, str] = {}
    """By id in the facts: the failed messages of the entry, in words for people."""


Effect = Record | Transmit
