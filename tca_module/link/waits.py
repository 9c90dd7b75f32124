"""The waits of one connection: for answers, changes, callbacks, and time.

The loop of a wait is in ``wait_loop``. The loop also handles the messages that central delivers
during the wait, so a handler may query its own resource.
"""

import contextlib
import math
import time
from collections.abc import Awaitable, Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Self

from tca_module.checks import BRIEF, TIMEOUT, check
from tca_module.errors import CLOCK_STANDS, CentralLost, MisuseError
from tca_module.link.one_thread import ThreadBound
from tca_module.link.packet_line import PacketLine
from tca_module.link.wait_loop import WaitLoop
from tca_module.log import log_of
from tca_module.session import given_up
from tca_module.session.request import Request
from tca_module.session.session import Session, quiet_within
from tca_module.sockets.transport import Transport
from tca_wire.messages.declarations import Message
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import Await

PATIENCE = 10.0  # seconds of central's silence after which a wait raises CentralLost
_REST_WITHIN = 1.0  # seconds between the first and the last packet of central about one event
_WHY_WITHIN = 0.2  # seconds that central has to say why an answer is missing


@dataclass(slots=True)
class AnnouncedWait:
    """A wait for changes, or for the first of several answers, as a ``with`` block.

    The block announces the wait to central. (Central knows other waits by their requests.) Without
    *requests*, the block sends nothing.

    A wait is announced only if it must continue after all arrived packets have been read. The
    announcement says how many answers have arrived. If central has sent more answers, it does not
    count the handler as waiting, because the handler is about to continue. When central sends an
    answer, it counts the wait as ended.
    """

    connection: "Waits"
    requests: Sequence[Request]
    brief: bool
    """The wait has a short timeout, so it is no deadlock."""
    blocking: bool = True
    announced: tuple[list[int], int] | None = None
    """The announced request numbers, and the number of changes that had arrived by then."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the wait, and inform central of the end if that is needed.

        Central knows of the end if it has sent an answer. It also knows if the requests are given
        up. Observations are not given up when a wait for them ends.
        """
        if (
            self.announced is not None
            and self.announced == self._announcement
            and isinstance(self.requests[0].header, Observe)
        ):
            self._post(-1)
            self.connection.line.flush(0.0, is_patient=True)

    def announcing(self, is_over: Callable[[], bool]) -> Callable[[], bool]:
        """Return a function like *is_over*. If *is_over* is false, it also announces the wait."""
        return (lambda: is_over() or self._announce()) if self.requests else is_over

    def _announce(self) -> bool:
        """Announce the wait, unless it is announced or a call is pending. Always returns False."""
        if not (self.blocking and self.connection.wait_loop.has_pending_call):
            new = self._announcement
            if new is not None and new != self.announced:
                self.announced = new
                self._post(new[1])
        return False

    def _post(self, seen: int) -> None:
        number, *others = [one.header.number for one in self.requests]
        origin = self.requests[0].header.origin
        self.connection.session.post(Await(number, self.blocking, origin, others, self.brief, seen))

    @property
    def _announcement(self) -> tuple[list[int], int] | None:
        """The announcement to make; None while a deciding answer is on its way.

        A deciding answer is the last one of a request, or the first one of an observation.
        """
        requests = self.requests
        are_open = all(one.was_sent and not one.is_over for one in requests)
        changes = [one.answers_seen for one in requests if isinstance(one.header, Observe)]
        if not (self.connection.session.is_welcome and are_open and all(changes)):
            return None
        return [one.header.number for one in requests], sum(changes)


