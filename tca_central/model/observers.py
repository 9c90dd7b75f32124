"""The observers of tasks' states. Knows nothing of how the states change."""

from collections.abc import Iterator

from tca_central.model.deliveries import Connection
from tca_central.model.stored import Stored
from tca_central.model.tasks import Task
from tca_wire.packets import codec
from tca_wire.packets.changes import Observe
from tca_wire.packets.large import LargeBody, is_large
from tca_wire.packets.parts import StateChange
from tca_wire.points import TaskId
from tca_wire.waits import WaitKind

MANY = ""
"""The key of one group: the observations of a subtree or of all tasks.

Each other group has observations of one task or of one message. Its key is the task's id or the
message's name.
"""


class Observation(Stored):
    """A connection's request to observe states: of a task, a message, a subtree, or all tasks."""

    __slots__ = (
        "below",
        "connection",
        "is_awaited",
        "message",
        "notifications",
        "number",
        "origin",
        "states",
        "task_id",
    )

    def __init__(self, connection: Connection, header: Observe) -> None:
        self.connection, self.number, self.origin = connection, header.number, header.origin
        self.notifications = 0  #: number of notifications sent, the answer to the request included
        #: Whether its connection, as far as central knows, waits for the next change.
        self.is_awaited = False
        self.task_id, self.message, self.below = header.task, header.message, header.below
        #: The states whose changes are reported (empty: all states)
        self.states = tuple(header.states)

    @property
    def subject(self) -> str:
        """The observed tasks in words, such as "any move leg"; "" for one task."""
        under = f" under {{{self.below}}}" if self.below else ""
        return "" if self.task_id else f"any {self.message or 'task'}{under}"

    @property
    def wait(self) -> tuple[str, int, TaskId, int, WaitKind, str]:
        """The arguments of the facts about the wait for a change."""
        module = self.connection.module.name
        return module, self.origin, self.task_id, 0, WaitKind.CHANGE, self.subject

    def wants(self, task: Task) -> bool:
        """Whether *task* is observed. The observation is of a subtree, or of all tasks."""
        is_below = not self.below or (
            task.parent is not None and task.parent.find_above(self.below) is not None
        )
        return is_below and self.message in ("", task.message.name)


class Observers(Stored):
    """All observations, grouped by task or message."""

    __slots__ = ("count", "groups")

    def __init__(self) -> None:
        self.count = 0
        self.groups: dict[int | str, dict[Observation, None]] = {MANY: {}}

    @property
    def of_many(self) -> dict[Observation, None]:
        """Observations of a subtree, or of all tasks."""
        return self.groups[MANY]

    def may_observe(self, task: Task) -> bool:
        """Whether a task may have observers. For most tasks this is a quick no."""
        if not self.count:
            return False
        return bool(self.of_many) or task.message.name in self.groups or task.id in self.groups

    def add(self, observation: Observation) -> None:
        """Add an observation."""
        self.groups.setdefault(_group_key(observation), {})[observation] = None
        self.count += 1

    def remove(self, observation: Observation) -> None:
        """Remove an observation."""
        key = _group_key(observation)
        del self.groups[key][observation]
        self.count -= 1
        if not (self.groups[key] or key == MANY):
            del self.groups[key]

    def of(self, task: Task) -> Iterator[Observation]:
        """Yield the observations of a task, each once."""
        yield from self.groups.get(task.id, ())
        yield from self.groups.get(task.message.name, ())
        yield from (observation for observation in self.of_many if observation.wants(task))


def _group_key(observation: Observation) -> int | str:
    """Return the key of an observation's group."""
    return observation.task_id or (MANY if observation.below else observation.message)


def encode_change(change: StateChange) -> bytes:
    """Return the body with a change, which keeps the large data of the change alive."""
    encoded = codec.encode(change)
    if not (is_large(change.goal) or is_large(change.data)):
        return encoded
    body = LargeBody(encoded)
    body.owner = change
    return body
