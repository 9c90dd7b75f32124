"""Errors of the module library, by their cause.

TcaError             the base of the others.
├── MisuseError      the caller's mistake. The call is wrong in any state of the robot.
├── Refused          central refused a request. Nothing of the request remains.
│   ├── FormatRefused    others use the message's name with another format or class.
│   └── Deadlock         the wait would never end.
├── CentralLost      central does not answer, or was restarted and has forgotten the request.
│   └── NotSent          messages may not have arrived when their program left.
├── LockLost         a lock or reservation was taken away before its release.
├── Stopped          the module ends, and so ends the wait.
├── NotDeclared      no module has declared the message (also a LookupError).
├── VariableNotSet   a variable has no value yet (also a LookupError).
├── Timeout          no answer in time (also a TimeoutError).
├── QueryFailed      the handler of a query failed.
├── TaskFailed       a goal or command failed.
├── Rejected         the handler of a task did not accept a new goal.
└── TaskKilled       a goal or command was killed: the awaited task, or the handler's own task.
BadData              data does not fit the format of its message (from tca_wire).
"""

import asyncio
from typing import Any

from tca_wire.errors import BadData as BadData  # noqa: PLC0414 - exported here, too
from tca_wire.errors import CopyableError
from tca_wire.messages.declarations import D, Failure
from tca_wire.messages.formats import decode_untyped
from tca_wire.vocabulary import Refusal

ORDINARY = (Exception, SystemExit, asyncio.CancelledError)
"""Errors that fail one user function only. Others, such as KeyboardInterrupt, end the module."""


CLOCK_STANDS = "the stepped clock stands still: call advance()"
"""The advice for a wait that came to nothing on a stepped clock."""


class TcaError(CopyableError):
    """The base of all errors of this package.

    Cause: any of the errors below.

    Remedy: catch it where the kind does not matter.
    """


class MisuseError(TcaError):
    """The library was called wrongly. The text names the call, the value and the remedy.

    Cause: an argument of the wrong type or range, or a call at the wrong time.

    Remedy: mend the program as the text says. Do not catch this error.
    """


class Refused(TcaError):
    """Central refused a request. Nothing of the request remains.

    Cause: ``refusal`` names it, such as "too late", "overload" or "forbidden".

    Remedy: compare ``refusal`` with a ``Refusal``. The text says what to change.

    Attributes:
        refusal: the kind of refusal, a ``Refusal``.
        text: central's explanation.
    """

    def __init__(self, what: str, refusal: Refusal, text: str) -> None:
        super().__init__(f"{what} was refused: {text}")
        self.refusal = refusal
        self.text = text


class FormatRefused(Refused):
    """A message is declared with another format or class than other programs use.

    Cause: two programs have different versions of a declaration.

    Remedy: import the declaration from one file in all programs, and restart the older one.
    """


class Deadlock(Refused):
    """The wait would never end. The text names the cycle of waits.

    A handler that does not catch this error fails with "deadlock".

    Cause: handlers wait for each other, or for locks that they hold.

    Remedy: break the cycle: add capacity, use another resource, or lock in one order.
    """


class CentralLost(TcaError):
    """Central does not answer, or was restarted and has forgotten the request.

    Calls that name a task from before a restart raise this error, too. Central may have received
    the request. A goal, command or monitor is then killed as soon as central hears from this
    program again. Any other request is carried out.

    Cause: central was not started, has ended, or listens at another address.

    Remedy: start central, and check ``$TCA_CENTRAL``. Give a longer *patience* to wait for it.
    """


class NotSent(CentralLost):
    """Messages may not have arrived when their program left.

    The end of a ``with connect()`` block and the end of a module raise this error.

    Cause: central was away when the program left, or the network is slow.

    Remedy: give a longer *linger*, or connect again and send what is missing.

    Attributes:
        number: the number of messages.
    """

    def __init__(self, number: int, text: str) -> None:
        super().__init__(text)
        self.number = number


class Stopped(TcaError):
    """The module was asked to end while this call waited.

    A handler may catch this error to clean up. A handler that does not catch it fails with "module
    lost", unless its task was killed.

    Cause: Ctrl-C, SIGTERM or ``stop()``.

    Remedy: leave the device safe and return.
    """


class LockLost(TcaError):
    """A lock or reservation was taken away before its release, or central was restarted.

    Other programs may have used the resource since. A handler that does not catch this error fails
    with "lock lost".

    Cause: the module of the resource or central was restarted, or an operator called ``unlock``.

    Remedy: check the state of the device, then lock it again.
    """


