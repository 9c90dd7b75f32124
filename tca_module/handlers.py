"""Handlers: users' functions, checked when they are declared, and what becomes of one call."""

import inspect
import traceback
from collections.abc import Callable
from types import TracebackType
from typing import Any

from tca_module.errors import MisuseError
from tca_module.task import Task
from tca_wire.declarations import FailureRaised, Message, Variable
from tca_wire.errors import BadData
from tca_wire.headers import Deliver, Fail, HandlerFormat, Reply

HANDLER_ERROR = "handler error"
BAD_DATA = "bad data"
_TRACEBACK_LIMIT = 8000  # characters
_MOST_PENDING = 10_000  # what central keeps for one resource anyway


class Handler:
    """That a function handles a message, in a resource."""

    def __init__(
        self, message: Message[Any, Any], function: Callable[..., Any], resource: str, pool: str, pending: int | None
    ) -> None:
        if not isinstance(message, Message):
            msg = f"handles() wants a message (Goal, Command, Query, ...), and {message!r} is none"
            raise MisuseError(msg)
        self.message = message
        self.function = function
        self.resource = resource
        self.pool = pool
        self.pending = self._checked_pending(pending)
        self.name = getattr(function, "__qualname__", repr(function))
        self._arguments = self._checked_arguments()

    @property
    def format(self) -> HandlerFormat:
        """What central is told of this handler."""
        return HandlerFormat(self.message.name, self.resource, self.pool, self.pending)

    def _checked_pending(self, pending: int | None) -> int:
        if pending is not None and (not isinstance(pending, int) or not 1 <= pending <= _MOST_PENDING):
            allowed = f"1 to {_MOST_PENDING} may wait, or None"
            msg = f"'{self.message.name}' can't be handled with pending={pending!r}: {allowed}"
            raise MisuseError(msg)
        if isinstance(self.message, Variable) and pending not in (None, 1):
            msg = f"variable '{self.message.name}' can't be handled with pending={pending}: only its newest value waits"
            raise MisuseError(msg)
        return pending or 0

    def _checked_arguments(self) -> int:
        """How many arguments the function takes: task and data, or the task alone where there is no data."""
        what = f"handler {self.name} of {self.message.message_class} '{self.message.name}'"
        called = getattr(self.function, "__call__", None)  # noqa: B004
        if any(map(inspect.iscoroutinefunction, (self.function, called))):
            msg = f"{what} is 'async def', which is not possible yet: make it a plain function"
            raise MisuseError(msg)
        try:
            signature = inspect.signature(self.function)
        except (TypeError, ValueError):
            return 2
        # Without data one argument comes first: a second one with a default is the author's own.
        for arguments in (1, 2) if self.message.data.kind is type(None) else (2,):
            if _fits(signature, arguments):
                return arguments
        wanted = "(task)" if self.message.data.kind is type(None) else f"(task, data: {self.message.data})"
        msg = f"{what} is declared with {signature}: declare it with {wanted}"
        raise MisuseError(msg)

    def handle(self, task: Task, delivery: Deliver, body: bytes) -> tuple[Reply | Fail, bytes]:
        """Call the function; what central is told of how it ended. Raises nothing."""
        try:
            data = self.message.decode_data(body)
        except BadData as error:
            return Fail(delivery.delivery, BAD_DATA, str(error)), b""
        try:
            reply = self.function(*(task, data)[: self._arguments])
        except FailureRaised as failure:
            return Fail(delivery.delivery, failure.name, failure.text), failure.body
        except (Exception, SystemExit) as error:  # noqa: BLE001
            return Fail(delivery.delivery, HANDLER_ERROR, _describe(error)), b""
        try:
            return Reply(delivery.delivery), self.message.encode_reply(reply)
        except BadData as error:
            return Fail(delivery.delivery, BAD_DATA, f"{error} (handler {self.name})"), b""


def _fits(signature: inspect.Signature, arguments: int) -> bool:
    try:
        signature.bind(*(None,) * arguments)
    except TypeError:
        return False
    return True


def _describe(error: BaseException) -> str:
    """The error in one line, then its traceback from the handler on."""
    lines = traceback.format_exception(type(error), error, _from_the_handler_on(error.__traceback__))
    text = "".join(lines).rstrip()
    if len(text) > _TRACEBACK_LIMIT:
        text = f"{text[: _TRACEBACK_LIMIT // 2]}\n...\n{text[-_TRACEBACK_LIMIT // 2 :]}"
    return f"{''.join(traceback.format_exception_only(error)).rstrip()}\n{text}"


def _from_the_handler_on(trace: TracebackType | None) -> TracebackType | None:
    """Without the frame that called the handler: it says nothing to the handler's author."""
    return trace.tb_next if trace is not None and trace.tb_next is not None else trace
