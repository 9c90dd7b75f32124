"""A session on a transport: the waits. Used by one thread only; every blocking call of the package ends up here.

While a thread waits here and central delivers a message to it, the message is handled within the wait (``attend``):
a handler may ask its own resource something without waiting for itself for ever.
"""

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import Any

from tca_module.arguments import check_message, check_timeout, name_of
from tca_module.direct import Direct
from tca_module.errors import CentralLost, MisuseError, Refused, Stopped, Timeout
from tca_module.request import Request, check_over, fate, refers_to_tasks
from tca_module.session import Session
from tca_module.transport import Transport
from tca_wire.codec import packets, unpack_to_module
from tca_wire.declarations import Message
from tca_wire.errors import ProtocolError
from tca_wire.headers import Bye, Deliver, GiveUp, Register, ToCentral, Unregister
from tca_wire.parts import HandlerFormat

PATIENCE = 10.0
"""Seconds without a word from central after which a wait ends with CentralLost."""

ACKNOWLEDGED_WITHIN = 30.0
"""Seconds that central may take to accept or refuse a request while it does say other things."""

STEP = 0.2
"""Seconds at a time that a wait listens, so that stops are noticed."""

STALL = 2.0
"""Seconds that a turn of a wait never takes unless the process itself was stopped."""

_SEND_WAIT = 1.0  # seconds that a send waits for central to take the packet
_LEAVE_WITHIN = 2.0  # seconds that an ending module gives central
_FOR_EVER = float("inf")


