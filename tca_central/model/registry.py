"""The registry of connections, modules and declared messages, and the values of variables. Knows nothing of tasks, time
or sockets.
"""

from typing import NamedTuple

from tca_central.errors import RequestError, check_name
from tca_central.events import ConnectionId
from tca_central.model.deliveries import Connection, MessageType, Module, ModuleResource
from tca_central.model.rights import Permissions
from tca_wire.messages.formats import first_difference
from tca_wire.messages.notices import NOTICES, PREFIX
from tca_wire.packets.parts import MessageFormat
from tca_wire.vocabulary import Refusal

REMEMBERED_CONNECTIONS = 256
"""Connections that were lost lately, and may come back."""

MESSAGES = 10_000
"""Names of messages that may be declared."""

VARIABLE_BYTES = 64 << 20
"""The limit on the values of all variables together. Their number is bounded by that of the messages."""


class Registry:
    """All connections, modules and messages."""

    def __init__(self) -> None:
        self.connections: dict[ConnectionId, Connection] = {}
        self.modules: dict[str, Module] = {}  #: by incarnation
        self.messages: dict[str, MessageType] = {}
        self.lost: dict[str, Connection] = {}  #: lately lost, by session: they may come back and repeat requests
        self.permissions = Permissions()
        self._names: set[str] = set()

    def module(self, name: str, incarnation: str, process: str, principal: str) -> tuple[Module, bool]:
        """The module of that incarnation, and whether it is new. A name in use gets a number: "legs#2"."""
        if known := self.modules.get(incarnation):
            return known, False
        unique, number = name, 2
        while unique in self._names:
            unique, number = f"{name}#{number}", number + 1
        self._names.add(unique)
        self.modules[incarnation] = Module(unique, name, incarnation, process, principal)
        return self.modules[incarnation], True

    def resource(self, module: Module, name: str) -> ModuleResource:
        """A module's resource, made when first named. A lock of it in one copy of a program holds in all."""
        if name not in module.resources:
            module.resources[name] = made = ModuleResource(module.name, name)
            copies = (one for one in self.modules.values() if one.called == module.called and one is not module)
            if (other := next((one.resources[name] for one in copies if name in one.resources), None)) is not None:
                made.join_copies(other)
        return module.resources[name]

    def ready_programs(self) -> set[str]:
        """The programs of which a run is there that has attached what it attaches at its start."""
        return {module.called for module in self.modules.values() if module.is_ready}

    def forget_connection(self, connection: Connection) -> None:
        """Remove a connection; its requests and answers are kept for a while."""
        del self.connections[connection.id]
        del connection.module.connections[connection.session]
        self.lost[connection.session] = connection
        if len(self.lost) > REMEMBERED_CONNECTIONS:
            del self.lost[next(iter(self.lost))]

    def forget_module(self, module: Module) -> None:
        """Forget a module. The messages that it declared stay, for tasks may still wait for them."""
        del self.modules[module.incarnation]
        self._names.discard(module.name)
        for message in self.messages.values():
            message.declarers.pop(module.incarnation, None)

    def check(self, declared: MessageFormat, module: Module) -> None:
        """Raises RequestError if others know a message of that name with another format or class."""
        known = self.messages.get(declared.name)
        check_name("message", declared.name)
        if known is None and len(self.messages) >= MESSAGES:
            text = f"{MESSAGES} messages have been declared: '{declared.name}' is too many"
            raise RequestError(Refusal.OVERLOAD, text)
        if declared.name.startswith(PREFIX):
            _check_notice(declared, module)
        if known is None or known.format == declared:
            return
        if not known.declarers and known.message_class == declared.message_class:
            return
        _refuse_difference(declared, module, known.format, f"module '{known.first_declared_by}'")

    def declare(self, declared: MessageFormat, module: Module) -> tuple[MessageType, bool]:
        """The message of that name, and whether it, or its format, is new; ``check`` has passed."""
        message = self.messages.get(declared.name)
        is_new = message is None or not (message.declarers or message.format == declared)
        if message is None:
            self.messages[declared.name] = message = MessageType(declared, module.name)
        elif is_new:
            message.redefine(declared, module.name)
        message.declarers[module.incarnation] = None
        return message, is_new


def _check_notice(declared: MessageFormat, module: Module) -> None:
    """Modules may handle central's notices, as they are, and declare nothing else that is called so."""
    notice = NOTICES.get(declared.name)
    if notice is None:
        text = f"'{declared.name}': names that begin with '{PREFIX}' are central's own, and it sends no such notice"
        raise RequestError(Refusal.PROTOCOL, text)
    _refuse_difference(declared, module, notice.format, "central")


def _refuse_difference(declared: MessageFormat, module: Module, known: MessageFormat, there: str) -> None:
    """Raise RequestError where a declaration differs from the one known *there*."""
    if known.message_class != declared.message_class:
        difference = f"a {declared.message_class} here, a {known.message_class} there"
    else:
        what = "result" if declared.message_class.is_task else "reply"
        data = first_difference(declared.data, known.data)
        reply = first_difference(declared.reply, known.reply)
        difference = f"data {data}" if data else f"{what} {reply}" if reply else ""
    if difference:
        sides = f"here = module '{module.name}', there = {there}"
        raise RequestError(Refusal.FORMAT, f"two formats for message '{declared.name}': {difference} ({sides})")


class Value(NamedTuple):
    """A variable's value, and the module that set it."""

    body: bytes
    format: str  #: of the variable then
    set_by: str  #: a module's name
    message_id: int  #: of the message that set it


class Variables:
    """The values that variables have; one that was never set has none. They outlive the module that set them."""

    def __init__(self) -> None:
        self.values: dict[str, Value] = {}
        self.bytes = 0  #: size of all values

    def check_room(self, name: str, body: bytes) -> None:
        """Raises RequestError if this value would be too much."""
        known = self.values.get(name)
        size = self.bytes + len(body) - (len(known.body) if known else 0)
        if size > VARIABLE_BYTES:
            text = f"with {len(body)} bytes in '{name}' all variables would hold {size}: {VARIABLE_BYTES} are allowed"
            raise RequestError(Refusal.OVERLOAD, text)

    def put(self, name: str, value: Value) -> None:
        """The newest value wins; ``check_room`` has passed."""
        self.forget(name)
        self.values[name] = value
        self.bytes += len(value.body)

    def forget(self, name: str) -> None:
        """Forget a variable's value."""
        if (known := self.values.pop(name, None)) is not None:
            self.bytes -= len(known.body)
