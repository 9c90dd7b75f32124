"""The steps of paths through a run: spans of time that had to pass before the next step."""

from dataclasses import dataclass
from enum import StrEnum

from tca_tools.journal.records import HandlerWait, Handling, Hold, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import ROOT
from tca_wire.text.facts_in_words import place


class Doing(StrEnum):
    """The kind of a step."""

    WORK = "work"  # a handler ran and did not wait
    OUTSIDE = "outside"  # a module worked outside of any handler
    DELAY = "delay"  # a constraint with a delay
    NO_HANDLER = "no handler"  # no module handled the message
    QUEUED = "queued"  # the message waited for a resource whose holder is not known
    LOCKED = "locked"  # a program outside of handlers held a lock, or a lock was not granted
    SUSPENDED = "suspended"  # the task was, and no handler below it was running any more
    # The task ran until another module killed it or raised a failure on it
    KILLED = "until it was killed"
    HELD = "held"  # by a constraint, or by the task's parent
    CIRCLE = "in a cycle of waits"  # a deadlock
    WATCHING = "watching"  # a monitor, until its next test or until its condition held
    UNKNOWN = "not known"  # the journal does not contain the cause of the wait


@dataclass(slots=True)
class PathStep:
    """A span of time that had to pass before the next step could start."""

    start: float
    end: float
    doing: Doing
    message_id: int
    """The message that was handled or waited (0: none)."""
    module: str = ""
    """The module that ran a handler, or worked outside of handlers; "" if none did."""
    resource: str = ""
    handling: Handling | None = None
    """The run of the handler, if one ran."""
    resumed: HandlerWait | None = None
    """The wait after which the handler resumed; None if it started."""

    @property
    def seconds(self) -> float:
        """The duration."""
        return self.end - self.start

    @property
    def where(self) -> str:
        """The resource, or the module."""
        return place(self.module, self.resource) if self.module else ""


def delay_of(run: Run, task: Task, hold: Hold) -> tuple[float, int]:
    """Return the start of a constraint's delay, and the message that started it."""
    before = hold.constraint.before
    other = run.tasks.get(before.task) if before.task != ROOT else None
    if other is None:
        return hold.added, task.id
    return other.reached.get(before.moment, hold.added), other.id
