"""The registry of connections, modules and declared messages, and the values of variables.

Knows nothing of tasks, time or sockets.
"""

from typing import NamedTuple

from tca_central.errors import RequestError, check_name
from tca_central.events import ConnectionId
from tca_central.model.budget import RESOURCE_BYTES, TYPE_BYTES
from tca_central.model.deliveries import Connection, MessageType, Module, ModuleResource
from tca_central.model.rights import Permissions
from tca_central.model.stored import Stored
from tca_wire.errors import BadFormat
from tca_wire.life_cycles import read_life_cycle
from tca_wire.messages.formats import first_difference
from tca_wire.messages.notices import NOTICES, PREFIX
from tca_wire.packets.large import held_size
from tca_wire.packets.parts import MessageFormat, RetryPolicy
from tca_wire.vocabulary import Refusal

REMEMBERED_CONNECTIONS = 256
"""The number of lost connections that may come back."""

MESSAGES = 10_000
"""The number of messages that may be known at the same time."""


class Registry(Stored):
    """All connections, modules and messages."""

    __slots__ = (
        "_names",
        "bytes",
        "connections",
        "dropped",
        "lost",
        "messages",
        "modules",
        "next_search",
        "permissions",
    )

    def __init__(self) -> None:
        self.connections: dict[ConnectionId, Connection] = {}
        self.modules: dict[str, Module] = {}  #: by incarnation
        self.messages: dict[str, MessageType] = {}
        #: By session: the newest lost connections. They may come back and repeat requests.
        self.lost: dict[str, Connection] = {}
        self.permissions = Permissions()
        self.bytes = 0  #: bytes of declared messages and resources
        self.dropped = 0  #: number of dropped messages whose type was forgotten
        #: No search for unneeded messages starts before the event of this number.
        self.next_search = 0
        self._names: dict[str, None] = {}  #: names of modules in use

    def module(
        self, name: str, incarnation: str, process: str, principal: str
    ) -> tuple[Module, bool]:
        """Return the module of an incarnation, and whether it is new.

        If *name* is in use, the new module's name gets a number: "legs#2".
        """
        if known := self.modules.get(incarnation):
            return known, False
        unique, number = name, 2
        while unique in self._names:
            unique, number = f"{name}#{number}", number + 1
        self._names[unique] = None
        self.modules[incarnation] = Module(unique, name, incarnation, process, principal)
        return self.modules[incarnation], True

    def resource(self, module: Module, name: str) -> ModuleResource:
        """Return a module's resource, creating it at its first use.

        Other copies of the program may have a resource of that name. The new resource joins them,
        so that a lock holds in all copies.
        """
        if name not in module.resources:
            module.resources[name] = resource = ModuleResource(module.name, name)
            self.bytes += RESOURCE_BYTES
            for one in self.modules.values():
                if one is not module and one.called == module.called and name in one.resources:
                    resource.join_copies(one.resources[name])
                    break
        return module.resources[name]

    def ready_programs(self) -> set[str]:
        """Return the programs with a connected module that has made its first attachments."""
        return {module.called for module in self.modules.values() if module.is_ready}

    def forget_connection(self, connection: Connection) -> Connection | None:
        """Remove a connection, but keep its requests and answers for a while.

        Returns an older connection whose requests and answers can be forgotten now, if any.
        """
        del self.connections[connection.id]
        del connection.module.connections[connection.session]
        self.lost[connection.session] = connection
        if len(self.lost) <= REMEMBERED_CONNECTIONS:
            return None
        return self.lost.pop(next(iter(self.lost)))

    def forget_message(self, message: MessageType) -> None:
        """Forget a declared message that is no longer needed."""
        del self.messages[message.name]
        self.bytes -= type_size(message.format)
        self.dropped += message.dropped

    def forget_module(self, module: Module) -> None:
        """Forget a module. Its messages stay, because tasks may still wait for them."""
        del self.modules[module.incarnation]
        self.bytes -= RESOURCE_BYTES * len(module.resources)
        self._names.pop(module.name, None)
        for message in self.messages.values():
            message.declarers.pop(module.incarnation, None)
        self.next_search = 0  # a search may find messages of this module that can be forgotten

    def check(self, declared: MessageFormat, module: Module) -> None:
        """Raise RequestError if a declaration is invalid, or another one contradicts it.

        If no module that declared the message is connected, only the class must stay.
        """
        known = self.messages.get(declared.name)
        check_name("message", declared.name)
        if declared.name.startswith(PREFIX):
            _check_notice(declared, module)
        if known is not None and known.format == declared:
            return
        if declared.life_cycle:
            _check_life_cycle(declared)
        if known is None or (not known.declarers and known.message_class == declared.message_class):
            return
        _refuse_difference(declared, module, known.format, f"module '{known.first_declared_by}'")

    def declare(self, declared: MessageFormat, module: Module) -> tuple[MessageType, bool]:
        """Declare a message. Return the message, and whether the message or its format is new.

        ``check`` must have passed.
        """
        message = self.messages.get(declared.name)
        is_new = message is None or not (message.declarers or message.format == declared)
        if message is None:
            self.messages[declared.name] = message = MessageType(declared, module.name)
            self.bytes += type_size(declared)
        elif is_new:
            self.bytes += type_size(declared) - type_size(message.format)
            message.redefine(declared, module.name)
        message.declarers[module.incarnation] = None
        return message, is_new


