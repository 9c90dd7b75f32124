"""The part of a Module that runs on the user's own event loop."""

import asyncio
import signal
import threading
from abc import abstractmethod
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AbstractContextManager, asynccontextmanager, contextmanager, suppress
from functools import partial
from typing import Any, Unpack, overload

from tca_module.asynchronous.async_sender import AsyncSender
from tca_module.asynchronous.connection_thread import ConnectionThread
from tca_module.asynchronous.loop_handlers import (
    LoopHandlerDecorator,
    LoopHandlerDecoratorWithoutData,
    UserLoop,
)
from tca_module.checks import with_options
from tca_module.errors import MisuseError, Stopped
from tca_module.link.connection import LINGER
from tca_module.link.stop import Stop
from tca_module.link.waits import PATIENCE
from tca_module.sending.sender import Sender
from tca_module.serving.handler_options import HandlerOptions
from tca_module.serving.module_callbacks import ModuleCallbacks
from tca_wire.messages.declarations import D, Message, R


class LoopModule(ModuleCallbacks):
    """The calls of a Module that use the user's own event loop."""

    _stop: Stop

    def __init__(self) -> None:
        super().__init__()
        self._user_loop = UserLoop()

    @abstractmethod
    def handles(self, message: Any, **options: Unpack[HandlerOptions]) -> Any:
        """Declare a handler, see ``Module``."""

    @abstractmethod
    def running(
        self, *, patience: float, reconnect: bool, linger: float
    ) -> AbstractContextManager[Sender]:
        """Handle messages while a ``with`` block lasts, see ``Module``."""

    @overload
    def handles_on_loop(
        self, message: Message[None, R], **options: Unpack[HandlerOptions]
    ) -> LoopHandlerDecoratorWithoutData[R]: ...
    @overload
    def handles_on_loop(
        self, message: Message[D, R], **options: Unpack[HandlerOptions]
    ) -> LoopHandlerDecorator[D, R]: ...
    @with_options
    def handles_on_loop(self, message: Message[Any, Any], **options: Unpack[HandlerOptions]) -> Any:
        """Declare the decorated ``async def`` function as a handler on the user's own event loop.

        The loop is that of ``running_async`` or ``arun``. The function gets an ``AsyncTask`` and
        the message's data. Results, failures and options are those of ``handles``. While the
        function awaits, its slot of the resource stays busy.

        Args:
            message: the message. A module has at most one handler for each message.
            options: see ``HandlerOptions``.

        Returns:
            A decorator that returns the function unchanged.

        Raises:
            MisuseError: the function is not ``async def``; or as for ``handles``.

        Example::

            @eyes.handles_on_loop(LOOK)
            async def look(task: AsyncTask, place: Place) -> Image:
                return await camera.shoot(await task.query(POSE, place))
        """
        declare, what = self.handles(message, **options), f"handles_on_loop() of {message.title}"

        def declare_on_loop(function: Callable[..., Any]) -> Callable[..., Any]:
            declare(self._user_loop.handler(what, function))
            return function

        return declare_on_loop

    async def arun(
        self, *, patience: float = PATIENCE, reconnect: bool = True, linger: float = LINGER
    ) -> None:
        """Handle messages until Ctrl-C, SIGTERM, ``stop()`` or a cancellation, as ``run`` does.

        Handlers of ``handles_on_loop`` run on the present event loop. Signals end the module only
        if that loop runs in the main thread.

        Args:
            patience: see ``run``. Default: 10 s.
            reconnect: see ``run``. Default: True.
            linger: see ``run``. Default: 10 s.

        Raises:
            CentralLost, NotSent, MisuseError: as for ``run``.
        """
        stopped, loop = asyncio.Event(), asyncio.get_running_loop()

        def wake() -> None:
            loop.call_soon_threadsafe(stopped.set)

        running = self.running_async(patience=patience, reconnect=reconnect, linger=linger)
        with _stopping_signals(loop, self._stop), suppress(Stopped):
            async with running:
                self._stop.on_set(wake)
                await stopped.wait()

    @asynccontextmanager
    async def running_async(
        self, *, patience: float = PATIENCE, reconnect: bool = True, linger: float = LINGER
    ) -> AsyncIterator[AsyncSender]:
        """Handle messages while an ``async with`` block lasts, see ``running``.

        Handlers of ``handles_on_loop`` run on the present event loop.

        Args:
            patience: see ``run``. Default: 10 s.
            reconnect: see ``run``. Default: True.
            linger: see ``run``. Default: 10 s.

        Yields:
            An AsyncSender, which sends under the root in the module's name.

        Raises:
            CentralLost, NotSent, MisuseError: as for ``running``.

        Example::

            async with eyes.running_async() as sender:
                await sender.command(LOOK, place)
        """
        running = partial(self.running, patience=patience, reconnect=reconnect, linger=linger)
        thread = ConnectionThread(running, f"module '{self.name}'")
        if self._link is None:
            self._user_loop.loop = asyncio.get_running_loop()
        sender = await thread.open()
        try:
            yield AsyncSender(thread.run, sender)
        except BaseException as error:
            await thread.close(error)
            raise
        await thread.close()

    def _check_loop(self) -> None:
        """Raise MisuseError if the module has handlers on a loop, but runs on none."""
        if self._user_loop.has_handlers and self._user_loop.loop is None:
            advice = "await arun(), or use 'async with' with running_async()"
            raise MisuseError(f"module '{self.name}' has handlers on an event loop: {advice}")


@contextmanager
def _stopping_signals(loop: asyncio.AbstractEventLoop, stop: Stop) -> Iterator[None]:
    """Set *stop* at the first SIGINT or SIGTERM, if the loop runs in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def remove() -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)

    def on_signal() -> None:
        remove()  # the second signal ends the process
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, on_signal)
    try:
        yield
    finally:
        remove()
