"""Records of the modules, their resources and the handlers of messages, as central tells them."""

import msgspec


class ResourceInfo(msgspec.Struct, frozen=True):
    """A part of a module that handles *capacity* messages at a time."""

    name: str = msgspec.field(name="resource")
    capacity: int
    handling: tuple[int, ...]
    """The messages that it handles now: ids as in the journal."""
    waiting: int
    """Number of messages that wait for it."""
    locked_by: str = ""
    """The module that has locked it, if one has."""
    reserved_by: str = ""
    claims: int = 0
    """Number of locks and reservations that wait for it."""


class ModuleInfo(msgspec.Struct, frozen=True):
    """A module that is connected, a script too."""

    name: str = msgspec.field(name="module")
    process: str
    """Its process: "host:pid"."""
    handles: tuple[str, ...]
    """Names of messages."""
    resources: tuple[ResourceInfo, ...]


class HandlerInfo(msgspec.Struct, frozen=True):
    """A module that handles a message."""

    module: str
    resource: str
    capacity: int
    """Number of messages its resource takes at a time; 0 while the module is about to come or
    go.
    """
    pool: str
    pending: int
    """The most messages of this name that may wait for it (0: no limit)."""
    waiting: int
    """Number of messages that wait for its resource."""
    direct: bool = False
    """Whether those who send the message may do so directly, as things are now."""


class MessageInfo(msgspec.Struct, frozen=True):
    """A message that some module has declared."""

    name: str = msgspec.field(name="message")
    message_class: str = msgspec.field(name="class")
    data: str
    """The format of its data, as a JSON Schema; and of its reply or result."""
    reply: str
    progress: str
    """The format of a task's intermediate results ("": it has none)."""
    life_cycle: str
    """The table of a task's life cycle ("": the general one)."""
    handled_by: tuple[HandlerInfo, ...]
    """Newest first."""
