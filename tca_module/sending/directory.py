"""Records of modules, their resources and the handlers of messages, as central reports them."""

import msgspec

from tca_wire.packets.parts import RetryPolicy


class ResourceInfo(msgspec.Struct, frozen=True):
    """A resource of a module, as central reports it.

    Attributes:
        name: the resource's name.
        capacity: the number of messages that the resource handles at a time.
        handling: the ids of the messages that the resource handles now, as in the journal.
        waiting: the number of messages that wait for the resource.
        locked_by: the module that has locked the resource; "" without a lock.
        reserved_by: the module that has reserved the resource; "" without a reservation.
        claims: the number of locks and reservations that wait for the resource.
    """

    name: str = msgspec.field(name="resource")
    capacity: int
    handling: tuple[int, ...]
    waiting: int
    locked_by: str = ""
    reserved_by: str = ""
    claims: int = 0


class ModuleInfo(msgspec.Struct, frozen=True):
    """A connected module or script.

    Attributes:
        name: the name by which central knows the module.
        process: the module's process, as "host:pid".
        handles: the names of the messages that the module handles.
        resources: the module's resources.
    """

    name: str = msgspec.field(name="module")
    process: str
    handles: tuple[str, ...]
    resources: tuple[ResourceInfo, ...]


class HandlerInfo(msgspec.Struct, frozen=True):
    """A handler of a message.

    Attributes:
        module: the handler's module.
        resource: the handler's resource.
        capacity: the number of messages that the resource handles at a time; 0 while the module is
            joining or leaving.
        pool: the pool in which the handler shares the messages; "" without a pool.
        pending: the most messages of this name that may wait for the handler; 0 for no limit.
        waiting: the number of messages that wait for the handler's resource.
    """

    module: str
    resource: str
    capacity: int
    pool: str
    pending: int
    waiting: int


class MessageInfo(msgspec.Struct, frozen=True):
    """A message that some module has declared.

    Attributes:
        name: the message's name.
        message_class: the message's class, such as "goal".
        data: the format of the message's data, as a JSON Schema.
        reply: the format of the reply or result, as a JSON Schema.
        progress: the format of a task's intermediate results; "" without any.
        life_cycle: the table of a task's life cycle; "" for the general life cycle.
        handled_by: the message's handlers, newest first.
        retry: the retry policy of its tasks; None without any.
    """

    name: str = msgspec.field(name="message")
    message_class: str = msgspec.field(name="class")
    data: str
    reply: str
    progress: str
    life_cycle: str
    handled_by: tuple[HandlerInfo, ...]
    retry: RetryPolicy | None = None
