"""The observers of tasks' states. Knows nothing of how the states change."""

from collections.abc import Iterator

from tca_central.model.deliveries import Connection
from tca_central.model.stored import Stored
from tca_central.model.tasks import Task
from tca_wire.packets.changes import Observe
from tca_wire.points import TaskId
from tca_wire.waits import WaitKind

OTHERS = ""
"""The group of observations of a subtree or of all tasks.

The other groups are named by a task's id or a message's name.
"""


class Observation(Stored):
    """A connection observes the states of one task, a message's tasks, a subtree, or all tasks."""

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
        self.told = 0  #: number of changes reported
        #: Whether its connection, as far as central knows, waits for the next change.
        self.is_awaited = False
        self.task_id, self.message, self.below = header.task, header.message, header.below
        #: The states whose changes are reported (empty: all states)
        self.states = tuple(header.states)

    @property
    def subject(self) -> str:
        """Text for its subject if that is not one task: "any move leg"."""
        under = f" under {{{self.below}}}" if self.below else ""
        return "" if self.task_id else f"any {self.message or 'task'}{under}"

    @property
    def wait(self) -> tuple[str, int, TaskId, int, WaitKind, str]:
        """The arguments of the facts about the wait for a change."""
        return (
            self.connection.module.name,
            self.origin,
            self.task_id,
            0,
            WaitKind.CHANGE,
            self.subject,
        )

    def wants(self, task: Task) -> bool:
        """Whether an observation that names no task includes this one."""
        is_below = not self.below or (
            task.parent is not None and task.parent.above(self.below) is not None
        )
        return is_below and self.message in ("", task.message.name)


class Observers(Stored):
    """All observations, grouped by what they are about."""

    __slots__ = ("count", "groups")

    def __init__(self) -> None:
        self.count = 0
        self.groups: dict[int | str, dict[Observation, None]] = {OTHERS: {}}

    @property
    def others(self) -> dict[Observation, None]:
        """Observations of a subtree, or of all tasks."""
        return self.groups[OTHERS]

    def concern(self, task: Task) -> bool:
        """Whether a task may have observers. For most tasks this is a quick no."""
        if not self.count:
            return False
        return bool(self.others) or task.message.name in self.groups or task.id in self.groups

    def add(self, observation: Observation) -> None:
        """Add an observation."""
        self.groups.setdefault(_subject(observation), {})[observation] = None
        self.count += 1

    def remove(self, observation: Observation) -> None:
        """Remove an observation."""
        subject = _subject(observation)
        del self.groups[subject][observation]
        self.count -= 1
        if not (self.groups[subject] or subject == OTHERS):
            del self.groups[subject]

    def of(self, task: Task) -> Iterator[Observation]:
        """Yield the observations of a task, each once."""
        yield from self.groups.get(task.id, ())
        yield from self.groups.get(task.message.name, ())
        yield from (observation for observation in self.others if observation.wants(task))


def _subject(observation: Observation) -> int | str:
    return observation.task_id or (OTHERS if observation.below else observation.message)
