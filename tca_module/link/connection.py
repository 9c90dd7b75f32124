"""One connection to central: its requests. Every blocking call of the package ends up here, to wait in its wait_loop.

For one thread only. What central delivers while it waits is handled within the wait: so a handler may ask its own
resource.
"""

import contextlib
import math
import threading
import time
from collections.abc import Awaitable, Callable, Generator, Iterable, Sequence
from typing import Any

from tca_module.checks import BRIEF, TIMEOUT, check, check_message
from tca_module.direct.messages import DirectMessages
from tca_module.errors import CentralLost, MisuseError, NotSent, Refused, Stopped, Timeout
from tca_module.link.arrivals import Arrivals
from tca_module.link.one_process import OfOneProcess
from tca_module.link.packet_line import SEND_WAIT, STEP, PacketLine
from tca_module.link.told_wait import ToldWait
from tca_module.link.turns import Turns
from tca_module.link.wait_loop import WaitLoop
from tca_module.log import log_of
from tca_module.session.epoch_numbers import RESTARTED, EpochNumber, check_epoch, first_foreign, numbers_in
from tca_module.session.registering import registers
from tca_module.session.request import Request, refers_to_tasks
from tca_module.session.sent_tasks import SentId
from tca_module.session.session import Session, quiet_within
from tca_module.sockets.transport import Transport
from tca_wire.messages.declarations import Message
from tca_wire.packets.changes import ChangeState, Observe
from tca_wire.packets.headers import Await, Bye, Register, Release, Send, ToCentral, Unregister
from tca_wire.packets.parts import HandlerFormat
from tca_wire.points import TaskId

PATIENCE = 10.0  # seconds without a word from central after which a wait ends with CentralLost
ACKNOWLEDGED_WITHIN = 30.0  # seconds that central may take to accept or refuse a request while it says other things
LINGER = 10.0  # seconds that a program which leaves waits for what it sent to arrive
_LEAVE_WITHIN = 2.0  # seconds that an ending module gives central
_REST_WITHIN = 1.0  # seconds in which the rest arrives of what central says at one time
_WHY_WITHIN = 0.2  # seconds that central may take to say why an answer is not there
MOST_UNTOLD = 100  # tasks sent of which central has said nothing yet: it remembers 128 by their requests
SEND_WITH_YOUR_OWN = "a handler sends with its task, other threads with a client of their own: connect()"


