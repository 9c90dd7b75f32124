"""Errors of the module library, by whose fault they are.

TcaError             do not raise this one; it groups the others
├── MisuseError      the caller: a call that can't be right, whatever the robot does
├── Refused          central refused a request; nothing of it remains
│   ├── FormatRefused    others use a message of that name with another format or class
│   └── Deadlock         whoever asked would wait for ever: what he waits for waits for him
├── CentralLost      central does not answer, or was restarted and has forgotten what was asked
├── LockLost         a lock or reservation was taken away while somebody counted on it
├── Stopped          the module ends: what was waited for is not waited for any more
├── NotDeclared      nobody has declared a message of that name (also a LookupError)
├── VariableNotSet   a variable has no value yet (also a LookupError)
├── Timeout          the answer did not come in time (also a TimeoutError)
├── QueryFailed      the handler of a query failed
├── TaskFailed       a goal or command failed
└── TaskKilled       a goal or command was killed: one that was waited for, or the handler's own
BadData              data does not fit the format of its message (from tca_wire)
"""

from typing import Any

from tca_wire.errors import BadData
from tca_wire.messages.declarations import D, Failure
from tca_wire.messages.formats import decode_untyped
from tca_wire.vocabulary import Refusal


class TcaError(Exception):
    """Base of all errors of this package."""


class MisuseError(TcaError):
    """The library was called in a way that can't be right."""


class Refused(TcaError):
    """Central refused a request: *refusal* is the kind, *text* what central says."""

    def __init__(self, what: str, refusal: Refusal, text: str) -> None:
        super().__init__(f"{what} was refused: {text}")
        self.refusal = refusal
        self.text = text


class FormatRefused(Refused):
    """A message is declared with another format, or class, than others use."""


class Deadlock(Refused):
    """A wait that would never end: what is waited for waits, in the end, for the one who waits. The text names the
    circle. If a handler lets it pass, it is the failure "deadlock" of its task.
    """


class CentralLost(TcaError):
    """Central does not answer, or was restarted. It may have heard what was asked of it, and goes on with that when it
    goes on itself: a goal, command or monitor is killed then, as soon as this program is heard again; all else is done.
    Also raised of each call that names a task of a central before it was restarted.
    """


class NoCentral(CentralLost, SystemExit):
    """Central can't be reached: what ``run``, ``running`` and ``connect`` raise. Caught by nobody, it ends the program
    with one line, not a traceback: whoever starts a robot wants to read what to do.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.code = text


class Stopped(TcaError):
    """The module was told to end: before central had welcomed it, or while a handler waited for others. Such a handler
    may clean up, and wait for that. If it lets this pass, it is the failure "module lost" of its task, unless that was
    killed.
    """


class LockLost(TcaError):
    """A lock or reservation is one no longer: it was taken away, or central was restarted, before it was released. The
    text says by whom, or why; others may have been let in meanwhile. If a handler lets it pass, it is the failure
    "lock lost" of its task.
    """


class NotDeclared(TcaError, LookupError):
    """Nobody has declared a message of that name."""


class VariableNotSet(TcaError, LookupError):
    """A variable was never set."""


class Timeout(TcaError, TimeoutError):
    """An answer did not come in time."""


class _Failed(TcaError):
    """What failed, with which failure; the failure's data in two forms."""

    def __init__(self, what: str, failure: str, text: str, body: bytes) -> None:
        summary = text.partition("\n")[0]  # of a traceback
        super().__init__(f"{what} failed: {failure}: {summary}" if summary else f"{what} failed: {failure}")
        self.failure = failure
        self.text = text
        self.body = body

    @property
    def data(self) -> Any:
        """The failure's data as plain values (dicts, lists, numbers, ...); None without data."""
        return decode_untyped(self.body)

    def data_as(self, failure: Failure[D]) -> D:
        """The data as that failure declares it. Raises MisuseError if this is another failure."""
        if failure.name != self.failure:
            msg = f"this is failure '{self.failure}', not '{failure.name}': compare .failure before data_as()"
            raise MisuseError(msg)
        return failure.data.decode(self.body or NIL)


NIL = b"\xc0"
"""None as MessagePack."""


class QueryFailed(_Failed):
    """The handler of a query failed: ``failure`` is the failure's name."""

    def __init__(self, what: str, failure: str, text: str, body: bytes) -> None:
        super().__init__(what, failure, text, body)


class TaskFailed(_Failed):
    """A goal or command failed: ``failure`` is the failure's name."""

    def __init__(self, what: str, failure: str, text: str, body: bytes) -> None:
        super().__init__(what, failure, text, body)


class TaskKilled(TcaError):
    """A goal or command was killed: ``why`` says why and by whom. If it is the handler's own, or is to be handled
    again, what the handler waited for is not waited for any more, as ``why`` says; it may clean up, and wait for that.
    If it then lets this pass, that is no failure.
    """

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what} was killed: {why}")
        self.why = why


__all__ = [
    "NIL",
    "BadData",
    "CentralLost",
    "Deadlock",
    "FormatRefused",
    "LockLost",
    "MisuseError",
    "NoCentral",
    "NotDeclared",
    "QueryFailed",
    "Refused",
    "Stopped",
    "TaskFailed",
    "TaskKilled",
    "TcaError",
    "Timeout",
    "VariableNotSet",
]
