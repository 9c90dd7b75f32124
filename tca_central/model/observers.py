"""Who observes the states of which tasks. Knows nothing of how they change."""

from collections.abc import Iterator

from tca_central.model.deliveries import Connection
from tca_central.model.stored import Stored
from tca_central.model.tasks import Task
from tca_wire.packets.changes import Observe
from tca_wire.points import TaskId
from tca_wire.waits import WaitKind


class Observation(Stored):
    """A connection is told of the states of one task, of a message's tasks, of those under a task, or of all."""

    __slots__ = ("below", "connection", "is_awaited", "message", "number", "origin", "states", "task_id", "told")

    def __init__(self, connection: Connection, header: Observe) -> None:
        self.connection, self.number, self.origin = connection, header.number, header.origin
        self.told = 0  #: answers
        self.is_awaited = False  #: whoever observes does nothing, as far as is known, before the next one
        self.task_id, self.message, self.below = int(header.task), header.message, int(header.below)
        self.states = tuple(header.states)  #: only changes to one of these (none: to any)

    @property
    def subject(self) -> str:
        """What it is about, where that is no certain task: "any move leg"."""
        under = f" under {{{self.below}}}" if self.below else ""
        return "" if self.task_id else f"any {self.message or 'task'}{under}"

    @property
    def wait(self) -> tuple[str, int, TaskId, int, WaitKind, str]:
        """The wait for its news, as facts have it."""
        return self.connection.module.name, self.origin, TaskId(self.task_id), 0, WaitKind.CHANGE, self.subject

    def wants(self, task: Task) -> bool:
        """Whether it is about that task."""
        if self.task_id:
            return task.id == self.task_id
        is_below = not self.below or (task.parent is not None and task.parent.above(self.below) is not None)
        return is_below and self.message in ("", task.message.name)


class Observers(Stored):
    """All observations, by what they are about."""

    __slots__ = ("count", "of_message", "of_task", "others")

    def __init__(self) -> None:
        self.count = 0
        self.of_task: dict[int, dict[Observation, None]] = {}
        self.of_message: dict[str, dict[Observation, None]] = {}
        self.others: dict[Observation, None] = {}  #: of what is under a task, or of all

    def concern(self, task: Task) -> bool:
        """Whether somebody may observe a task: quickly said of most that nobody does."""
        if not self.count:
            return False
        return bool(self.others) or task.message.name in self.of_message or task.id in self.of_task

    def add(self, one: Observation) -> None:
        """Somebody observes from now on."""
        self._group(one)[one] = None
        self.count += 1

    def remove(self, one: Observation) -> None:
        """Nobody does any more."""
        group = self._group(one)
        del group[one]
        self.count -= 1
        if not group and one.task_id:
            del self.of_task[one.task_id]
        elif not group and one.message and not one.below:
            del self.of_message[one.message]

    def _group(self, one: Observation) -> dict[Observation, None]:
        if one.task_id:
            return self.of_task.setdefault(one.task_id, {})
        if one.message and not one.below:
            return self.of_message.setdefault(one.message, {})
        return self.others

    def of(self, task: Task) -> Iterator[Observation]:
        """Those who observe a task, each once."""
        yield from self.of_task.get(task.id, ())
        yield from self.of_message.get(task.message.name, ())
        yield from (one for one in self.others if one.wants(task))
