"""Who observes the states of which tasks. Knows nothing of how they change."""

from collections.abc import Iterator

from tca_central.model.deliveries import Connection
from tca_central.model.stored import Stored
from tca_central.model.tasks import Task
from tca_wire.packets.changes import Observe
from tca_wire.points import TaskId
from tca_wire.waits import WaitKind

OTHERS = ""
"""Stands for what is under a task, and for all, where others are named."""


class Observation(Stored):
    """A connection is told of the states of one task, of a message's tasks, of those under a task,
    or of all.
    """

    __slots__ = (
        "below",
        "connection",
        "is_awaited",
        "message",
        "number",
        "origin",
        "states",
        "task_id",
        "told",
    )

    def __init__(self, connection: Connection, header: Observe) -> None:
        self.connection, self.number, self.origin = connection, header.number, header.origin
        self.told = 0  #: answers
        self.is_awaited = (
            False  #: whoever observes does nothing, as far as is known, before the next one
        )
        self.task_id, self.message, self.below = header.task, header.message, header.below
        self.states = tuple(header.states)  #: only changes to one of these (none: to any)

    @property
    def subject(self) -> str:
        """What it is about, where that is no certain task: "any move leg"."""
        under = f" under {{{self.below}}}" if self.below else ""
        return "" if self.task_id else f"any {self.message or 'task'}{under}"

    @property
    def wait(self) -> tuple[str, int, TaskId, int, WaitKind, str]:
        """The wait for its news, as facts have it."""
        return (
            self.connection.module.name,
            self.origin,
            self.task_id,
            0,
            WaitKind.CHANGE,
            self.subject,
        )

    def wants(self, task: Task) -> bool:
        """Whether it is about that task, where it names none."""
        is_below = not self.below or (
            task.parent is not None and task.parent.above(self.below) is not None
        )
        return is_below and self.message in ("", task.message.name)


class Observers(Stored):
    """All observations, by what they are about: a task, by its id, a message, by its name, or
    others.
    """

    __slots__ = ("count", "groups")

    def __init__(self) -> None:
        self.count = 0
        self.groups: dict[int | str, dict[Observation, None]] = {OTHERS: {}}

    @property
    def others(self) -> dict[Observation, None]:
        """Those of what is under a task, or of all."""
        return self.groups[OTHERS]

    def concern(self, task: Task) -> bool:
        """Whether somebody may observe a task: quickly said of most that nobody does."""
        if not self.count:
            return False
        return bool(self.others) or task.message.name in self.groups or task.id in self.groups

    def add(self, one: Observation) -> None:
        """Somebody observes from now on."""
        self.groups.setdefault(_subject(one), {})[one] = None
        self.count += 1

    def remove(self, one: Observation) -> None:
        """Nobody does any more."""
        subject = _subject(one)
        del self.groups[subject][one]
        self.count -= 1
        if not (self.groups[subject] or subject == OTHERS):
            del self.groups[subject]

    def of(self, task: Task) -> Iterator[Observation]:
        """Those who observe a task, each once."""
        yield from self.groups.get(task.id, ())
        yield from self.groups.get(task.message.name, ())
        yield from (one for one in self.others if one.wants(task))


def _subject(one: Observation) -> int | str:
    return one.task_id or (OTHERS if one.below else one.message)
