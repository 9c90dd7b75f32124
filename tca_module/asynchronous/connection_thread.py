"""A thread that owns a connection, and runs its waits as coroutines on an event loop."""

import asyncio
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from contextlib import AbstractContextManager
from typing import Any

from tca_module.asynchronous.remote import Remote, Undo, await_or_give_up
from tca_module.errors import MisuseError
from tca_module.link.connection import Connection
from tca_module.sending.sender import Sender
from tca_module.serving.event_loop import EventLoop
from tca_wire.packets.headers import Deliver


class ConnectionThread:
    """The thread of one connection, from the start to the end of an ``async with`` block.

    *opening* opens the connection for a ``with`` block, such as ``connect(...)``.
    """

    def __init__(self, opening: Callable[[], AbstractContextManager[Sender]], owner: str) -> None:
        self._opening = opening
        self._owner = owner  # for errors
        self._lock = threading.Lock()
        self._connection: Connection | None = None
        self._loop: asyncio.AbstractEventLoop | None = None  # set while it accepts calls
        self._closing: asyncio.Future[None] | None = None
        self._is_closing = False
        self._error: BaseException | None = None  # with which the user's block ends
        self._opened = Future[Sender]()
        self._ended = Future[None]()
        self._thread = threading.Thread(target=self._run, name=owner, daemon=True)

    async def open(self) -> Sender:
        """Start the thread, and await its Sender. Raises what the opening raises."""
        if self._thread.ident is not None:
            raise MisuseError(f"{self._owner} was opened before: make a new one for each block")
        self._thread.start()
        try:
            return await asyncio.shield(asyncio.wrap_future(self._opened))
        except BaseException:
            self._ask_to_close(None)
            raise

    async def close(self, error: BaseException | None = None) -> None:
        """Close the connection, and await the end. Raises what the end of its block raises.

        Calls that still wait raise Stopped. *error*: the error with which the user's block ends.
        """
        if self._connection is not None:
            if self._connection.is_inherited:
                return  # the process that opened it says goodbye
            self._ask_to_close(error)
            await asyncio.shield(asyncio.wrap_future(self._ended))

    async def run(self, coroutine: Coroutine[Any, Any, Any], undo: Undo | None = None) -> Any:
        """Run a coroutine in the thread, and await its result.

        *undo* is called with the result if the caller is cancelled. Raises what the coroutine
        raises, and MisuseError if the connection is closed or was opened by another process.
        """
        if self._connection is not None and self._connection.is_inherited:
            coroutine.close()
            self._connection.check_process()
        with self._lock:
            remote = Remote(self._loop, coroutine, undo) if self._loop is not None else None
        if remote is None:
            coroutine.close()
            state = "closed" if self._is_closing else "not open"
            raise MisuseError(f"{self._owner} is {state}: use it inside its 'async with' block")
        return await await_or_give_up(remote)

    def _ask_to_close(self, error: BaseException | None) -> None:
        with self._lock:
            self._error = self._error or error
            self._is_closing = True
            if self._loop is not None:
                self._loop.call_soon_threadsafe(self._stop_loop)

    def _stop_loop(self) -> None:
        if self._closing is not None and not self._closing.done():
            self._closing.set_result(None)

    def _run(self) -> None:
        try:
            with self._opening() as sender:
                self._serve(sender)
                self._raise_error()
        except BaseException as error:  # noqa: BLE001 - raised by open() or close()
            if not self._opened.done():
                self._opened.set_exception(error)
            if error is self._error:
                self._ended.set_result(None)  # the user's block ends with it
            else:
                self._ended.set_exception(error)
        else:
            self._ended.set_result(None)

    def _raise_error(self) -> None:
        """Let the connection's block end as the user's block does."""
        if self._error is not None:
            raise self._error

    def _serve(self, sender: Sender) -> None:
        connection = sender._connection()  # noqa: SLF001
        events = EventLoop(connection, _ignore)
        try:
            with self._lock:
                self._connection = connection
                self._closing = events.loop.create_future()
                self._loop = None if self._is_closing else events.loop
            self._opened.set_result(sender)
            if self._loop is not None:
                with connection.locked():  # the loop keeps it alive, no other thread may
                    connection.line.is_occupied = True
                    events.run_until(self._closing)
        finally:
            with self._lock:
                self._loop = None
            events.close()


def _ignore(_: Deliver, __: bytes) -> None:
    """Do nothing: this connection has no handlers."""
