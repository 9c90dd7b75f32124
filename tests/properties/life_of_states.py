"""Random lives in which clients and handlers request transitions of tasks. Some of these
transitions are impossible, and some requests are late.
"""

from typing import Any, NamedTuple

import msgspec
from central.player import Player
from central.transcript import PAUSABLE
from properties.life import OPERATIONS, Life

from tca_central.model.tasks import Task
from tca_wire.journal.facts import Fact
from tca_wire.life_cycles import BASIC, LifeCycle
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.packets.parts import HandlerFormat, StateChange
from tca_wire.points import TaskId
from tca_wire.vocabulary import Busy, Party

LIFE_CYCLES = {"lift": PAUSABLE, "step": BASIC}
HANDLER_OPTIONS: list[dict[str, Any]] = [
    {},
    {"takes": ["update", "cancel"]},
    {"takes": ["cancel"], "accepts": True},
    {"takes": ["update"], "refuses": ["cancel"]},
    {"refuses": ["update", "cancel"]},
]
"""The options of a module's handlers. Each module that joins takes the next row."""


class AskedChange(NamedTuple):
    """A requested change of a task's state: the request, the handlers at that time, and central's
    answer.
    """

    task: TaskId
    name: str
    serial: int
    by: Party
    body: bytes
    takes: tuple[str, ...] | None
    """The transitions that the task's handler receives (None: no handler has the task)."""
    refuses: tuple[str, ...]
    """The transitions that the task's present handler refuses."""
    refuses_next: tuple[str, ...]
    """The transitions that the newest handler of the task's message refuses."""
    answer: Any
    facts: list[Fact]
    entries: int
    """The number of journal entries before the request."""


class LifeOfStates(Life):
    """A life with changes of states. The user observes all tasks from the start."""

    operations = OPERATIONS + ["change"] * 24 + ["handler"] * 16
    busy: tuple[Busy, ...] = (Busy.QUEUE,)

    def __init__(self, player: Player | None = None) -> None:
        player = player or Player()
        player.life_cycles |= {name: cycle.text for name, cycle in LIFE_CYCLES.items()}
        self.asked: AskedChange | None = None
        super().__init__(player)
        self.observing = player.numbers["user"] + 1
        player.request("user", Observe)

    @staticmethod
    def life_cycle(message: str) -> LifeCycle | None:
        """Return the life cycle of a message; None for the general one."""
        return LIFE_CYCLES.get(message)

    def join(self, module: str) -> None:
        """Join with options for the handlers of tasks. Handlers of "step" receive and refuse no
        transition, because its life cycle is the basic one.
        """
        self.generation += 1
        name = f"{module}{self.generation}"
        self.player.hello(name)
        messages = [self.player.declared(words) for words in self.modules[module]]
        handlers = [HandlerFormat(one.name, name, **self.handler_options(one)) for one in messages]
        self.player.request(name, headers.Register, messages, handlers)
        for slot in range(2):
            self.player.hello(f"{name}/{slot + 1}", name, name)

    def handler_options(self, message: Any) -> dict[str, Any]:
        if not message.message_class.is_task:
            return {}
        options: dict[str, Any] = dict(HANDLER_OPTIONS[self.generation % len(HANDLER_OPTIONS)])
        if message.name == "lift" and "takes" in options:
            options["takes"] = [*options["takes"], "pause"]
        if message.name == "step":
            options = {"accepts": "accepts" in options}
        return options | {"busy": self.busy[self.generation % len(self.busy)]}

    def give_up_(self, a: int, *_: int) -> None:
        number = 1 + a % self.player.numbers["user"]
        if number != self.observing:
            self.player.receive("user", headers.GiveUp(number))

    def change_(self, a: int, b: int, c: int, d: int) -> None:
        """Request a change as a client: the user, or the handler of another delivery."""
        if (number := self.task(a)) is not None:
            others = [
                one
                for one in self.central.dispatcher.running.values()
                if one.id != number and one.slot
            ]
            one = others[b % len(others)] if others and b % 3 == 0 else None
            name, origin = (
                (one.slot.id.decode(), one.handling_id)
                if one is not None and one.slot
                else ("user", 0)
            )
            self._ask(name, origin, number, Party.CLIENT, b, c, d)

    def handler_(self, a: int, b: int, c: int, d: int) -> None:
        """Request a change as the handler of the task."""
        running = [
            one
            for one in self.central.dispatcher.running.values()
            if isinstance(one, Task) and one.slot
        ]
        if running:
            task = running[a % len(running)]
            assert task.slot is not None
            self._ask(task.slot.id.decode(), task.handling_id, task.id, Party.SERVER, b, c, d)

    def _ask(
        self, connection: str, origin: int, number: TaskId, by: Party, b: int, c: int, d: int
    ) -> None:
        self.player.tick(1.0)  # timers that are due fire before the request
        self.player.time -= 1.0
        task = self.central.tree.tasks.get(number)
        names = ["fly"]
        if task is not None:
            cycle = task.message.life_cycle
            own = [
                one.name
                for one in cycle.transitions
                if one.source == task.state and one.by in (by, Party.BOTH)
            ]
            names = own if own and b % 4 else [one.name for one in cycle.transitions] or names
        name, serial = names[c % len(names)], task.serial if task is not None else 0
        seen = (-1, serial, max(serial - 1, 0), max(serial - 2, 0), 0, serial + (c % 9 == 0))[d % 6]
        body = (
            msgspec.msgpack.encode(c)
            if name in ("update", "result available") or d % 31 == 0
            else b""
        )
        handler = (
            task.slot.module.handlers.get(task.message.name)
            if task is not None and task.slot
            else None
        )
        newest = task.message.handlers[-1] if task is not None and task.message.handlers else None
        entries, heard = len(self.player.entries), len(self.player.inbox.get(connection, ()))
        request = self.player.number(connection)
        self.player.receive(connection, ChangeState(request, number, name, seen, "", origin), body)
        answers = [
            one
            for one, _ in self.player.inbox[connection][heard:]
            if isinstance(one, headers.Accepted | headers.Refused) and one.number == request
        ]
        assert len(answers) == 1, "each request is answered once"
        found = [fact for entry in self.player.entries[entries:] for fact in entry.facts]
        self.asked = AskedChange(
            number,
            name,
            seen,
            by,
            body,
            handler.takes if handler is not None else None,
            handler.refuses if handler is not None else (),
            newest.refuses if newest is not None else (),
            answers[0],
            found,
            entries,
        )

    def seen(self) -> list[StateChange]:
        """Return all changes that the observer has received, oldest first."""
        return [
            msgspec.msgpack.decode(body, type=StateChange)
            for header, body in self.player.inbox["user"]
            if isinstance(header, headers.Answer) and header.number == self.observing and body
        ]