def type_size(declared: MessageFormat) -> int:
    """Return the bytes that a declared message holds."""
    texts = (
        declared.name,
        declared.data,
        declared.reply,
        declared.progress,
        declared.life_cycle,
        *declared.parts,
    )
    retry = declared.retry
    more = (retry.fallback, retry.data, *retry.failures) if retry is not None else ()
    return TYPE_BYTES + sum(map(len, texts)) + sum(map(len, more))


def _check_life_cycle(declared: MessageFormat) -> None:
    """Raise RequestError if the life cycle of a declaration cannot be used."""
    if not declared.message_class.is_task:
        raise RequestError(
            Refusal.FORMAT,
            f"{declared.message_class} '{declared.name}' is no task: it has no life cycle",
        )
    try:
        read_life_cycle(declared.life_cycle)
    except BadFormat as error:
        raise RequestError(Refusal.FORMAT, f"message '{declared.name}': {error}") from None


def _check_notice(declared: MessageFormat, module: Module) -> None:
    """Raise RequestError unless the declaration is equal to a notice of central with that name."""
    notice = NOTICES.get(declared.name)
    if notice is None:
        text = (
            f"'{declared.name}': names that begin with '{PREFIX}' are central's own, "
            "and it sends no such notice"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    _refuse_difference(declared, module, notice.format, "central")


def _refuse_difference(
    declared: MessageFormat, module: Module, known: MessageFormat, there: str
) -> None:
    """Raise RequestError if *declared* differs from *known*, the declaration made *there*."""
    if known.message_class != declared.message_class:
        difference = f"a {declared.message_class} here, a {known.message_class} there"
    else:
        what = "result" if declared.message_class.is_task else "reply"
        data = first_difference(declared.data, known.data)
        reply = first_difference(declared.reply, known.reply)
        difference = f"data {data}" if data else ""
        if not difference and reply:
            difference = f"{what} {reply}"
        if not difference and (progress := first_difference(declared.progress, known.progress)):
            difference = f"intermediate result {progress}"
        if not difference and declared.life_cycle != known.life_cycle:
            ours, theirs = read_life_cycle(declared.life_cycle), read_life_cycle(known.life_cycle)
            difference = f"{ours} here, {theirs} there"
            if ours.name == theirs.name:
                difference = f"two versions of {ours}"
        if not difference and declared.retry != known.retry:
            difference = _difference_of_policies(declared.retry, known.retry)
    if difference:
        sides = f"here = module '{module.name}', there = {there}"
        raise RequestError(
            Refusal.FORMAT,
            f"two formats for message '{declared.name}': {difference} ({sides}): declare it once,"
            " in a file that all programs import",
        )


def _difference_of_policies(ours: RetryPolicy | None, theirs: RetryPolicy | None) -> str:
    """Return how two retry policies differ."""
    if ours is None or theirs is None:
        first, second = ("a", "no") if ours is not None else ("no", "a")
        return f"{first} retry policy here, {second} retry policy there"
    fields = [
        name for name in ours.__struct_fields__ if getattr(ours, name) != getattr(theirs, name)
    ]
    return f"two retry policies, with different {' and '.join(fields)}"


class Value(NamedTuple):
    """A variable's value, and the module that set it."""

    body: bytes
    format: str  #: the variable's format when it was set
    set_by: str  #: name of the module
    message_id: int  #: the message that set it


class Variables(Stored):
    """The values of variables. They outlive the module that set them."""

    __slots__ = ("bytes", "values")

    def __init__(self) -> None:
        self.values: dict[str, Value] = {}
        self.bytes = 0  #: size of all values

    def check_room(self, name: str, body: bytes, most: int) -> None:
        """Raise RequestError if all values would hold more than *most* bytes with this new one."""
        known = self.values.get(name)
        size = self.bytes + held_size(body) - (held_size(known.body) if known else 0)
        if size > most:
            text = (
                f"with {held_size(body)} bytes in '{name}' all variables would hold {size}: "
                f"{most} are allowed"
            )
            raise RequestError(Refusal.OVERLOAD, text)

    def set(self, name: str, value: Value) -> None:
        """Replace a variable's value. ``check_room`` must have passed."""
        self.forget(name)
        self.values[name] = value
        self.bytes += held_size(value.body)

    def forget(self, name: str) -> None:
        """Forget a variable's value."""
        if (known := self.values.pop(name, None)) is not None:
            self.bytes -= held_size(known.body)