class NotDeclared(TcaError, LookupError):
    """No module has declared a message of that name.

    Cause: the name is misspelt, or its module has not started.

    Remedy: see 'tca messages', or use ``wait_until_handled()`` with a declaration.
    """


class VariableNotSet(TcaError, LookupError):
    """A variable has never been set.

    Cause: no program has set it since the start of the run.

    Remedy: set it at the start, or give ``get_variable`` a default.
    """


class Timeout(TcaError, TimeoutError):
    """An answer did not arrive in time.

    Cause: a handler is busy or missing, or the wait was too short.

    Remedy: see what it waits for with 'tca status', or give a longer ``timeout=``.

    Attributes:
        what: the text without advice.
        can_wait: whether a longer ``timeout=`` of the call helps.
    """

    def __init__(self, what: str, *, can_wait: bool = False) -> None:
        can_wait = can_wait and not what.endswith(CLOCK_STANDS)
        super().__init__(f"{what}; to wait longer give timeout=" if can_wait else what)
        self.what = what
        self.can_wait = can_wait


class RequestFailed(TcaError):
    """The base of ``QueryFailed`` and ``TaskFailed``.

    Attributes:
        failure: the name of the failure.
        text: the failure's explanation.
        body: the failure's data, encoded; see ``data`` and ``data_as()``.
        passed_on: the failure's text for a handler that does not catch this error. The handler then
            fails with the same failure.
    """

    def __init__(self, what: str, failure: str, text: str, body: bytes) -> None:
        summary = text.partition("\n")[0]  # a traceback may follow in the next lines
        super().__init__(": ".join(filter(None, (f"{what} failed", failure, summary))))
        self.passed_on = ": ".join(filter(None, (f"{what} failed", summary)))
        self.failure = failure
        self.text = text
        self.body = body

    @property
    def data(self) -> Any:
        """The failure's data as plain values (dicts, lists, numbers, ...); None without data."""
        return decode_untyped(self.body)

    def data_as(self, failure: Failure[D]) -> D:
        """Return the failure's data as *failure* declares it.

        Args:
            failure: the declared failure.

        Returns:
            The data.

        Raises:
            MisuseError: this error has another failure.
            BadData: the data do not fit the declaration.

        Example::

            try:
                user.command(MOVE_LEG, 3).result(timeout=10)
            except TaskFailed as error:
                if error.failure == COLLISION.name:
                    print(error.data_as(COLLISION).force)
        """
        if failure.name != self.failure:
            text = f"this is failure '{self.failure}', not '{failure.name}'"
            raise MisuseError(f"{text}: compare .failure before data_as()")
        return failure.data.decode(self.body or NIL)


NIL = b"\xc0"
"""None as MessagePack."""


class QueryFailed(RequestFailed):
    """The handler of a query failed.

    Cause: the handler raised a failure or an error, or its module was lost.

    Remedy: compare ``failure`` with the names of failures that you expect.

    Attributes:
        failure: the name of the failure.
        text: the failure's explanation.
    """


class TaskFailed(RequestFailed):
    """A goal or command failed.

    Cause: its handler or a subtask failed, and no exception handler dealt with the failure.

    Remedy: attach an exception handler or a ``Retry``, or compare ``failure`` after the wait.

    Attributes:
        failure: the name of the failure.
        text: the failure's explanation.
    """


class Rejected(TcaError):
    """The handler of a task rejected a new goal and continues with the old one.

    Cause: the handler called ``reject()``, or is declared with ``refuses=``.

    Remedy: wait for the task's end, or cancel it, and send a new task.

    Attributes:
        reason: the handler's reason; "" without one.
    """

    def __init__(self, what: str, reason: str) -> None:
        super().__init__(f"{what} was rejected{f': {reason}' if reason else ''}")
        self.reason = reason


class TaskKilled(TcaError):
    """A goal or command was killed.

    A wait for a killed task raises this error. A wait of a handler also raises it when the
    handler's own task was killed or is about to be retried. The handler may catch the error to
    clean up. A handler that does not catch it has not failed.

    Cause: a program or operator killed it, a client's cancel ended it, or a failure above it did.

    Remedy: leave the device safe in the handler. As the sender, read ``why``.

    Attributes:
        why: the reason, and the name of the killer.
    """

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what} was killed: {why}")
        self.why = why
