"""The asyncio event loop of one slot: it runs ``async def`` handlers and listens to central.

The loop runs while a coroutine is handled. It also runs while the slot is idle, for asyncio tasks
that handlers have started. It does not run during a plain handler or a callback.
"""

import asyncio
import math
import selectors
import time
from collections.abc import Callable, Collection, Coroutine, Generator
from contextlib import nullcontext
from functools import partial
from operator import itemgetter
from typing import Any, TypeVar

from tca_module.checks import BRIEF
from tca_module.link.connection import Connection
from tca_module.link.packet_line import STALL, STEP
from tca_module.serving.coroutine_waits import CoroutineWaits
from tca_module.session.open_deliveries import OpenDelivery
from tca_module.session.request import Request
from tca_module.session.session import quiet_within
from tca_module.sockets.transport import Transport
from tca_wire.packets.headers import Deliver

T = TypeVar("T")

# the most seconds between two exchanges with central while every handler awaits its answers
_CALM = 1.0


class EventLoop:
    """An event loop that also listens to central.

    *handle_delivery* handles the queries that the slot sends to itself.
    """

    def __init__(
        self, connection: Connection, handle_delivery: Callable[[Deliver, bytes], None]
    ) -> None:
        self._connection = connection
        self._handle_delivery = handle_delivery
        #: handler -> its unfinished asyncio task
        self._tasks: dict[OpenDelivery, asyncio.Task[Any]] = {}
        #: request -> the futures that wait for news of it
        self._waiting: dict[Request, list[asyncio.Future[None]]] = {}
        #: set while the slot is idle; done when it has something to do
        self._idle: asyncio.Future[None] | None = None
        self._is_closing = False
        self._timer: asyncio.TimerHandle | None = None  #: calls ``_keep_alive``
        #: a flush is scheduled for when all ready coroutines have run
        self._is_flushing = False
        #: a handler's error that must end the module
        self._fatal: BaseException | None = None
        #: the handlers that have ended since the loop last turned
        self._ended: list[OpenDelivery] = []
        self._has_warned: set[str] = set()  #: the handlers that the log has warned of
        transport = connection.transport
        self._selector = selector = _Selector(
            transport.waker().fileno(), self._has_work, transport, self._warn_of_blocking
        )
        self._runner = asyncio.Runner(loop_factory=lambda: asyncio.SelectorEventLoop(selector))
        self._loop = self._runner.get_loop()
        self._coroutine_waits = CoroutineWaits(
            self._loop, connection, partial(self._schedule_keep_alive, STEP)
        )
        for file in transport.files():
            self._loop.add_reader(file, self._on_news)
        #: the earliest start of central's silence; the time of the last ``_keep_alive``
        self._silent_since = self._kept_alive = self._loop.time()
        connection.await_news, connection.await_moment = self._await_news, selector.sleep_until

    @property
    def is_running(self) -> bool:
        """Whether the caller runs inside the loop."""
        return self._loop.is_running()

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The asyncio event loop."""
        return self._loop

    def run(self, handler: OpenDelivery, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run the coroutine of a handler to its end; return its result."""
        return self.run_until(self.start(handler, coroutine))

    def run_until(self, future: asyncio.Future[T]) -> T:
        """Run until a future is done, and keep the connection alive; return the result."""
        self._silent_since = self._kept_alive = self._loop.time()
        self._timer = self._loop.call_later(STEP, self._keep_alive)
        try:
            return self._run_until(future)
        finally:
            self._timer.cancel()
            self._timer = None

    def _run_until(self, future: asyncio.Future[T]) -> T:
        """Run until a future is done.

        Also raises an error of another handler that must end the module.
        """
        self._selector.turned = time.monotonic()
        try:
            return self._loop.run_until_complete(future)
        finally:
            self._warn_of_blocking()
            if self._fatal is not None:
                raise self._fatal

    def start(self, handler: OpenDelivery, coroutine: Coroutine[Any, Any, T]) -> "asyncio.Task[T]":
        """Run the coroutine of a handler beside the one that is being run."""
        task = self._coroutine_waits.start_task(handler, coroutine)
        self._tasks[handler] = task
        task.add_done_callback(partial(self._on_done, handler))
        return task

    def _on_done(self, handler: OpenDelivery, task: asyncio.Task[Any]) -> None:
        self._tasks.pop(handler, None)
        self._ended.append(handler)
        error = None if task.cancelled() else task.exception()
        if error is not None and not self._is_closing:
            self._fatal = error
            self._loop.stop()

    def _warn_of_blocking(self) -> None:
        """Warn of handlers that have blocked the loop for a second."""
        now, ended = time.monotonic(), self._ended
        seconds, self._selector.turned, self._ended = now - self._selector.turned, now, []
        if seconds < BRIEF:
            return
        messages = {one.name.partition(" {")[0] for one in (*self._tasks, *ended)}
        names = " or ".join(sorted(messages))
        if names and names not in self._has_warned:
            self._has_warned.add(names)
            self._connection.log.warning(
                "the async handler of %s has blocked its event loop for %.1f s: await long calls,"
                " such as task.sleep(), asyncio.to_thread() or query_send()",
                names,
                seconds,
            )

    def wait(self, seconds: float, files: Collection[int]) -> dict[int, bool]:
        """Run the loop until something has arrived, like ``wait_for_files``."""
        ready: dict[int, bool] = {}
        self._idle = idle = self._loop.create_future()
        timer = self._loop.call_later(max(0.0, seconds), self._end_wait)
        for file in files:
            try:
                self._loop.add_reader(file, self._on_readable, ready, file)
            except OSError:
                ready[file] = False
                self._end_wait()
        self._run_until(idle)
        self._idle = None
        timer.cancel()
        for file in files:
            self._loop.remove_reader(file)
        return ready

    def close(self) -> None:
        """Cancel the remaining asyncio tasks, and close the loop."""
        self._is_closing = True
        # If an error ended the last run, its stop may be pending: run once to consume it.
        self._loop.call_soon(self._loop.stop)
        self._loop.run_forever()
        self._runner.close()
        self._connection.await_news = self._connection.await_moment = None

    def _has_work(self) -> bool:
        """Return whether there is something to do.

        The connection's files may not show it, because a blocking call in a coroutine may have read
        the packets.
        """
        connection = self._connection
        return (
            connection.has_arrived()
            or connection.wait_loop.has_pending_call
            or any(map(connection.session.open_deliveries.wake_reason, self._tasks))
            or bool(connection.session.deliveries and not self._is_closing)
        )

    def _on_news(self) -> None:
        if self._idle is not None:
            self._end_wait()
        else:
            self._listen()
        open_deliveries = self._connection.session.open_deliveries
        for handler, task in list(self._tasks.items()):
            if why := open_deliveries.wake_reason(handler):
                open_deliveries.mark_notified(handler)
                task.cancel(why)

    def _end_wait(self) -> None:
        if self._idle is not None and not self._idle.done():
            self._idle.set_result(None)

    def _on_readable(self, ready: dict[int, bool], file: int) -> None:
        ready[file] = True
        self._end_wait()

    def _listen(self) -> float:
        """Process arrived packets and pending calls; return the seconds of central's silence."""
        connection = self._connection
        self._warn_of_blocking()
        silence = connection.keep_alive(self._silent_since)
        connection.wait_loop.run_pending_calls()
        while not self._is_closing and connection.session.deliveries:
            self._handle_delivery(*connection.session.deliveries.popleft())
        self._selector.turned = time.monotonic()  # plain handlers and callbacks may take long
        return silence

    def _keep_alive(self) -> None:
        """Keep the connection alive. If central is silent too long, end all waits with an error."""
        self._schedule_keep_alive(STEP)
        before, now = self._kept_alive, self._loop.time()
        self._kept_alive = now
        if now - before > STALL:  # this process stood still: central's silence proves nothing
            self._silent_since = now
        if self._listen() > self._connection.wait_loop.patience:
            for request in list(self._waiting):
                self._wake_waiters(request, self._connection.line.lost_error())
        if not self._coroutine_waits.report_standing(now):
            calm = min(_CALM, quiet_within(self._connection.wait_loop.patience))
            self._schedule_keep_alive(max(STEP, calm))

    def _schedule_keep_alive(self, seconds: float) -> None:
        """Schedule ``_keep_alive`` if a coroutine is run."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = self._loop.call_later(seconds, self._keep_alive)

    def _await_news(self, request: Request) -> Generator[Any, None, None]:
        """Await news of a request."""
        future = self._loop.create_future()
        self._waiting.setdefault(request, []).append(future)
        request.wake = partial(self._wake_waiters, request)
        # Flush later, so that the requests of all ready coroutines leave together.
        if self._connection.session.outgoing and not self._is_flushing:
            self._is_flushing = True
            self._loop.call_soon(self._flush)
        with self._coroutine_waits.awaiting(request, future):
            yield from future

    def _flush(self) -> None:
        self._is_flushing = False
        self._connection.flush()

    def _wake_waiters(self, request: Request, error: Exception | None = None) -> None:
        for future in self._waiting.pop(request, []):
            if error is not None and not future.done():
                future.set_exception(error)
            elif not future.done():
                future.set_result(None)


class _Selector(selectors.DefaultSelector):
    """A selector that does not wait while *has_work* is true. It then reports *file* as readable.

    It also ends the sleeps of coroutines, by the handlers' clock, which a test may step.
    """

    def __init__(
        self,
        file: int,
        has_work: Callable[[], bool],
        transport: Transport,
        on_turn: Callable[[], None],
    ) -> None:
        super().__init__()
        self.turned = time.monotonic()  #: when the loop last turned
        self._file = file
        self._has_work = has_work
        self._transport = transport
        self._on_turn = on_turn
        self._sleeping: dict[asyncio.Future[None], float] = {}  #: sleeping future -> its end

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the files that are ready."""
        self._on_turn()
        if self._has_work():
            ready = [*super().select(0), (self.get_key(self._file), selectors.EVENT_READ)]
        else:
            seconds = min(math.inf if timeout is None else timeout, self._until_next())
            with self._transport.pausing() if seconds > 0 else nullcontext():
                ready = super().select(None if seconds == math.inf else seconds)
        for future, moment in sorted(self._sleeping.items(), key=itemgetter(1)):
            if self._transport.seconds_until(moment) <= 0 and not future.done():
                future.set_result(None)
        self.turned = time.monotonic()
        return ready

    async def sleep_until(self, moment: float) -> None:
        """Wait until *moment* of the handlers' clock."""
        future = asyncio.get_running_loop().create_future()
        self._sleeping[future] = moment
        try:
            await future
        finally:
            del self._sleeping[future]

    def _until_next(self) -> float:
        """Return the real seconds to the next end of a sleep.

        They are infinite if a test steps the clock, because the step ends the wait.
        """
        if not self._sleeping:
            return math.inf
        return self._transport.seconds_until(min(self._sleeping.values()))
