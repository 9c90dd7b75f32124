"""Notices: broadcasts of central itself about modules. Any module may handle them, no module sends
them.
"""

import msgspec

from tca_wire.messages.declarations import Broadcast, D, Message

PREFIX = "tca: "
"""Names of messages that begin so are central's own."""

COMMANDS = "tca "
"""Modules whose names begin so are commands that people type (``tca status``): notices do not tell
of them.
"""


class Notice(Message[D, None]):
    """A broadcast of central's. Nothing is sent or recorded while nobody listens."""

    message_class = Broadcast.message_class


class Arrival(msgspec.Struct, frozen=True):
    """A module has joined, or another program that is no command of people's."""

    module: str
    """Its name, unique among those connected."""
    process: str
    """Its process: "host:pid"."""


class Departure(msgspec.Struct, frozen=True):
    """A module has left, or another program that is no command of people's."""

    module: str
    why: str
    """In words, for people: it said goodbye, its connection closed, ..."""
    process: str = ""
    """Its process: "host:pid"."""
    is_lost: bool = False
    """Whether it left without a goodbye: its connection closed, or its process was silent."""


class HandlerCount(msgspec.Struct, frozen=True):
    """A message is handled by more or fewer than before."""

    message: str
    handlers: int
    """So many modules handle it now and have a thread for it."""


MODULE_JOINED = Notice[Arrival](f"{PREFIX}module joined", Arrival)
MODULE_LEFT = Notice[Departure](f"{PREFIX}module left", Departure)
HANDLERS_CHANGED = Notice[HandlerCount](f"{PREFIX}handlers changed", HandlerCount)
"""Not told of notices themselves."""

NOTICES: dict[str, Message[object, None]] = {
    notice.name: notice  # type: ignore[misc]
    for notice in (MODULE_JOINED, MODULE_LEFT, HANDLERS_CHANGED)
}
"""By name."""
