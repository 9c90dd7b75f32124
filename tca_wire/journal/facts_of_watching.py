"""What the journal records of failures and exception handlers, wiretaps and monitors; the rest is in facts.py."""

import msgspec

from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Condition


class _Fact(msgspec.Struct, frozen=True, array_like=True):
    """What all facts share: an array whose first element is the kind."""


class Failed(_Fact, frozen=True, tag="failed"):
    """A failure was raised on a task or message. Of a module that was lost no handler returns: this ends its part; but
    a failure that is raised *beside* the handler changes nothing for the one that has the task. Of that one *by* is the
    module that raised it, or "central" ("": an older journal does not tell), and *body* the failure's data.
    """

    id: int
    failure: str
    text: str
    is_beside: bool = False
    by: str = ""
    body: bytes = b""


class Attached(_Fact, frozen=True, tag="attached"):
    """Exception handler *handler* takes care of a failure ("": any) of a task, or of all tasks of a message."""

    id: int
    failure: str
    handler: str
    task: TaskId
    message: str
    maximum: int


class Removed(_Fact, frozen=True, tag="removed"):
    """An exception handler or wiretap was taken away."""

    id: int
    by: str = ""


class TapAdded(_Fact, frozen=True, tag="tap"):
    """A wiretap: *listener* is sent whenever the condition comes true of a message, or of one task. *by* is the module
    that asked for it first ("": an older journal does not tell).
    """

    id: int
    condition: Condition
    listener: str
    message: str
    task: TaskId
    by: str = ""


class TapFired(_Fact, frozen=True, tag="tapped"):
    """A wiretap sent its listener (message *listener*; 0: nobody handles it, so nothing was sent)."""

    tap: int
    tapped: int
    listener: int


class MonitorTested(_Fact, frozen=True, tag="tested"):
    """The condition of a monitor was asked; whether it holds."""

    monitor: TaskId
    holds: bool


class MonitorEnded(_Fact, frozen=True, tag="monitor ended"):
    """A monitor watches no longer."""

    monitor: TaskId
    why: str


class Caught(_Fact, frozen=True, tag="caught"):
    """The failure of a task is handled: task *handler* was made for it, by attachment *attachment* of task *at*."""

    task: TaskId
    handler: TaskId
    at: TaskId
    attachment: int


class Reissued(_Fact, frozen=True, tag="reissued"):
    """An exception handler could not deal with its failure; the search goes on."""

    handler: TaskId


class Unhandled(_Fact, frozen=True, tag="unhandled"):
    """No exception handler was found for the failure of a task: its top-level task is killed, or *undecided*."""

    task: TaskId
    undecided: TaskId = ROOT
    """The exception handler that could not decide because of it: it is killed, and the search for the failure that it
    was called for goes on after it."""


class Recovered(_Fact, frozen=True, tag="recovered"):
    """The failure of a task has been dealt with; the task counts as handled."""

    task: TaskId


class Retried(_Fact, frozen=True, tag="retried"):
    """A task will be handled again when all under it has ended, with the body as its data if there is one."""

    task: TaskId
    body: bytes
    by: str = ""
