"""Facts of failures and their exception handlers; see ``facts``, where all are found."""

from tca_wire.journal.fact import BaseFact, NumberedFact, TaskFact
from tca_wire.points import ROOT, TaskId


class Failed(NumberedFact, frozen=True, tag="failed"):
    """A failure was raised on a task or message, or on what one receiver got: a copy of message *copy_of*.

    Of a module that was lost no handler returns: this ends its part. A failure that is raised *beside* the handler
    changes nothing for the one that has the task. Of that one *by* is the module that raised it, or "central", and
    *body* the failure's data; else the handler raised it, and they are "" and empty.
    """

    failure: str
    text: str
    is_beside: bool = False
    by: str = ""
    body: bytes = b""
    copy_of: int = 0


class Attached(NumberedFact, frozen=True, tag="attached"):
    """Exception handler *handler* takes care of a failure ("": any) of a task, or of all tasks of a message."""

    failure: str
    handler: str
    task: TaskId
    message: str
    maximum: int


class Removed(NumberedFact, frozen=True, tag="removed"):
    """An exception handler or wiretap was taken away."""

    by: str


class Caught(TaskFact, frozen=True, tag="caught"):
    """The failure of a task is handled: task *handler* was made for it, by attachment *attachment* of task *at*."""

    handler: TaskId
    at: TaskId
    attachment: int
    is_beside: bool = False
    """The failure was raised beside the task's handler: that goes on, or another exception handler decides about it."""


class Reissued(BaseFact, frozen=True, tag="reissued"):
    """An exception handler could not deal with its failure; the search goes on."""

    handler: TaskId


class Resolved(BaseFact, frozen=True, tag="resolved"):
    """An exception handler says that its failure is resolved: that counts if its task ends without a failure."""

    handler: TaskId


class NotResolved(BaseFact, frozen=True, tag="not resolved"):
    """An exception handler's task ended and left its failure as it was; the search goes on."""

    handler: TaskId
    task: TaskId


class Unhandled(TaskFact, frozen=True, tag="unhandled"):
    """No exception handler was found for the failure of a task: its top-level task is killed, or *undecided*."""

    undecided: TaskId = ROOT
    """The exception handler that could not decide because of it: it is killed, and the search for the failure that it
    was called for goes on after it."""


class Recovered(TaskFact, frozen=True, tag="recovered"):
    """The failure of a task has been dealt with, by *handler*; the task counts as handled."""

    handler: TaskId = ROOT


class Retried(TaskFact, frozen=True, tag="retried"):
    """A task will be handled again when all under it has ended, with the body as its data if there is one."""

    body: bytes
    by: str
