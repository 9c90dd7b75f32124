"""The waits of one connection: for answers, for news, for callbacks, for time. What its thread does
meanwhile stands in wait_loop.

What central delivers while it waits is handled within the wait: so a handler may ask its own
resource.
"""

import contextlib
import math
import time
from collections.abc import Awaitable, Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Self

from tca_module.checks import BRIEF, TIMEOUT, check
from tca_module.direct.messages import DirectMessages
from tca_module.errors import CentralLost, MisuseError
from tca_module.link.one_thread import OfOneThread
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

PATIENCE = 10.0  # seconds without a word from central after which a wait ends with CentralLost
_REST_WITHIN = 1.0  # seconds in which the rest arrives of what central says at one time
_WHY_WITHIN = 0.2  # seconds that central may take to say why an answer is not there


@dataclass(slots=True)
class ToldWait:
    """A wait of which central is told as long as it lasts: for news of an observation, or for the
    first of several answers; used in a ``with`` block. Without requests none is told.

    Of all other waits central knows by the requests themselves. Nothing is sent if there is nothing
    to wait for: a wait is told when it has looked in vain at all that has come. It says how much
    that was, so that central, which may have sent more, never takes a handler for waiting that is
    about to go on. News ends the wait for central, too.
    """

    connection: "Waits"
    requests: Sequence[Request]
    brief: bool
    """It may end by itself, or soon does: no deadlock."""
    blocking: bool = True
    told: tuple[list[int], int] | None = None
    """The requests, and the number of answers to observations among them, as central was told."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """It is over. Central knows, if an answer ended it; requests that are no observations are
        given up.
        """
        if (
            self.told is not None
            and self.told == self._now
            and isinstance(self.requests[0].header, Observe)
        ):
            self._post(-1)
            self.connection.line.flush(0.0, is_patient=True)

    def until(self, is_over: Callable[[], bool]) -> Callable[[], bool]:
        """*is_over*, with central told whenever it is not."""
        return (lambda: is_over() or self._tell()) if self.requests else is_over

    def _tell(self) -> bool:
        """There is nothing new: have central told, unless it knows, or something is called first.
        Always False.
        """
        if not (self.blocking and self.connection.waiting.has_news):
            now = self._now
            if now is not None and now != self.told:
                self.told = now
                self._post(now[1])
        return False

    def _post(self, seen: int) -> None:
        number, *others = [one.header.number for one in self.requests]
        origin = self.requests[0].header.origin
        self.connection.session.post(Await(number, self.blocking, origin, others, self.brief, seen))

    @property
    def _now(self) -> tuple[list[int], int] | None:
        """What to tell; None if an answer is under way: the last one, or the first, of how things
        stand.
        """
        observed = [one for one in self.requests if isinstance(one.header, Observe)]
        is_asked = all(
            one.was_sent and not one.is_over and one.path is None for one in self.requests
        )
        if not (
            self.connection.session.is_welcome and is_asked and all(one.seen for one in observed)
        ):
            return None
        return [one.header.number for one in self.requests], sum(one.seen for one in observed)


class Waits(OfOneThread):
    """The part of a Connection that waits. In a handler each wait raises TaskKilled, once, if its
    task was killed, and Stopped, once, if its module ends. All raise CentralLost if central is
    silent for too long.
    """

    def __init__(
        self,
        transport: Transport,
        session: Session,
        *,
        patience: float = PATIENCE,
        direct: DirectMessages | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self.session = session
        self.transport = transport
        self.direct = direct or DirectMessages(session)  #: messages sent without central
        #: in asyncio
        self.await_news: Callable[[Request], Generator[Any, None, None]] | None = None
        #: of the transport's clock; in asyncio
        self.await_moment: Callable[[float], Awaitable[None]] | None = None
        self.now = clock  #: seconds; it never jumps
        self.line = PacketLine(session, transport, self.direct, clock)
        self.waiting = WaitLoop(self.line, self._lock, patience)
        self.root_sender: object = None  #: the Sender with which callbacks send
        self.log = log_of(session.module)
        self._declared: dict[str, Message[Any, Any]] = {}  # of which central has been told, by name

    # --- for answers ------------------------------------------------------------------------------

    def wait(
        self,
        request: Request,
        timeout: float | None,
        what: object,
        is_over: Callable[[], bool] | None = None,
        since: float | None = None,
        told: ToldWait | None = None,
    ) -> bool:
        """Wait until a request is over, or *is_over* says that enough has come; whether it did in
        time. *since*, *told* when this wait began, and as what, if it goes on with one.

        Raises Refused if central refused it, CentralLost if it was lost or central is silent for
        too long; in a handler once TaskKilled if its task was killed, and once Stopped if its
        module ends.
        """
        self.check_thread()
        is_done = is_over or (lambda: request.is_over)
        with self._lock:
            try:
                if timeout != 0 and request.is_unannounced:
                    self.announce(request)
                is_followed = timeout != 0 and isinstance(request.header, Observe)
                with told or ToldWait(
                    self, [request] * is_followed, timeout is not None and timeout < BRIEF
                ) as wait:
                    is_told = wait.until(is_done)
                    came = is_done() or self.waiting.unless_woken(
                        is_told, timeout, what, request, since=since
                    )
            except CentralLost as error:
                self.abandon(request)
                raise CentralLost(
                    f"{error}; {what} {given_up.fate_of(self.session, request)}"
                ) from None
            except BaseException:
                self.abandon(request)
                raise
            if (
                request.refused is not None and not request.what
            ):  # perhaps because of what was sent before
                self.session.sends.check(getattr(request.header, "origin", None))
            request.check(what)
            return came

    def until_over(
        self, request: Request, what: object, is_over: Callable[[], bool] | None = None
    ) -> Generator[Any, None, None]:
        """``wait`` for async handlers: to be awaited instead of blocking. Raises what ``wait``
        does. With *is_over* the request goes on if the wait is broken off.
        """
        is_done = is_over or (lambda: request.is_over)
        if self.await_news is None:
            msg = f"{what} is awaited where no async handler runs: wait for it with receive(), result() or wait()"
            raise MisuseError(msg)
        self.announce(request, blocking=False)
        try:
            with ToldWait(
                self, [request] * isinstance(request.header, Observe), brief=False, blocking=False
            ) as told:
                is_told = told.until(is_done)
                while not is_told():
                    yield from self.await_news(request)
        except BaseException:
            if is_over is None:
                self.abandon(request)
            raise
        request.check(what)

    def announce(self, request: Request, *, blocking: bool = True) -> None:
        """Tell central, if it does not know, that the answer to a question is waited for from now
        on.
        """
        with self._lock:
            if not request.is_unannounced:
                return
            self.line.catch_up(is_sending=not blocking)
            if request.is_unannounced:
                request.is_announced = self.session.post(
                    Await(request.header.number, blocking, getattr(request.header, "origin", 0))
                )
                if blocking:  # else its event loop sends what has come together
                    self.line.flush()

    def abandon(self, request: Request) -> None:
        """Give a request up: nobody waits for its answer any more."""
        with self.mine():
            given_up.abandon(self.session, request)
            self.line.flush(0.0, is_patient=True)

    def give_up(self, request: Request) -> str:
        """Give up a request that took too long; the reason of the delay ("": unknown)."""
        with self._lock:
            if silence := self.silence:
                self.abandon(request)
                return silence
            if (asked := given_up.ask_why(self.session, request)) is None:
                return "it went to its handler directly, which had not answered"
            with contextlib.suppress(CentralLost):
                self.waiting.until(lambda: asked.is_over, _WHY_WITHIN)
            self.abandon(asked)
            request.answers += asked.answers  # a multi-query's may be a failure
            return asked.answers[-1][0].text if asked.answers else ""

    def mark_told(self) -> None:
        """The waiting handler is about to get an error, and so has been told of a kill."""
        self.session.open_deliveries.mark_told(self.session.open_deliveries.waiting_handler())

    # --- for anything else ------------------------------------------------------------------------

    def serve(
        self, is_over: Callable[[], bool], idle: Callable[[float], bool] | None = None
    ) -> None:
        """Handle deliveries until *is_over*, however long central is silent. *idle* is called in
        between, with the seconds that it may take; False: it did nothing.
        """
        with self.mine():
            self.waiting.serve(is_over, idle)

    def listen(self, is_over: Callable[[], bool], timeout: float | None) -> bool:
        """Wait until *is_over*, calling callbacks meanwhile; whether it is. Raises what ``wait``
        does.
        """
        self.check_thread()
        check("the wait for a callback", TIMEOUT, timeout=timeout)
        with self._lock:
            if self.waiting.is_calling_back:
                raise MisuseError(
                    "a callback waits for another one: they are called one after the other"
                )
            return is_over() or self.waiting.unless_woken(is_over, timeout, "a callback")

    def pause(self, seconds: float, what: str) -> None:
        """Let so many seconds pass, for *what*. Raises what ``wait`` does."""
        with self.mine():
            self.waiting.unless_woken(lambda: False, seconds, what)

    def wait_until(
        self,
        is_over: Callable[[], bool],
        what: object,
        moment: float | None = None,
        on: Sequence[Request] = (),
    ) -> bool:
        """Wait until *is_over*, at most until a *moment* of the transport's clock; whether it is.
        ``call_soon`` has it look again, and so has news of what is waited *on*, of which central is
        told. Raises what ``wait`` does.
        """
        with self.mine():
            self.line.catch_up()
            with ToldWait(self, on, brief=True) as told:
                return self.waiting.in_turn(
                    told.until(is_over), what, math.inf if moment is None else moment
                )

    def hear_out(self, request: Request) -> None:
        """Take in the end of a request, which central has told by now, and call what is due because
        of it. Wakes no handler, and raises nothing if it does not come.
        """
        with self.mine():
            with contextlib.suppress(CentralLost):
                self.waiting.until(lambda: request.is_over, _REST_WITHIN)
            self.attend()

    @property
    def silence(self) -> str:
        """Why central counts as silent, for errors; "" if all is well."""
        return self.line.silence

    # --- without waiting --------------------------------------------------------------------------

    def catch_up(self) -> None:
        """Take in what has arrived. Never waits."""
        with self.mine():
            self.line.catch_up()

    def attend(self) -> None:
        """Take in what has arrived, and call what is due because of it. Never waits."""
        with self.mine():
            self.line.catch_up()
            while self.waiting.has_news:
                self.waiting.take_news()

    def flush(self) -> None:
        """Send what is to be said."""
        with self._lock:
            self.line.flush()

    def tend(self, since: float) -> float:
        """Keep the connection alive while its own thread is busy; the seconds of central's
        silence.
        """
        with self._lock:
            self.line.catch_up(since, quiet_within(self.waiting.patience))
            return self.now() - max(self.session.heard, since)

    def keep(self, since: float, quiet: float) -> tuple[float, float] | None:
        """``tend`` for another thread, while nothing is asked here; the seconds of central's
        silence, and in how many there is something to do. None: its own thread uses it.
        """
        if not self._lock.acquire(blocking=False):
            return None
        try:
            self.transport.has_arrived()  # from now on its files tell of news
            due = self.line.catch_up(since, quiet)
            silence = self.now() - max(self.session.heard, since)
            return silence, self.waiting.seconds_to(due, since, silence)
        finally:
            self._lock.release()

    def call_soon(self, function: Callable[[], None]) -> None:
        """Have the thread of this connection call a function in its present or next wait; from any
        thread.
        """
        self.check_process()
        self.session.news.append(function)
        self.transport.wake()

    def wake(self) -> None:
        """Have the thread of this connection look again at what it waits for; from any thread."""
        self.check_process()
        self.transport.wake()
