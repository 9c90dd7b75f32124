"""The steps of paths through a run: spans of time, and what had to pass in each."""

from dataclasses import dataclass
from enum import StrEnum

from tca_tools.journal.records import HandlerWait, Handling, Hold, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import ROOT
from tca_wire.text.facts_in_words import place


class Doing(StrEnum):
    """The kind of a step."""

    WORK = "work"  # a handler ran, and waited for nothing
    OUTSIDE = "outside"  # a module worked outside of any handler
    DELAY = "delay"  # a constraint with a delay
    NO_HANDLER = "no handler"  # nobody handled the message
    QUEUED = "queued"  # for a resource, and no handler is known that had it
    LOCKED = "locked"  # a resource was locked from outside of any handler, or a lock was waited for in vain
    SUSPENDED = "suspended"  # and nothing under it ran on any more
    KILLED = "until it was killed"  # it went on until it was killed, or a failure was raised on it, from outside
    HELD = "held"  # by a constraint, or its parent
    CIRCLE = "in a circle of waits"  # what was waited for waits for itself
    WATCHING = "watching"  # a monitor, until it looked again or its condition held
    UNKNOWN = "not known"  # the journal does not say what was waited for


@dataclass(slots=True)
class PathStep:
    """A span of time, and what had to pass in it before what follows could happen."""

    start: float
    end: float
    doing: Doing
    message_id: int
    """The message that was handled or waited (0: none)."""
    module: str = ""
    """Whose handler ran, or who worked outside of one; "" if nobody did."""
    resource: str = ""
    handling: Handling | None = None
    """The run of the handler, if it was one."""
    resumed: HandlerWait | None = None
    """The wait whose end let it go on; None if it began then."""

    @property
    def seconds(self) -> float:
        """How long it took."""
        return self.end - self.start

    @property
    def where(self) -> str:
        """The resource, or the module."""
        return place(self.module, self.resource) if self.module else ""


def delay_of(run: Run, task: Task, hold: Hold) -> tuple[float, int]:
    """When the delay of a constraint began; and the message with which it did."""
    before = hold.constraint.before
    other = run.tasks.get(before.task) if before.task != ROOT else None
    return (
        (other.reached.get(before.moment, hold.added), other.id) if other else (hold.added, task.id)
    )
