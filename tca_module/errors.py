"""Errors of the module library, by whose fault they are.

TcaError             the base of the others
├── MisuseError      the caller: a call that can't be right, whatever the robot does
├── Refused          central refused a request; nothing of it remains
│   ├── FormatRefused    others use a message of that name with another format or class
│   └── Deadlock         the wait would never end
├── CentralLost      central does not answer, or was restarted and has forgotten the request
│   └── NotSent          messages may not have arrived when their program left
├── LockLost         a lock or reservation was taken away before its release
├── Stopped          the module ends: the wait is over
├── NotDeclared      nobody has declared a message of that name (also a LookupError)
├── VariableNotSet   a variable has no value yet (also a LookupError)
├── Timeout          no answer in time (also a TimeoutError)
├── QueryFailed      the handler of a query failed
├── TaskFailed       a goal or command failed
├── Rejected         the handler of a task did not take over a new goal
└── TaskKilled       a goal or command was killed: one waited for, or the handler's own
BadData              data does not fit the format of its message (from tca_wire)
"""

import asyncio
from typing import Any

from tca_wire.errors import BadData as BadData  # noqa: PLC0414 - it belongs to them
from tca_wire.errors import CopyableError
from tca_wire.messages.declarations import D, Failure
from tca_wire.messages.formats import decode_untyped
from tca_wire.vocabulary import Refusal

ORDINARY = (Exception, SystemExit, asyncio.CancelledError)
"""Errors of users' functions that concern these alone; others, such as KeyboardInterrupt, end the
module.
"""


class TcaError(CopyableError):
    """The base of all errors of this package."""


class MisuseError(TcaError):
    """The library was called in a way that can't be right."""


class Refused(TcaError):
    """Central refused a request: *refusal* is the kind, *text* is central's explanation."""

    def __init__(self, what: str, refusal: Refusal, text: str) -> None:
        super().__init__(f"{what} was refused: {text}")
        self.refusal = refusal
        self.text = text


class FormatRefused(Refused):
    """A message is declared with another format or class than others use."""


class Deadlock(Refused):
    """The wait would never end; the text names the circle. A handler that does not catch it fails
    with "deadlock".
    """


class CentralLost(TcaError):
    """Central does not answer, or was restarted; also raised by calls that name a task from before
    a restart. Central may have got the request: a goal, command or monitor is then killed as soon
    as it hears this program again, anything else is done.
    """


class NotSent(CentralLost):
    """So many messages, *number*, may not have arrived when their program left. Raised by the end
    of a ``with connect()`` block, and by that of a module.
    """

    def __init__(self, number: int, text: str) -> None:
        super().__init__(text)
        self.number = number


class Stopped(TcaError):
    """The module was told to end: before central had welcomed it, or while a handler waited, which
    may clean up now. If it does not catch this, it fails with "module lost", unless its task was
    killed.
    """


class LockLost(TcaError):
    """A lock or reservation was taken away, or central was restarted, before its release; others
    may have been let in. A handler that does not catch it fails with "lock lost".
    """


class NotDeclared(TcaError, LookupError):
    """Nobody has declared a message of that name."""


class VariableNotSet(TcaError, LookupError):
    """A variable was never set."""


class Timeout(TcaError, TimeoutError):
    """An answer did not come in time: *what* says so, without advice; *can_wait*: the call's
    timeout= sets the time.
    """

    def __init__(self, what: str, *, can_wait: bool = False) -> None:
        super().__init__(f"{what}; to wait longer give timeout=" if can_wait else what)
        self.what = what
        self.can_wait = can_wait


class RequestFailed(TcaError):
    """A request, the failure it ended with, and the failure's data."""

    def __init__(self, what: str, failure: str, text: str, body: bytes) -> None:
        summary = text.partition("\n")[0]  # of a traceback
        super().__init__(": ".join(filter(None, (f"{what} failed", failure, summary))))
        self.passed_on = ": ".join(filter(None, (f"{what} failed", summary)))
        """The words of the failure of the same name that a handler has which does not catch
        this.
        """
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


class QueryFailed(RequestFailed):
    """The handler of a query failed: ``failure`` is the failure's name."""


class TaskFailed(RequestFailed):
    """A goal or command failed: ``failure`` is the failure's name."""


class Rejected(TcaError):
    """The handler of a task goes on with its goal, and not with the new one: *reason* says why."""

    def __init__(self, what: str, reason: str) -> None:
        super().__init__(f"{what} was rejected" + (f": {reason}" if reason else ""))
        self.reason = reason


class TaskKilled(TcaError):
    """A goal or command was killed: ``why`` says why and by whom. A handler whose own task was
    killed, or is to be handled again, may clean up now; not catching this is no failure.
    """

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what} was killed: {why}")
        self.why = why
