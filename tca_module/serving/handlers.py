"""Handlers: users' functions, checked when they are declared, and the outcome of a call."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Protocol, TypeVar, overload

from tca_module.checks import check_function, is_async
from tca_module.errors import NIL, ORDINARY, MisuseError, Stopped, TaskKilled
from tca_module.link.connection import Connection
from tca_module.sending.handler_errors import Aborted, Misfit, failure_of, handler_error
from tca_module.sending.later_reply import LaterReply
from tca_module.sending.task import Task
from tca_module.serving.annotations import check_annotations
from tca_module.session.open_deliveries import task_is_killed
from tca_wire.errors import BadData
from tca_wire.messages.declarations import D, Message, R
from tca_wire.packets.headers import Deliver, Fail, Reply
from tca_wire.packets.parts import HandlerFormat

T = TypeVar("T")

AnswerCoroutine = Coroutine[Any, Any, R | LaterReply[R]]
"""The coroutine of an ``async def`` handler."""
WithoutData = Callable[[Task], T] | Callable[[Task, None], T]
"""The handler of a message without data."""


class HandlerDecorator(Protocol[D, R]):
    """Declares the decorated function as a handler, and returns it unchanged.

    If no overload fits, a type checker names the first overload.
    """

    @overload
    def __call__(self, function: Callable[[Task, D], R], /) -> Callable[[Task, D], R]: ...
    @overload
    def __call__(
        self, function: Callable[[Task, D], R | LaterReply[R]], /
    ) -> Callable[[Task, D], R | LaterReply[R]]: ...
    @overload
    def __call__(
        self, function: Callable[[Task, D], Coroutine[Any, Any, R]], /
    ) -> Callable[[Task, D], Coroutine[Any, Any, R]]: ...
    @overload
    def __call__(
        self, function: Callable[[Task, D], AnswerCoroutine[R]], /
    ) -> Callable[[Task, D], AnswerCoroutine[R]]: ...


class HandlerDecoratorWithoutData(Protocol[R]):
    """Declares a handler of a message without data, which the function need not accept."""

    @overload
    def __call__(self, function: WithoutData[R], /) -> Callable[..., R]: ...
    @overload
    def __call__(
        self, function: WithoutData[R | LaterReply[R]], /
    ) -> Callable[..., R | LaterReply[R]]: ...
    @overload
    def __call__(
        self, function: WithoutData[Coroutine[Any, Any, R]], /
    ) -> Callable[..., Coroutine[Any, Any, R]]: ...
    @overload
    def __call__(
        self, function: WithoutData[AnswerCoroutine[R]], /
    ) -> Callable[..., AnswerCoroutine[R]]: ...


Answer = tuple[Reply | Fail, bytes] | LaterReply[Any]
"""The outcome of a handler for central, or the LaterReply that will bring it."""


class Handler:
    """A function that handles a message, in a resource."""

    def __init__(
        self,
        message: Message[Any, Any],
        function: Callable[..., Any],
        handler_format: HandlerFormat,
    ) -> None:
        self.message = message
        self.function = function
        self.resource = handler_format.resource
        self.format = handler_format  #: this handler, as it is declared to central
        self.name = getattr(function, "__qualname__", repr(function))
        self.is_async = is_async(function)
        # Without data, one argument is tried first, so that a second parameter keeps its default.
        has_data = message.data.kind is not type(None)
        wanted = f"(task, data: {message.data})" if has_data else "(task)"
        what, possible = f"a handler of {message.title}", (2,) if has_data else (1, 2)
        self._argument_count = check_function(what, function, wanted, possible, may_be_async=True)
        check_annotations(self.name, function, message)

    def task(self, connection: Connection, delivery: Deliver) -> Task:
        """Create the Task of a delivered message."""
        return Task(connection, delivery, self.message, accepts=self.format.accepts)

    def handle(self, task: Task, body: bytes) -> Answer:
        """Call the function; return its outcome for central, or the LaterReply that will bring it.

        Raises errors that must end the module.
        """
        try:
            return self._outcome(task, self.function(*self._arguments_for(task, body)))
        except ORDINARY as error:
            return self._failed(task, error)

    async def handle_async(self, task: Task, body: bytes) -> Answer:
        """Call the coroutine function; otherwise like ``handle``."""
        task.is_async = True
        try:
            return self._outcome(task, await self.function(*self._arguments_for(task, body)))
        except ORDINARY as error:
            return self._failed(task, error)

    def _arguments_for(self, task: Task, body: bytes) -> tuple[Any, ...]:
        try:
            return (task, self.message.decode_data(body))[: self._argument_count]
        except BadData as error:
            raise Misfit(str(error)) from None

    def _outcome(self, task: Task, returned: Any) -> Answer:
        """Return the outcome of a handler that has returned a value."""
        task.raise_send_errors()
        later = task.later
        if isinstance(returned, LaterReply) or later is not None:
            if later is None or returned is not later:
                text = f"called reply_later() but returned {returned!r:.60}: return the LaterReply"
                if later is None:
                    own = "return the one of its own task.reply_later()"
                    text = f"returned the LaterReply of another handler: {own}"
                raise MisuseError(f"handler {self.name} {text}")
            return later
        try:
            reply = Reply(task.delivery, transition=task.ending)
            return reply, task.encode_reply(returned)
        except BadData as error:
            raise Misfit(f"{error} (handler {self.name})") from None

    def _failed(self, task: Task, error: BaseException) -> Answer:
        """Return the outcome of a handler that has raised an error."""
        if task.later is not None:
            task.later.end(f"its handler failed: {type(error).__name__}")
        was_cancelled = isinstance(error, asyncio.CancelledError | TaskKilled) and task.cancelled
        is_stopped_by_kill = isinstance(error, Stopped) and task_is_killed()
        # The handler was asked to end, and does so. That is no failure.
        if was_cancelled or is_stopped_by_kill or isinstance(error, Aborted):
            return Reply(task.delivery), NIL
        # Not the handler was cancelled, but a coroutine that it ran.
        if isinstance(error, asyncio.CancelledError) and not self.is_async:
            return handler_error(task.delivery, error)
        return failure_of(task.delivery, error)