class Connection:
    """One connection to central."""

    def __init__(
        self, transport: Transport, session: Session, *, patience: float = PATIENCE, direct: Direct | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.session = session
        self.transport = transport
        self.direct = direct or Direct(session)  #: what goes without central
        self.attend: Callable[[Deliver, bytes], None] | None = None  #: handles a message that was delivered
        self.outside: Any = None  #: the Sender with which callbacks send
        #: Users' functions that are due; called one after the other.
        self.callbacks: deque[Callable[[], None]] = deque()
        self.hear: Callable[[Request], Generator[Any, None, None]] | None = None  #: awaits news of a request in asyncio
        self.patience = patience
        self._clock = clock
        self._is_calling_back = False
        self._declared: dict[str, Message[Any, Any]] = {}
        self._owner = threading.get_ident()
        self._lock = threading.RLock()  # against the thread that only keeps the connection alive
        self._log = logging.getLogger(f"tca.{session.module}")

    @property
    def address(self) -> str:
        """Central's address."""
        return self.transport.address

    def open(self, is_stopped: Callable[[], bool] = lambda: False) -> None:
        """Wait until central welcomes this connection.

        Raises CentralLost if nobody answers, Refused if central won't have it, Stopped if *is_stopped* before.
        """
        session = self.session
        self._wait(lambda: session.is_welcome or session.refused is not None or is_stopped(), None)
        if session.refused is not None:
            raise Refused(f"module '{session.module}'", session.refused.refusal, session.refused.text)
        if not session.is_welcome:
            raise Stopped(f"module '{session.module}' was told to end before central at {self.address} had answered")

    def leave(self) -> None:
        """Handle nothing any more; if central does not hear it, it will notice."""
        self.session.withdrawn()
        with contextlib.suppress(CentralLost, Timeout, Refused):
            if self.session.is_welcome:
                self.call(Unregister(0, []), "leaving", within=_LEAVE_WITHIN)

    def close(self) -> None:
        """Say goodbye."""
        with self._lock:
            self.direct.shut()
            if self.session.post(Bye()):
                self._flush()
            self.drop()

    def drop(self) -> None:
        """Close without goodbye: what was begun and not answered has failed."""
        with self._lock:
            self.direct.close()
            self.transport.close()

    # --- requests --------------------------------------------------------------------------------------------------

    def declare(self, *messages: Message[Any, Any], handlers: Iterable[HandlerFormat] = ()) -> None:
        """Tell central of messages, and which of them are handled here. Raises FormatRefused if others differ."""
        new, handled = [message for message in messages if self._is_new(message)], list(handlers)
        if not new and not handled:
            return
        formats = [message.format for message in new]
        self.call(Register(0, formats, handled), f"declaring {', '.join(map(name_of, new or messages))}")
        self.session.declared(formats, handled)
        self._declared.update({message.name: message for message in new})

    def _is_new(self, message: Message[Any, Any]) -> bool:
        check_message(message)
        return self._declared.get(message.name) is not message

    def call(self, header: ToCentral, what: str, body: bytes = b"", within: float = ACKNOWLEDGED_WITHIN) -> int:
        """Have central do something; the id of the task or message that came of it. *what* names it in errors."""
        self._check_thread()
        with self._lock:
            request = self.request(header, body)
            if not self.wait(request, within, what):
                self.abandon(request)
                msg = f"{what} was not acknowledged within {within:g} s, though central at {self.address} \
is alive: it is overloaded; {what} {fate(request, self.session)}"
                raise Timeout(msg)
            return request.accepted or 0

    def request(self, header: ToCentral, body: bytes = b"", *, wants_answer: bool = False) -> Request:
        """Ask central for something, without waiting."""
        self._check_thread()
        with self._lock:
            epoch = self.session.epoch
            self._catch_up()
            if self.session.epoch != epoch and refers_to_tasks(header):
                msg = "central was restarted meanwhile and has forgotten its tasks: begin anew"
                raise CentralLost(msg)
            if wants_answer and (asked := self.direct.ask(header, body)) is not None:
                return asked
            request = self.session.request(header, body, wants_answer=wants_answer)
            self._flush()
            return request

    def wait(
        self, request: Request, timeout: float | None, what: str, is_over: Callable[[], bool] | None = None
    ) -> bool:
        """Wait until a request is over, or *is_over* says that enough has come of it; whether it is.

        Raises Refused if central refused it, CentralLost if it was lost or central is silent for too long, and Stopped,
        once for each handler, if the module ends.
        """
        self._check_thread()
        session, is_done = self.session, is_over or (lambda: request.is_over)
        with self._lock:
            try:
                check_timeout(timeout)
                came = self._wait(lambda: is_done() or session.is_interrupted(request), timeout)
            except CentralLost as error:
                self.abandon(request)
                raise CentralLost(f"{error}; {what} {fate(request, self.session)}") from None
            except BaseException:
                self.abandon(request)
                raise
            if came and not is_done():
                session.tell(getattr(request.header, "origin", 0))
                session.abandon(request)
                raise Stopped(f"module '{session.module}' ends: {what} is not waited for any more")
            check_over(request, what)
            return came

    def until_over(self, request: Request, what: str) -> Generator[Any, None, None]:
        """The form of ``wait`` that does not block: to be awaited in an async handler. Raises what ``wait`` does."""
        if self.hear is None:
            msg = f"{what} is awaited where no async handler runs: wait for it with receive(), result() or wait()"
            raise MisuseError(msg)
        try:
            while not request.is_over:
                yield from self.hear(request)
        except BaseException:
            self.abandon(request)
            raise
        check_over(request, what)

    def abandon(self, request: Request) -> None:
        """Nobody waits for that answer any more."""
        self._check_thread()
        with self._lock:
            self.session.abandon(request)
            self._flush()

    def release(self, request: Request, what: str, *, at_once: bool = False) -> bool:
        """Want no longer the lock that a request has got; whether it was had until now. *at_once*: central is told, and
        not waited for. Else raises CentralLost if it does not answer; it is told as soon as it does.
        """
        if self.is_taken(request) or at_once:
            self.session.request(GiveUp(request.header.number))
            self._flush()
            return not request.taken
        try:
            return bool(self.call(GiveUp(request.header.number), f"releasing {what}"))
        except CentralLost:
            if not request.taken:
                raise
            return False

    def is_taken(self, request: Request) -> bool:
        """Whether the lock that a request has got was taken away, as far as is known here. Never waits."""
        self._check_thread()
        with self._lock:
            self._catch_up()
            return bool(request.taken)

    def post(self, header: ToCentral, body: bytes) -> None:
        """Say something that has no answer. It is lost, counted and logged if central is not there."""
        self._check_thread()
        with self._lock:
            self._catch_up()
            if self.direct.tell(header, body):
                return
            dropped = self.session.dropped
            self.session.post(header, body)
            self._flush()
            if self.session.dropped > dropped == 0:
                self._log.warning("central at %s is not there: informs and broadcasts are lost", self.address)

    def reply(self, header: Any, body: bytes) -> None:
        """A handler ended."""
        with self._lock:
            if not self.direct.reply(header, body):
                self.session.reply(header, body)
                self._flush()

    def is_cancelled(self, delivery: int) -> bool:
        """Whether a delivery's handler is to clean up and return; it knows then."""
        self._check_thread()
        with self._lock:
            self._catch_up()
            if is_cancelled := self.session.is_cancelled(delivery):
                self.session.tell(delivery)
            return is_cancelled

    def is_suspended(self, delivery: int) -> bool:
        """Whether the task of a delivery that is being handled is suspended."""
        self._check_thread()
        with self._lock:
            self._catch_up()
            return self.session.is_suspended(delivery)

    # --- waiting ---------------------------------------------------------------------------------------------------

    def serve(self, is_over: Callable[[], bool], idle: Callable[[float], bool] | None = None) -> None:
        """Handle what is delivered until *is_over*, however long central is silent.

        *idle* is called in between: it may do one thing, or wait for anything, for at most so many seconds; False if it
        did neither.
        """
        self._check_thread()
        with self._lock:
            self._wait(is_over, None, patience=_FOR_EVER, idle=idle)

    def tend(self, since: float, within: float = STEP) -> float:
        """Keep the connection alive while its own thread does something else; for how long central has been silent.

        *within*: seconds that a central which does not know us, or all of us, yet is waited for.
        """
        with self._lock:
            self._catch_up()
            self.session.tend(self._clock(), since)
            self._flush(wait_seconds=0)
            until = self._clock() + within
            while not self.session.is_known and self._listen(max(0.0, until - self._clock())):
                self._flush(wait_seconds=0)
            return self._clock() - max(self.session.heard, since)

    def now(self) -> float:
        """Seconds on a clock that never jumps."""
        return self._clock()

    def listen(self, is_over: Callable[[], bool], timeout: float | None) -> bool:
        """Wait, and call what is to be called meanwhile; whether *is_over*. Raises CentralLost."""
        self._check_thread()
        check_timeout(timeout)
        with self._lock:
            if self._is_calling_back:
                msg = "a callback waits for another one: they are called one after the other"
                raise MisuseError(msg)
            return self._wait(is_over, timeout)

    def soon(self, function: Callable[[], None]) -> None:
        """Have the thread that owns this connection call a function, in its present or next wait; from any thread."""
        self.session.news.append(function)
        self.transport.wake()

    @property
    def has_news(self) -> bool:
        """Whether ``take_news`` has something to do."""
        return bool(self.session.news or (self.callbacks and not self._is_calling_back))

    def take_news(self) -> None:
        """Do one thing that has come up: of the library, else call one callback (never within another one)."""
        if self.session.news:
            self.session.news.popleft()()
        elif self.callbacks and not self._is_calling_back:
            self._is_calling_back = True
            try:
                self.callbacks.popleft()()
            finally:
                self._is_calling_back = False

    def _wait(
        self, is_over: Callable[[], bool], timeout: float | None, *, patience: float | None = None,
        idle: Callable[[float], bool] | None = None,
    ) -> bool:  # fmt: skip
        session, since = self.session, self._clock()
        deadline = _FOR_EVER if timeout is None else since + timeout
        patience = self.patience if patience is None else patience
        now = since
        while not is_over():
            if self.has_news:
                self.take_news()
                continue
            if self.attend is not None and (delivery := self.direct.next_delivery()) is not None:
                self.attend(*delivery)
                continue
            session.tend(now, since)
            self._flush(_SEND_WAIT if session.is_welcome else 0.0 if self.direct.is_used and session.epoch else STEP)
            step = self.direct.patience(min(STEP, max(0.0, deadline - now)))
            self._listen(0.0 if idle is not None and idle(step) else step)
            if idle is not None and self.attend is not None and (message := self.direct.take()) is not None:
                self.attend(*message)  # one at a time, and central is heard in between
            before, now = now, self._clock()
            if now - before > STALL:
                since = now  # this process stood still, and central's words have yet to be read: blame nobody
            if now >= deadline:
                return is_over()
            if now - max(session.heard, since) > patience:
                raise self.lost()
        return True

    def lost(self) -> CentralLost:
        """The error that says that central does not answer."""
        msg = f"central at {self.address} does not answer: start it with 'tca central', or set $TCA_CENTRAL to where \
it listens"
        return CentralLost(msg)

    def _catch_up(self) -> None:
        """Take in what has arrived already; a caller that never waits learns that it was cut off, and comes back."""
        while self._listen(0.0):
            pass
        now = self._clock()
        self.session.tend(now, self.session.heard if self.session.is_welcome else now)
        if self.session.outgoing:
            self._flush(wait_seconds=0)

    def _listen(self, timeout: float) -> bool:
        packet = self.transport.receive(timeout)
        if packet is not None:
            self._take_in(packet)
        else:
            self.direct.report()  # now that all is read that central said: it may have ended
        self.direct.listen()
        return packet is not None

    def _take_in(self, packet: bytes) -> None:
        now = self._clock()
        try:
            for header, body in unpack_to_module(packet):
                self.session.receive(header, body, now)
        except ProtocolError as error:
            self._log.warning("central at %s sent what is no message: %s", self.address, error)
        for complaint in self.session.complaints:
            self._log.warning("%s", complaint)
        self.session.complaints.clear()

    def _flush(self, wait_seconds: float = _SEND_WAIT) -> None:
        """Send what the session has to say. What has left has left, also if the rest of it can't."""
        if self.session.outgoing:
            outgoing, self.session.outgoing = self.session.outgoing, []
            for before, packet in packets(outgoing):
                if not self.transport.send(packet, wait_seconds):
                    self.session.outgoing = outgoing[before:]
                    self.direct.unsent(self.session.outgoing)
                    self.session.break_off()
                    return

    def _check_thread(self) -> None:
        """Before the lock is taken: a thread that serves keeps it for ever."""
        if threading.get_ident() != self._owner:
            msg = f"a connection of module '{self.session.module}' is used from thread \
'{threading.current_thread().name}', but belongs to the one that \
opened it: a handler sends with its task, other threads open a connection of their own with connect()"
            raise MisuseError(msg)
