"""The bases of facts."""

import msgspec

from tca_wire.points import TaskId


class BaseFact(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The base of all facts: an array whose first element is the kind. No fact refers to itself, so
    none is garbage that Python has to look for (``gc``): a journal is read faster.
    """


class NumberedFact(BaseFact, frozen=True):
    """A fact about a message, a delivery, a claim, or what can be removed, by its number."""

    id: int


class TaskFact(BaseFact, frozen=True):
    """A fact about a task."""

    task: TaskId


class MonitorFact(BaseFact, frozen=True):
    """A fact about a monitor."""

    monitor: TaskId
