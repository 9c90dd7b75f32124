"""Play modules against the pure core. Each call is one event, and returns what central sent."""

import gc
from collections.abc import Callable, Iterator
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, Self

import msgspec
import pytest

from dev.invariants import check_invariants
from tca_central.core import Central
from tca_central.events import (
    BadBytes,
    ConnectionId,
    ConnectionLost,
    Effect,
    Record,
    RequestReceived,
    Tick,
    Transmit,
)
from tca_central.loading import is_compiled
from tca_wire.constraints import Constraint, Flags
from tca_wire.journal.facts import Entry
from tca_wire.messages.notices import NOTICES
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.packets.parts import HandlerFormat, MessageFormat, RetryPolicy
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import MessageClass

INTEGER = '{"type":"integer"}'
WITH_EXPLICIT_ORIGIN = headers.Send | headers.AwaitPoint | headers.Lock | headers.SetVariable
"""Requests in which a test names the handler that sends them. In all other requests, the player
names the newest handler that the connection runs.
"""

IN_PYTHON = pytest.mark.skipif(
    is_compiled(),
    reason="compiled code can be neither traced nor patched, nor its objects made one by one",
)


class Player:
    """One central and any number of modules, named by single words. The invariants are checked
    after every event.
    """

    prefetch = 0
    """The number of messages that each slot may prefetch."""

    def __init__(self, *, check: bool = True) -> None:
        self.central = Central()
        self.time = 0.0
        self.check = check
        self.entries: list[Entry] = []
        self.inbox: dict[str, list[tuple[Any, bytes]]] = {}
        self.numbers: dict[str, int] = {}
        self.principals: dict[str, str] = {}  #: by connection; "" is the user that runs central
        self.life_cycles: dict[str, str] = {}  #: the declared table, by message
        self.retries: dict[str, RetryPolicy] = {}  #: the declared policy, by message

    @classmethod
    def of(cls, *modules: str, check: bool = True) -> Self:
        """Return a player with modules. Each module is given with the messages that it handles,
        such as "legs: command move, query where", or by its name alone.
        """
        player = cls()
        player.check = check
        for name, _, handled in (module.partition(": ") for module in modules):
            player.module(name, *filter(None, handled.split(", ")))
        return player

    def event(self, event: Any) -> list[Effect]:
        effects = self.central.handle(event)
        if self.check:
            check_invariants(self.central)
        self.note(effects)
        return effects

    def note(self, effects: list[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, Record):
                self.entries.append(effect.entry)
            elif isinstance(effect, Transmit):
                self.inbox.setdefault(effect.connection.decode(), []).append(
                    (effect.header, effect.body)
                )

    def receive(self, connection: str, header: Any, body: bytes = b"") -> list[Any]:
        """Let central receive a message. Return all headers that central sent."""
        self.time += 1.0
        if getattr(header, "origin", None) == 0 and not isinstance(header, WITH_EXPLICIT_ORIGIN):
            header = msgspec.structs.replace(header, origin=(self.delivered(connection) or [0])[-1])
        principal = self.principals.get(connection, "")
        effects = self.event(
            RequestReceived(self.time, ConnectionId(connection.encode()), header, body, principal)
        )
        return [effect.header for effect in effects if isinstance(effect, Transmit)]

    def request(
        self,
        connection: str,
        kind: Callable[..., Any],
        /,
        *fields: Any,
        body: bytes = b"",
        **options: Any,
    ) -> list[Any]:
        """Make a request with the next number."""
        return self.receive(connection, kind(self.number(connection), *fields, **options), body)

    def number(self, connection: str) -> int:
        self.numbers[connection] = self.numbers.get(connection, 0) + 1
        return self.numbers[connection]

    def hello(
        self, connection: str, module: str = "", resource: str = "", incarnation: str = ""
    ) -> list[Any]:
        module = module or connection
        number = 0 if not resource else sum(c.startswith(f"{module}/") for c in self.inbox) + 1
        return self.request(
            connection,
            headers.Hello,
            headers.PROTOCOL_VERSION,
            module,
            incarnation or f"run of {module}",
            number,
            resource,
            "here:1",
            prefetch=self.prefetch,
        )

    def module(
        self,
        name: str,
        *handles: str,
        capacity: int = 1,
        pool: str = "",
        pending: int = 0,
        resource: str = "",
        **wishes: Any,
    ) -> None:
        """Let a module join. *handles*: class and name of each message, such as "goal walk".
        *wishes*: options of the module's handlers for the life cycles of tasks.
        """
        self.hello(name)
        messages = [self.declared(words) for words in handles]
        handlers = [
            HandlerFormat(message.name, resource or name, pool, pending, **wishes)
            for message in messages
        ]
        self.request(name, headers.Register, messages, handlers)
        for index in range(capacity if handles else 0):
            self.hello(f"{name}/{index + 1}", name, resource or name)

    @staticmethod
    def format(words: str) -> MessageFormat:
        message_class = max((one for one in MessageClass if words.startswith(f"{one} ")), key=len)
        name = words.removeprefix(f"{message_class} ")
        if name in NOTICES:
            return NOTICES[name].format
        reply = INTEGER if message_class in ("query", "multi-query", "command") else ""
        return MessageFormat(name, message_class, INTEGER, reply)

    def declared(self, words: str) -> MessageFormat:
        """Return the declaration of a message, with its `life_cycles` and `retries`."""
        message = self.format(words)
        life_cycle, retry = self.life_cycles.get(message.name, ""), self.retries.get(message.name)
        return msgspec.structs.replace(message, life_cycle=life_cycle, retry=retry)

    def declare(self, connection: str, *messages: str) -> list[Any]:
        declared = [self.declared(words) for words in messages]
        return self.request(connection, headers.Register, declared)

    def change(
        self,
        connection: str,
        task: int,
        transition: str,
        value: Any = None,
        *,
        serial: int = -1,
        **options: Any,
    ) -> list[Any]:
        """Request a transition of a task. The request counts as the handler's if the connection
        runs the task.
        """
        return self.request(
            connection,
            ChangeState,
            TaskId(task),
            transition,
            serial,
            body=b"" if value is None else msgspec.msgpack.encode(value),
            **options,
        )

    def observe(self, connection: str, **about: Any) -> list[Any]:
        return self.request(connection, Observe, **about)

    def send(
        self,
        connection: str,
        message: str,
        *,
        under: int = 0,
        flags: Flags = Flags.SEQ_ACH,
        constraints: tuple[Constraint, ...] = (),
        **options: Any,
    ) -> list[Any]:
        number = options.pop("number", None) or self.number(connection)
        header = headers.Send(
            number,
            message,
            TaskId(under),
            options.pop("origin", under),
            flags,
            list(constraints),
            **options,
        )
        return self.receive(connection, header, msgspec.msgpack.encode(7))

    def set_variable(
        self, connection: str, variable: str, value: Any, *, swap: bool = False
    ) -> list[Any]:
        return self.request(
            connection, headers.SetVariable, variable, body=msgspec.msgpack.encode(value), swap=swap
        )

    def task(self, connection: str, message: str, **options: Any) -> int:
        """Send a goal or command. Return its id."""
        answers = self.send(connection, message, **options)
        accepted = [a for a in answers if isinstance(a, headers.Accepted)]
        assert accepted, answers
        return accepted[-1].id

    def delivered(self, connection: str) -> list[int]:
        """Return the deliveries that a connection has not answered yet."""
        return [
            d.handling_id
            for d in self.central.dispatcher.running.values()
            if d.slot and d.slot.id == connection.encode()
        ]

    def reply(self, connection: str, delivery: int = 0, value: Any = None) -> list[Any]:
        delivery = delivery or self.delivered(connection)[-1]
        return self.receive(connection, headers.Reply(delivery), msgspec.msgpack.encode(value))

    def fail(self, connection: str, failure: str, delivery: int = 0, **options: Any) -> list[Any]:
        delivery = delivery or self.delivered(connection)[-1]
        return self.receive(connection, headers.Fail(delivery, failure, "why", **options))

    def resolve(self, connection: str, delivery: int = 0) -> list[Any]:
        """Let an exception handler resolve its failure."""
        origin = delivery or self.delivered(connection)[-1]
        return self.request(connection, headers.Resolve, origin)

    def tick(self, seconds: float) -> list[Effect]:
        """Let time pass."""
        self.time += seconds
        return self.event(Tick(self.time))

    def lose(self, connection: str) -> list[Effect]:
        self.time += 1.0
        return self.event(ConnectionLost(self.time, ConnectionId(connection.encode())))

    def garbage(self, connection: str) -> list[Effect]:
        return self.event(BadBytes(self.time, ConnectionId(connection.encode()), "no message"))

    def facts(self, kind: type) -> list[Any]:
        return [fact for entry in self.entries for fact in entry.facts if isinstance(fact, kind)]

    def facts_of(self, kind: str) -> list[Any]:
        return [
            fact
            for entry in self.entries
            for fact in entry.facts
            if fact.__struct_config__.tag == kind
        ]


def point(task: int, moment: Moment) -> Point:
    return Point(TaskId(task), moment)


def before(one: Point, other: Point, delay: float = 0) -> Constraint:
    return Constraint(one, other, delay)


CODE = (type, ModuleType, FunctionType, BuiltinFunctionType, MethodType)


def reachable(central: Central) -> Iterator[object]:
    """Yield all objects that central refers to, each once. Code is left out."""
    seen, frontier = {id(central)}, [central]
    while frontier:
        for referent in gc.get_referents(frontier.pop()):
            if not isinstance(referent, CODE) and id(referent) not in seen:
                seen.add(id(referent))
                frontier.append(referent)
                yield referent
