"""Who observes the states of which tasks. Knows nothing of how they change."""

from collections.abc import Iterator

from tca_central.model.deliveries import Connection
from tca_central.model.stored import Stored
from tca_central.model.task_tree import Task
from tca_wire.packets.changes import Observe


class Observation(Stored):
    """A connection is told of the states of one task, of a message's tasks, of those under a task, or of all."""

    __slots__ = ("below", "connection", "message", "number", "states", "task_id")

    def __init__(self, connection: Connection, header: Observe) -> None:
        self.connection, self.number = connection, header.number
        self.task_id, self.message, self.below = int(header.task), header.message, int(header.below)
        self.states = tuple(header.states)  #: only changes to one of these (none: to any)

    def wants(self, task: Task) -> bool:
        """Whether it is about that task."""
        if self.task_id:
            return task.id == self.task_id
        is_below = not self.below or (task.parent is not None and task.parent.above(self.below) is not None)
        return is_below and self.message in ("", task.message.name)


class Observers(Stored):
    """All observations, by what they are about."""

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
