"""The base classes of facts."""

import msgspec

from tca_wire.points import TaskId
from tca_wire.waits import WaitKind


class BaseFact(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The base of all facts: an array whose first element is the kind.

    No fact refers to itself, so Python's garbage collector can skip facts (``gc=False``). This
    makes reading journals faster.
    """


class NumberedFact(BaseFact, frozen=True):
    """A fact about a message, delivery, claim, exception handler or wiretap, by its number."""

    id: int


class TaskFact(BaseFact, frozen=True):
    """A fact about a task."""

    task: TaskId


class MonitorFact(BaseFact, frozen=True):
    """A fact about a monitor."""

    monitor: TaskId


class WaitFact(BaseFact, frozen=True):
    """A fact about a wait for a task or a name.

    The handler of delivery *origin* waits (0: code outside of handlers).
    """

    module: str
    origin: int
    task: TaskId
    moment: int = 0
    awaits: WaitKind = WaitKind.TASK
    name: str = ""

    @property
    def key(self) -> tuple[str, int, int, str, str]:
        """The waiter and what it waits for: the same at the start and the end of the wait."""
        return self.module, self.origin, self.task, self.awaits, self.name