class Waits(ThreadBound):
    """The part of a Connection that waits.

    In a handler, the next wait raises TaskKilled if the task was killed, and Stopped if the module
    ends; each of the two errors once. All waits raise CentralLost if central is silent for longer
    than the patience.
    """

    def __init__(
        self,
        transport: Transport,
        session: Session,
        *,
        patience: float = PATIENCE,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self.session = session
        self.transport = transport
        #: awaits an answer to a request; set by the event loop of ``async def`` handlers
        self.await_news: Callable[[Request], Generator[Any, None, None]] | None = None
        #: sleeps until a time of the handlers' clock; also set by the event loop
        self.await_moment: Callable[[float], Awaitable[None]] | None = None
        self.now = clock  #: a monotonic clock, in seconds
        self.line = PacketLine(session, transport, clock, self._lock)
        self.wait_loop = WaitLoop(self.line, self._lock, patience)
        self.root_sender: object = None  #: the Sender with which callbacks send
        self.log = log_of(session.module)
        # name -> a message that this program has declared to central
        self._declared: dict[str, Message[Any, Any]] = {}

    # --- for answers ------------------------------------------------------------------------------

    def wait(
        self,
        request: Request,
        timeout: float | None,
        what: object,
        is_over: Callable[[], bool] | None = None,
        since: float | None = None,
        announced_wait: AnnouncedWait | None = None,
    ) -> bool:
        """Wait until a request is over, or *is_over* is true; return whether that came in time.

        If this wait continues an earlier one, central's silence counts from *since*, and
        *announced_wait* is the announcement of the earlier wait.

        Raises Refused if central refused the request, and CentralLost if it was lost or central is
        silent for longer than the patience. In a handler, raises TaskKilled once if its task was
        killed, and Stopped once if its module ends.
        """
        self.check_thread()
        is_done = is_over or (lambda: request.is_over)
        with self._lock:
            is_in_time = announced_wait is None and is_done()
            try:
                if not is_in_time:
                    is_in_time = self._wait_for_news(
                        request, timeout, what, is_done, since, announced_wait
                    )
            except CentralLost as error:
                self.abandon(request)
                raise CentralLost(
                    f"{error}; {what} {given_up.fate_of(self.session, request)}"
                ) from None
            except BaseException:
                self.abandon(request)
                raise
            # If an earlier send was refused, that may be the cause: raise the error of the send.
            if request.refused is not None and not request.what:
                self.session.sends.check(getattr(request.header, "origin", None))
            request.check(what)
            return is_in_time

    def _wait_for_news(
        self,
        request: Request,
        timeout: float | None,
        what: object,
        is_done: Callable[[], bool],
        since: float | None,
        announced_wait: AnnouncedWait | None,
    ) -> bool:
        """Announce a wait, and wait: see ``wait``."""
        if timeout != 0 and request.is_unannounced:
            self.announce(request)
        is_observation = timeout != 0 and isinstance(request.header, Observe)
        with announced_wait or AnnouncedWait(
            self, [request] * is_observation, timeout is not None and timeout < BRIEF
        ) as wait:
            condition = wait.announcing(is_done)
            return is_done() or self.wait_loop.wait_interruptibly(
                condition, timeout, what, request, since=since
            )

    def wait_in_coroutine(
        self, request: Request, what: object, is_over: Callable[[], bool] | None = None
    ) -> Generator[Any, None, None]:
        """Wait until a request is over, or *is_over* is true, in the coroutine that awaits this.

        Raises what ``wait`` does. Cancelling the wait gives up the request, except with *is_over*.
        """
        is_done = is_over or (lambda: request.is_over)
        if self.await_news is None:
            raise MisuseError(
                f"{what} is awaited outside of an async handler:"
                " wait for it with receive(), result() or wait()"
            )
        self.announce(request, blocking=False)
        try:
            with AnnouncedWait(
                self, [request] * isinstance(request.header, Observe), brief=False, blocking=False
            ) as wait:
                condition = wait.announcing(is_done)
                while not condition():
                    yield from self.await_news(request)
        except BaseException:
            if is_over is None:
                self.abandon(request)
            raise
        request.check(what)

    def announce(self, request: Request, *, blocking: bool = True) -> None:
        """Inform central that the sender of a question now waits for its answer.

        This sends nothing if central knows that already.
        """
        with self._lock:
            if not request.is_unannounced:
                return
            self.line.catch_up(is_sending=True)
            if request.is_unannounced:
                request.is_announced = self.session.post(
                    Await(request.header.number, blocking, getattr(request.header, "origin", 0))
                )
            # For coroutines, the event loop sends all their announcements together.
            if blocking:
                self.line.flush(0.0, is_patient=True)

    def abandon(self, request: Request) -> None:
        """Give up a request: its answer is no longer wanted."""
        with self.locked():
            given_up.abandon(self.session, request)
            self.line.flush(0.0, is_patient=True)

    def abandon_late(self, request: Request) -> str:
        """Give up a request that took too long; return the reason of the delay ("" if unknown)."""
        with self._lock:
            if why := self.why_silent:
                self.abandon(request)
                return why
            asked = given_up.abandon_asking_why(self.session, request)
            with contextlib.suppress(CentralLost):
                self.wait_loop.until(lambda: asked.is_over, _WHY_WITHIN)
            self.abandon(asked)
            request.answers += asked.answers  # for a multi-query, this may be a failure
            text = asked.answers[-1][0].text if asked.answers else ""
            is_stepped = getattr(self.transport, "is_stepped", False)
            return "; ".join(filter(None, (text, CLOCK_STANDS * is_stepped)))

    def mark_notified(self) -> None:
        """Record that the waiting handler knows of a kill: it is about to get an error anyway."""
        self.session.open_deliveries.mark_notified(self.session.open_deliveries.waiting_handler())

    # --- for anything else ------------------------------------------------------------------------

    def serve(
        self, is_over: Callable[[], bool], idle_wait: Callable[[float], bool] | None = None
    ) -> None:
        """Handle deliveries until *is_over*; see ``WaitLoop.serve``."""
        with self.locked():
            self.wait_loop.serve(is_over, idle_wait)

    def listen(self, is_over: Callable[[], bool], timeout: float | None) -> bool:
        """Wait until *is_over* is true, and call callbacks in the meantime; return its value.

        Raises what ``wait`` does.
        """
        self.check_thread()
        check("the wait for a callback", TIMEOUT, timeout=timeout)
        with self._lock:
            if self.wait_loop.is_calling_back:
                raise MisuseError(
                    "a callback waits for another callback, but only one callback runs at a time"
                )
            return is_over() or self.wait_loop.wait_interruptibly(is_over, timeout, "a callback")

    def pause(self, seconds: float, what: str) -> None:
        """Wait for *seconds*, on behalf of *what*. Raises what ``wait`` does."""
        with self.locked():
            self.wait_loop.wait_interruptibly(lambda: False, seconds, what)

    def wait_until(
        self,
        is_over: Callable[[], bool],
        what: object,
        moment: float | None = None,
        on: Sequence[Request] = (),
    ) -> bool:
        """Wait until *is_over* is true, at most until *moment*; return the value of *is_over*.

        *moment* is a time of the handlers' clock. The condition is tested again after each
        ``call_soon``, and at each answer to the requests in *on*. Central is informed of the wait
        for those answers. Raises what ``wait`` does.
        """
        with self.locked():
            self.line.catch_up()
            with AnnouncedWait(self, on, brief=True) as wait:
                return self.wait_loop.wait_repeatedly(
                    wait.announcing(is_over), what, math.inf if moment is None else moment
                )

    def wait_for_end(self, request: Request) -> None:
        """Wait for the last answer to a request, and make the due calls.

        Central has sent that answer already. This wakes no handler, and raises nothing if the
        answer does not arrive.
        """
        with self.locked():
            with contextlib.suppress(CentralLost):
                self.wait_loop.until(lambda: request.is_over, _REST_WITHIN)
            self.process_pending()

    @property
    def why_silent(self) -> str:
        """Why central counts as silent, for errors; "" if all is well."""
        return self.line.why_silent

    # --- without waiting --------------------------------------------------------------------------

    def has_arrived(self) -> bool:
        """Return whether a packet has arrived, or ``wake`` was called since the last call."""
        with self._lock:
            return self.transport.has_arrived()

    def catch_up(self) -> None:
        """Process arrived packets. Never waits."""
        with self.locked():
            self.line.catch_up()

    def process_pending(self) -> None:
        """Process arrived packets, and make the calls that they cause. Never waits."""
        with self.locked():
            self.line.catch_up()
            self.wait_loop.run_pending_calls()

    def flush(self) -> None:
        """Send the outgoing headers."""
        with self._lock:
            self.line.flush()

    def keep_alive(self, since: float) -> float:
        """Keep the connection of an event loop alive; return the seconds of central's silence."""
        with self._lock:
            self.line.catch_up(since, quiet_within(self.wait_loop.patience))
            return self.now() - max(self.session.heard, since)

    def keep_alive_if_idle(self, since: float, quiet: float) -> tuple[float, float] | None:
        """Keep the connection alive from another thread, unless the connection's thread uses it.

        Returns the seconds of central's silence, and the seconds until something is due. Returns
        None if the connection's thread uses it.
        """
        if not self._lock.acquire(blocking=False):
            return None
        try:
            self.transport.has_arrived()  # resets the files, so that they signal new packets
            due = self.line.catch_up(since, quiet)
            silence = self.now() - max(self.session.heard, since)
            patience = self.wait_loop.patience
            patience = patience if silence < patience else math.inf  # nothing is due at a past end
            return silence, self.wait_loop.seconds_until_due(due, since, patience)
        finally:
            self._lock.release()

    def call_soon(self, function: Callable[[], None]) -> None:
        """Call a function in the connection's thread, in its present or next wait.

        May be called from any thread.
        """
        self.check_process()
        self.session.pending_calls.append(function)
        self.transport.wake()

    def wake(self) -> None:
        """Make the connection's thread test again the condition that it waits for.

        May be called from any thread.
        """
        self.check_process()
        self.transport.wake()
