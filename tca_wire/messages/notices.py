"""Notices: broadcasts by which central reports joins, leaves and handlers. No module sends them."""

import msgspec

from tca_wire.messages.declarations import Broadcast, D, Message

PREFIX = "tca: "
"""The start of the names of central's own messages."""

COMMANDS = "tca "
"""The start of the names of commands (``tca status``): notices do not report them."""


class Notice(Message[D, None]):
    """A broadcast of central. Without a handler it is neither sent nor recorded."""

    message_class = Broadcast.message_class


class Arrival(msgspec.Struct, frozen=True):
    """A module has joined."""

    module: str
    """Its name, unique among those connected."""
    process: str
    """Its process: "host:pid"."""


class Departure(msgspec.Struct, frozen=True):
    """A module has left."""

    module: str
    why: str
    """In words, for display: it said goodbye, its connection closed, ..."""
    process: str = ""
    """Its process: "host:pid"."""
    is_lost: bool = False
    """Whether it left without a goodbye: its connection closed, or its process was silent."""


class HandlerCount(msgspec.Struct, frozen=True):
    """A message is handled by more or fewer modules than before."""

    message: str
    handlers: int
    """The number of modules that handle it now and have a thread for it."""


MODULE_JOINED = Notice[Arrival](f"{PREFIX}module joined", Arrival)
MODULE_LEFT = Notice[Departure](f"{PREFIX}module left", Departure)
HANDLERS_CHANGED = Notice[HandlerCount](f"{PREFIX}handlers changed", HandlerCount)
"""Sent for every message except notices."""

NOTICES: dict[str, Message[object, None]] = {
    notice.name: notice  # type: ignore[misc]
    for notice in (MODULE_JOINED, MODULE_LEFT, HANDLERS_CHANGED)
}
"""All notices, by name."""