class Connection(OfOneProcess):
    """One connection to central."""

    def __init__(
        self, transport: Transport, session: Session, *, patience: float = PATIENCE,
        direct: DirectMessages | None = None, clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        super().__init__()
        self.session = session
        self.transport = transport
        self.direct = direct or DirectMessages(session)  #: messages sent without central
        self.root_sender: Any = None  #: the Sender with which callbacks send
        self.await_news: Callable[[Request], Generator[Any, None, None]] | None = None  #: in asyncio
        self.await_moment: Callable[[float], Awaitable[None]] | None = None  #: of the transport's clock; in asyncio
        self.now = clock  #: seconds; it never jumps
        self.line = PacketLine(session, transport, self.direct, clock)
        self._lock = threading.RLock()  # against threads that only keep the connection alive, and send what is late
        turns = Turns(session, self.line, self._lock, clock)
        self.waiting = WaitLoop(session, self.direct, self.line, turns, patience, clock)
        self.arrivals = Arrivals(session, self.direct, self.line, transport, clock)
        self._declared: dict[str, Message[Any, Any]] = {}
        self._owner, self._owner_name = threading.get_ident(), threading.current_thread().name
        self.log = log_of(session.module)

    def open(self, is_stopped: Callable[[], bool] = lambda: False) -> None:
        """Wait until central welcomes this connection. Raises CentralLost, Refused, or Stopped if *is_stopped*."""
        session = self.session
        self.waiting.until(lambda: session.is_welcome or session.refused is not None or is_stopped(), None)
        if session.refused is not None:
            raise Refused(f"module '{session.module}'", session.refused.refusal, session.refused.text)
        if not session.is_welcome:
            where = f"central at {self.transport.address}"
            raise Stopped(f"module '{session.module}' was told to end before {where} had answered")

    def leave(self) -> None:
        """Handle nothing any more. If central does not hear it, it will notice."""
        self.session.withdrawn()
        with contextlib.suppress(CentralLost, Timeout, Refused):
            if self.session.is_welcome:
                self.call(Unregister(0, []), "leaving", within=_LEAVE_WITHIN)

    def close(self, linger: float = LINGER, before: int = 0) -> None:
        """Say goodbye when all that was sent has arrived, or after *linger* seconds. Raises NotSent if something may
        not have; *before*: so much was lost, and logged, earlier.
        """
        with self._lock:
            session = self.session
            try:
                self.direct.shut()
                self.arrivals.wait(linger, before)
                if self.is_mine and not self.arrivals.are_owed:  # else central is gone, for which functions would wait
                    self.attend()
                    self.arrivals.wait(linger, before)
            finally:
                number = self.arrivals.missing - before
                why = self.arrivals.why_missing() if number else ""
                self.direct.report(at_once=True)
                if session.post(Bye()):
                    self.line.flush(0.0 if number else SEND_WAIT)
                self.drop()
            if number:
                raise NotSent(number, f"{self.arrivals.messages(number)} may not have reached {why}")
            session.sends.check(0)

    def take_over(self, within: float) -> bool:
        """Stop its own thread at its next use, for ever, so that another may close it at the end of the process. False
        if that thread waited all the time, or all that was sent has arrived meanwhile.
        """
        self.call_soon(self.session.confirm)
        self.call_soon(self.direct.confirm)
        until = self.now() + within
        while self.now() < until and self.arrivals.are_owed:
            if self._lock.acquire(timeout=STEP):
                return True
        return False

    def drop(self) -> None:
        """Close without goodbye: deliveries begun and not answered have failed."""
        with self._lock:
            self.direct.close()
            self.transport.close()

    # --- requests --------------------------------------------------------------------------------------------------

    def declare(
        self, *messages: Message[Any, Any], handlers: Iterable[HandlerFormat] = (), is_ready: bool = False,
        within: float = ACKNOWLEDGED_WITHIN,
    ) -> None:  # fmt: skip
        """Tell central of messages, which of them are handled here, and that all is attached that is attached at the
        start. Raises FormatRefused if others differ.
        """
        new, handled = [message for message in messages if not self.has_declared(message)], list(handlers)
        if not new and not handled and not is_ready:
            return
        formats, names = [message.format for message in new], ", ".join(one.title for one in new or messages)
        for header in registers(formats, handled, is_ready=is_ready):
            self.call(header, f"declaring {names or 'that it is ready'}", within=within)
        self.session.declared(formats, handled, is_ready=is_ready)
        self._declared.update({message.name: message for message in new})

    def has_declared(self, message: Message[Any, Any]) -> bool:
        """Whether central has been told of this message. Raises MisuseError for what is none."""
        if not isinstance(message, Message):
            check_message(message)
        return self._declared.get(message.name) is message

    def call(self, header: ToCentral, what: object, body: bytes = b"", within: float = ACKNOWLEDGED_WITHIN) -> int:
        """Have central do something; the id of the resulting task or message. *what* names it in errors."""
        self.check_thread()
        with self._lock:
            request = self.request(header, body, is_awaited=True)
            self._wait_for_word(request, what, within)
            return request.accepted or 0

    def _wait_for_word(self, request: Request, what: object, within: float = ACKNOWLEDGED_WITHIN) -> None:
        """Wait until central has accepted a request."""
        if not self.wait(request, within, what):
            self.abandon(request)
            why, fate = self.line.why_late(within), f"{what} {self.session.fate_of(request)}"
            raise Timeout(f"{what} was not acknowledged within {within:g} s, {why}; {fate}")

    # --- tasks -----------------------------------------------------------------------------------------------------

    def send_task(self, header: Send, body: bytes, what: str) -> TaskId:
        """Send a goal, command or monitor. Waits neither for its id nor for central's word, unless central is away: an
        error is raised by whatever uses the id, by the next call of the same sender, or by ``settle``.
        """
        self.check_thread()
        with self._lock:
            session, epoch = self.session, self.session.epoch
            if session.sends.untold >= MOST_UNTOLD:
                self.waiting.until(lambda: session.sends.untold < MOST_UNTOLD, None)
            self._catch_up_for(header, epoch)
            if not session.is_welcome:
                return TaskId(self.call(header, what, body))
            request = session.send_task(header, body, what)
            self.line.flush()
            return TaskId(SentId(self, request))

    def send_change(self, header: ChangeState, body: bytes, what: str) -> Request:
        """Change the state of a task, which *what* says. Waits neither for central nor for its word. A refusal is
        raised by the next call of the same sender, or by ``settle``; that it came too late is logged.
        """
        self.check_thread()
        with self._lock:
            session = self.session
            if session.sends.untold >= MOST_UNTOLD and session.is_welcome:
                self.waiting.until(lambda: session.sends.untold < MOST_UNTOLD, None)
            self._catch_up_for(header)
            request = session.send_change(header, body, what)
            self.line.flush(0.0, is_patient=True)
            return request

    def acknowledged(self, request: Request) -> EpochNumber:
        """The id of a task that was sent, once central has told it. Raises the error that the send came to."""
        if not self.is_mine:
            self._overhear(request)
        try:
            if self.is_mine:
                self._wait_for_word(request, request.what)
        finally:
            self.session.sends.discard(request)
        request.check(request.what)
        assert request.accepted is not None
        return request.accepted

    def _overhear(self, request: Request) -> None:
        """Wait in another thread until central has said what became of a task that was sent."""
        self.call_soon(lambda: self.announce(request))  # if the thread that has sent it waits for something else
        until = self.now() + ACKNOWLEDGED_WITHIN
        while not request.is_over:
            if self._lock.acquire(timeout=STEP):
                try:
                    self.announce(request)
                    self.line.listen(STEP)
                finally:
                    self._lock.release()
            if self.now() > until:
                raise Timeout(f"{request.what} was not acknowledged within {ACKNOWLEDGED_WITHIN:g} s")

    def settle(self, origin: int, *, wait: bool) -> None:
        """Raise the first error of the tasks that were sent for *origin*; with *wait* when central has spoken of all.

        Of what a handler has sent central itself sees to it that no refusal is lost: see Reply.
        """
        session = self.session
        if session.sends.untold:
            with self._lock:
                self.line.catch_up()
                if wait and session.sends.untold:
                    session.confirm()
                    self.line.flush()
                    self.waiting.until(lambda: not session.sends.untold, None)
        session.sends.check(origin)

    def request(
        self, header: ToCentral, body: bytes = b"", *, wants_answer: bool = False, is_awaited: bool = False
    ) -> Request:
        """Ask central. Waits a little if it takes nothing now; not with *is_awaited*: then ``wait`` follows."""
        self.check_thread()
        with self._lock:
            self._catch_up_for(header)
            if not (wants_answer and isinstance(header, Send)):
                request = self.session.request(header, body, wants_answer=wants_answer)
            elif (asked := self.direct.ask(header, body)) is not None:
                self.line.flush(wait_seconds=0)
                return asked
            else:
                request = self.session.ask(header, body)
            self.line.flush(0.0 if is_awaited else SEND_WAIT, is_patient=is_awaited)
            return request

    def _catch_up_for(self, header: ToCentral, epoch: str | None = None) -> None:
        """Take in what central has said. Raises CentralLost if a header is for the central before it, of *epoch*."""
        session = self.session
        epoch = session.epoch if epoch is None else epoch
        self.line.catch_up(is_sending=True)
        numbers = numbers_in(header)
        if not (numbers or session.sends.failed) and epoch == session.epoch:
            return
        try:
            self._check_header(header, numbers, epoch)
        except BaseException:
            self.line.flush(wait_seconds=0)
            raise

    def _check_header(self, header: ToCentral, numbers: list[EpochNumber], epoch: str) -> None:
        session = self.session
        session.sends.check(getattr(header, "origin", None))
        if not numbers:
            if epoch != session.epoch and refers_to_tasks(header):  # its numbers are of the central before
                raise CentralLost(f"what was asked is lost: {RESTARTED}; begin anew")
            return
        for number in numbers:
            if isinstance(number, SentId):
                number.be_nameable(self)
        if first_foreign(numbers, session.epoch) is not None:
            with contextlib.suppress(CentralLost, Timeout):  # this one may have yet to hear of the restart
                self.call(Register(0, []), "a word of central's")
        check_epoch(numbers, session.epoch)

    def wait(
        self, request: Request, timeout: float | None, what: object, is_over: Callable[[], bool] | None = None,
        since: float | None = None, told: ToldWait | None = None,
    ) -> bool:  # fmt: skip
        """Wait until a request is over, or *is_over* says that enough has come; whether it did in time. *since*, *told*
        when this wait began, and as what, if it goes on with one.

        Raises Refused if central refused it, CentralLost if it was lost or central is silent for too long; in a handler
        once TaskKilled if its task was killed, and once Stopped if its module ends.
        """
        self.check_thread()
        is_done = is_over or (lambda: request.is_over)
        with self._lock:
            try:
                if timeout != 0 and request.is_unannounced:
                    self.announce(request)
                is_followed = timeout != 0 and isinstance(request.header, Observe)
                with told or ToldWait(self, [request] * is_followed, timeout is not None and timeout < BRIEF) as wait:
                    is_told = wait.until(is_done)
                    came = is_done() or self.waiting.unless_woken(is_told, timeout, what, request, since=since)
            except CentralLost as error:
                self.abandon(request)
                raise CentralLost(f"{error}; {what} {self.session.fate_of(request)}") from None
            except BaseException:
                self.abandon(request)
                raise
            if request.refused is not None and not request.what:  # perhaps because of what was sent before
                self.session.sends.check(getattr(request.header, "origin", None))
            request.check(what)
            return came

    def mark_told(self) -> None:
        """The waiting handler is about to get an error, and so has been told of a kill."""
        self.session.open_deliveries.mark_told(self.session.open_deliveries.waiting_handler())

    def until_over(
        self, request: Request, what: object, is_over: Callable[[], bool] | None = None
    ) -> Generator[Any, None, None]:
        """``wait`` for async handlers: to be awaited instead of blocking. Raises what ``wait`` does. With *is_over* the
        request goes on if the wait is broken off.
        """
        is_done = is_over or (lambda: request.is_over)
        if self.await_news is None:
            msg = f"{what} is awaited where no async handler runs: wait for it with receive(), result() or wait()"
            raise MisuseError(msg)
        self.announce(request, blocking=False)
        try:
            with ToldWait(self, [request] * isinstance(request.header, Observe), brief=False, blocking=False) as told:
                is_told = told.until(is_done)
                while not is_told():
                    yield from self.await_news(request)
        except BaseException:
            if is_over is None:
                self.abandon(request)
            raise
        request.check(what)

    def announce(self, request: Request, *, blocking: bool = True) -> None:
        """Tell central, if it does not know, that the answer to a question is waited for from now on."""
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

    def declared(self, name: str) -> Message[Any, Any] | None:
        """The message of that name, if it was declared here."""
        return self._declared.get(name)

    def catch_up(self) -> None:
        """Take in what has arrived. Never waits."""
        self.check_thread()
        with self._lock:
            self.line.catch_up()

    def attend(self) -> None:
        """Take in what has arrived, and call what is due because of it. Never waits."""
        self.check_thread()
        with self._lock:
            self.line.catch_up()
            while self.waiting.has_news:
                self.waiting.take_news()

    def hear_out(self, request: Request) -> None:
        """Take in the end of a request, which central has told by now, and call what is due because of it. Wakes no
        handler, and raises nothing if it does not come.
        """
        self.check_thread()
        with self._lock:
            with contextlib.suppress(CentralLost):
                self.waiting.until(lambda: request.is_over, _REST_WITHIN)
            self.attend()

    def flush(self) -> None:
        """Send what is to be said."""
        with self._lock:
            self.line.flush()

    def abandon(self, request: Request) -> None:
        """Give a request up: nobody waits for its answer any more."""
        self.check_thread()
        with self._lock:
            self.session.abandon(request)
            self.line.flush(0.0, is_patient=True)

    def give_up(self, request: Request) -> str:
        """Give up a request that took too long; the reason of the delay ("": unknown)."""
        with self._lock:
            if silence := self.silence:
                self.abandon(request)
                return silence
            if (asked := self.session.give_up(request)) is None:
                return "it went to its handler directly, which had not answered"
            with contextlib.suppress(CentralLost):
                self.waiting.until(lambda: asked.is_over, _WHY_WITHIN)
            self.abandon(asked)
            request.answers += asked.answers  # a multi-query's may be a failure
            return asked.answers[-1][0].text if asked.answers else ""

    def release(self, request: Request, what: str, *, at_once: bool = False) -> bool:
        """Release the lock of a request; whether it was still held. With *at_once*, without waiting. Raises CentralLost
        if central does not answer; it is told as soon as it does.
        """
        header = Release(0, request.header.number, getattr(request.header, "origin", 0))
        if self.is_taken(request) or at_once:
            with self._lock:
                self.session.request(header)
                self.line.flush()
            return not request.taken
        try:
            return bool(self.call(header, f"releasing {what}"))
        except CentralLost:
            if not request.taken:
                raise
            return False

    def is_taken(self, request: Request) -> bool:
        """Whether the lock of a request was taken away, as far as is known here. Never waits."""
        self.check_thread()
        with self._lock:
            self.line.catch_up()
            return bool(request.taken)

    def post(self, header: ToCentral, body: bytes) -> None:
        """Send something that has no answer. If central is not there, it is lost, counted and logged."""
        self.check_thread()
        with self._lock:
            self._catch_up_for(header)
            if self.direct.tell(header, body):
                self.line.flush(wait_seconds=0)
                return
            dropped = self.session.dropped
            self.session.post(header, body)
            self.line.flush()
            if self.session.dropped > dropped == 0:
                self.log.warning("central at %s is not there: informs and broadcasts are lost", self.transport.address)

    def reply(self, header: Any, body: bytes) -> None:
        """A handler ended."""
        with self._lock:
            if self.direct.reply(header, body):
                self.session.open_deliveries.end(header.delivery)
            elif not self.session.reply(header, body, self.line.time()):
                self.line.flush()

    def is_cancelled(self, delivery: int) -> bool:
        """Whether a delivery's handler is to clean up and return; it has been told then."""
        self.check_thread()
        with self._lock:
            self.line.catch_up()
            return self.session.open_deliveries.read_cancelled(delivery)

    def is_suspended(self, delivery: int) -> bool:
        """Whether the task of an open delivery is suspended."""
        self.check_thread()
        with self._lock:
            self.line.catch_up()
            return self.session.open_deliveries.is_suspended(delivery)

    # --- waiting ---------------------------------------------------------------------------------------------------

    def serve(self, is_over: Callable[[], bool], idle: Callable[[float], bool] | None = None) -> None:
        """Handle deliveries until *is_over*, however long central is silent. *idle* is called in between, with
        the seconds that it may take; False: it did nothing.
        """
        self.check_thread()
        with self._lock:
            self.waiting.serve(is_over, idle)

    def tend(self, since: float) -> float:
        """Keep the connection alive while its own thread is busy; the seconds of central's silence."""
        with self._lock:
            self.line.catch_up(since, quiet_within(self.waiting.patience))
            return self.now() - max(self.session.heard, since)

    def keep(self, since: float, quiet: float) -> tuple[float, float] | None:
        """``tend`` for another thread, while nothing is asked here; the seconds of central's silence, and in how many
        there is something to do. None: its own thread uses it.
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

    def listen(self, is_over: Callable[[], bool], timeout: float | None) -> bool:
        """Wait until *is_over*, calling callbacks meanwhile; whether it is. Raises what ``wait`` does."""
        self.check_thread()
        check("the wait for a callback", TIMEOUT, timeout=timeout)
        with self._lock:
            if self.waiting.is_calling_back:
                raise MisuseError("a callback waits for another one: they are called one after the other")
            return is_over() or self.waiting.unless_woken(is_over, timeout, "a callback")

    def pause(self, seconds: float, what: str) -> None:
        """Let so many seconds pass, for *what*. Raises what ``wait`` does."""
        self.check_thread()
        with self._lock:
            self.waiting.unless_woken(lambda: False, seconds, what)

    def wait_until(
        self, is_over: Callable[[], bool], what: object, moment: float | None = None, on: Sequence[Request] = ()
    ) -> bool:
        """Wait until *is_over*, at most until a *moment* of the transport's clock; whether it is. ``call_soon`` has it
        look again, and so has news of what is waited *on*, of which central is told. Raises what ``wait`` does.
        """
        self.check_thread()
        with self._lock:
            self.line.catch_up()
            with ToldWait(self, on, brief=True) as told:
                return self.waiting.in_turn(told.until(is_over), what, math.inf if moment is None else moment)

    def call_soon(self, function: Callable[[], None]) -> None:
        """Have the thread of this connection call a function in its present or next wait; from any thread."""
        self.check_process()
        self.session.news.append(function)
        self.transport.wake()

    def wake(self) -> None:
        """Have the thread of this connection look again at what it waits for; from any thread."""
        self.check_process()
        self.transport.wake()

    def hear_threads(self) -> None:
        """Do what other threads have asked for with ``call_soon``."""
        while self.session.news:
            self.session.news.popleft()()

    def give_back(self) -> None:
        """Give back to central the messages that have not begun, and that only this slot has."""
        with self._lock:
            if self.session.ahead:
                self.session.give_back()
                self.line.flush()

    @property
    def silence(self) -> str:
        """Why central counts as silent, for errors; "" if all is well."""
        return self.line.silence

    @property
    def is_mine(self) -> bool:
        """Whether it belongs to the calling thread."""
        return threading.get_ident() == self._owner

    def check_thread(self, used: object = None, owns: str = "opened it", remedy: str = SEND_WITH_YOUR_OWN) -> None:
        """Raise MisuseError in another thread; before taking the lock, which a serving thread keeps for ever. Names
        what is *used*, why its thread *owns* it, and the remedy.
        """
        if threading.get_ident() != self._owner:
            self.check_process()
            what = used or f"a connection of module '{self.session.module}'"
            where = f"is used in thread '{threading.current_thread().name}'"
            raise MisuseError(f"{what} {where}, but belongs to thread '{self._owner_name}', which {owns}: {remedy}")
