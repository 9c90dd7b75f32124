"""A coroutine that runs on the event loop of another thread, and is awaited on this one."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, TypeVar

from tca_module.errors import Stopped, TcaError

T = TypeVar("T")
Undo = Callable[[Any], object]


class Remote:
    """A coroutine on the loop *there*, started by a coroutine on the present loop.

    *undo* is called there with the result if no caller receives it.
    """

    def __init__(
        self,
        there: asyncio.AbstractEventLoop,
        coroutine: Coroutine[Any, Any, Any],
        undo: Undo | None = None,
    ) -> None:
        self._here = asyncio.get_running_loop()
        self._there = there
        self._undo = undo
        self._task: asyncio.Task[Any] | None = None
        #: has the result; cancelled if the caller gave up or the coroutine was cancelled there
        self.result: asyncio.Future[Any] = self._here.create_future()
        self.was_cancelled = False  #: the coroutine ended with CancelledError
        there.call_soon_threadsafe(self._start, coroutine)

    def cancel(self) -> None:
        """Cancel the coroutine, or undo its result if that has arrived already."""
        self._post(self._cancel)

    def _cancel(self) -> None:
        assert self._task is not None
        if not self._task.done():
            self._task.cancel()
        elif self.result.done() and not self.result.cancelled():
            self._undo_result(self._task)

    def _post(self, function: Callable[..., object], *arguments: Any) -> None:
        with suppress(RuntimeError):  # its loop is closed
            self._there.call_soon_threadsafe(function, *arguments)

    def _start(self, coroutine: Coroutine[Any, Any, Any]) -> None:
        self._task = self._there.create_task(coroutine)
        self._task.add_done_callback(self._on_done)

    def _on_done(self, task: asyncio.Task[Any]) -> None:
        try:
            self._here.call_soon_threadsafe(self._settle, task)
        except RuntimeError:  # the caller's loop is closed
            self._undo_result(task)

    def _settle(self, task: asyncio.Task[Any]) -> None:
        """Pass the end of the coroutine on to the caller."""
        self.was_cancelled = task.cancelled()
        if self.result.done():
            self._post(self._undo_result, task)
        elif task.cancelled():
            self.result.cancel()
        elif (error := task.exception()) is not None:
            self.result.set_exception(error)
        else:
            self.result.set_result(task.result())

    def _undo_result(self, task: asyncio.Task[Any]) -> None:
        if not task.cancelled() and task.exception() is None and self._undo is not None:
            with suppress(TcaError):
                self._undo(task.result())


async def await_or_give_up(remote: Remote) -> Any:
    """Await a remote coroutine. If the caller is cancelled, cancel it and return at once.

    Raises Stopped if the coroutine was cancelled on its own loop, which ends.
    """
    try:
        return await remote.result
    except asyncio.CancelledError:
        if remote.was_cancelled:
            raise Stopped("the connection was closed while this call waited") from None
        remote.cancel()
        raise


async def run_to_end(there: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine on another loop to its end, also if the caller is cancelled.

    A cancellation is passed on. The coroutine may still clean up.
    """
    remote = Remote(there, coroutine)
    while True:
        try:
            result: T = await asyncio.shield(remote.result)
        except asyncio.CancelledError:
            if remote.result.done():
                raise
            remote.cancel()
        else:
            return result
