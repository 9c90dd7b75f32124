"""Handlers that run on the user's own event loop."""

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial, wraps
from typing import Any, Protocol

from tca_module.asynchronous.async_sender import AsyncSender
from tca_module.asynchronous.forwarding import RunThere, forwarded
from tca_module.asynchronous.remote import Remote, Undo, await_or_give_up, run_to_end
from tca_module.checks import is_async
from tca_module.errors import MisuseError
from tca_module.sending.task import Task
from tca_wire.messages.declarations import D, R


class AsyncTask(AsyncSender):
    """The ``Task`` of a handler on the user's own event loop. Its calls are coroutines.

    Goals and commands that are sent with it become subtasks. After a kill of the task, and at the
    end of the module, the handler gets ``asyncio.CancelledError`` where it awaits.

    Attributes:
        message: the name of the message.
        id: the task's number, as in the journal; 0 if the message is not a task of the tree.
    """

    _blocking: Task

    def __init__(self, run: RunThere, task: Task) -> None:
        super().__init__(run, task)
        self.message = task.message
        self.id = task.id

    report = forwarded(Task.report)
    accept = forwarded(Task.accept)
    take = forwarded(Task.take)


class LoopHandlerDecorator(Protocol[D, R]):
    """Declares a coroutine function as a handler, and returns it unchanged."""

    def __call__(
        self, function: Callable[[AsyncTask, D], Coroutine[Any, Any, R]], /
    ) -> Callable[[AsyncTask, D], Coroutine[Any, Any, R]]:
        """Declare *function*, and return it."""


class LoopHandlerDecoratorWithoutData(Protocol[R]):
    """Declares a coroutine function as a handler of a message without data."""

    def __call__(
        self, function: Callable[[AsyncTask], Coroutine[Any, Any, R]], /
    ) -> Callable[[AsyncTask], Coroutine[Any, Any, R]]:
        """Declare *function*, and return it."""


class UserLoop:
    """The user's event loop, on which a module's handlers run.

    Attributes:
        loop: the loop while the module runs on one; else None.
        has_handlers: whether the module has handlers that need a loop.
    """

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self.has_handlers = False

    def handler(self, what: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a handler that a slot calls, and that runs *function* on the user's loop.

        Raises MisuseError if *function* is not ``async def``.
        """
        if not is_async(function):
            raise MisuseError(f"{what}: {function!r:.60} is not 'async def': use handles()")
        self.has_handlers = True

        @wraps(function)
        async def handle(task: Task, *data: Any) -> Any:
            run = partial(_run_in_slot, asyncio.get_running_loop())
            assert self.loop is not None
            return await run_to_end(self.loop, function(AsyncTask(run, task), *data))

        return handle


async def _run_in_slot(
    slot: asyncio.AbstractEventLoop,
    coroutine: Coroutine[Any, Any, Any],
    undo: Undo | None = None,
    /,
) -> Any:
    return await await_or_give_up(Remote(slot, coroutine, undo))
