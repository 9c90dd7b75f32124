"""One connection to central: opening it, requests to central, and closing it.

Closing waits until everything that was sent has arrived, or reports how many messages may be
missing and why.
"""

import contextlib
import os
from collections.abc import Callable, Iterable
from typing import Any

from tca_module.checks import check_message
from tca_module.errors import ORDINARY, CentralLost, NotSent, Refused, Stopped, Timeout
from tca_module.link.packet_line import SEND_WAIT, STEP
from tca_module.link.waits import Waits
from tca_module.session import given_up
from tca_module.session.epoch_numbers import (
    RESTARTED,
    EpochNumber,
    check_epoch,
    first_foreign,
    numbers_in,
)
from tca_module.session.registering import register_headers
from tca_module.session.request import Request, refers_to_tasks
from tca_module.session.sent_tasks import SentId
from tca_module.sockets.place import accepts_connections
from tca_wire.endpoint import IS_STARTED_VARIABLE
from tca_wire.messages.message import Message, with_needed
from tca_wire.packets import headers
from tca_wire.packets.changes import ChangeState
from tca_wire.packets.parts import HandlerFormat
from tca_wire.points import TaskId

_LOG_AFTER = 1.0  # seconds of waiting for central after which a module says so
_LOG_AFTER_IF_STARTED = 10.0  # the same for a module whose starter also starts central
# seconds within which central accepts or refuses a request, even while it answers others
ACKNOWLEDGED_WITHIN = 30.0
_LEAVE_WITHIN = 2.0  # seconds that central has to acknowledge a leaving module
LINGER = 10.0  # seconds that closing waits for sent messages to arrive
# most unacknowledged task sends on one connection; central remembers the requests of 128 tasks
MAX_UNACKNOWLEDGED = 100


class Connection(Waits):
    """One connection to central."""

    has_sent_tasks = False
    _has_warned = False  #: the log says that informs and broadcasts are lost
    crash = ""  #: the error that ends the program, for the goodbye; "" for a regular end

    def open(
        self, is_stopped: Callable[[], bool] = lambda: False, *, logs_wait: bool = False
    ) -> None:
        """Wait until central welcomes this connection. With *logs_wait*, log a long wait.

        Raises CentralLost, Refused, or Stopped if *is_stopped*.
        """
        session, what, since = self.session, f"module '{self.session.module}'", self.now()

        def is_over() -> bool:
            return session.is_welcome or session.refused is not None or is_stopped()

        after = _LOG_AFTER_IF_STARTED if IS_STARTED_VARIABLE in os.environ else _LOG_AFTER
        if logs_wait and not self.wait_loop.until(is_over, after, since=since):
            where = self.line.where
            self.log.warning(
                "%s is waiting for central at %s (start it with: tca central)", what, where
            )
        self.wait_loop.until(is_over, None, since=since)
        if session.refused is not None:
            raise Refused(what, session.refused.refusal, session.refused.text)
        if not session.is_welcome:
            where = f"central at {self.line.where}"
            raise Stopped(f"{what} was stopped before {where} had answered")

    def leave(self) -> None:
        """Unregister all handlers.

        An error is ignored, because central also notices the end of the connection.
        """
        self.session.forget_handlers()
        with contextlib.suppress(CentralLost, Timeout, Refused):
            if self.session.is_welcome:
                self.call(headers.Unregister(0, []), "leaving", within=_LEAVE_WITHIN)

    # --- requests ---------------------------------------------------------------------------------

    def declare(
        self,
        *messages: Message[Any, Any],
        handlers: Iterable[HandlerFormat] = (),
        is_ready: bool = False,
        within: float = ACKNOWLEDGED_WITHIN,
    ) -> None:
        """Declare messages and handlers to central.

        With *is_ready*, also inform central that the module has made all attachments of its start.
        Raises FormatRefused if another module declares a message with other types.
        """
        for message in messages:
            check_message(message)
        new = [one for one in with_needed(messages) if not self.has_declared(one)]
        handled = list(handlers)
        if not new and not handled and not is_ready:
            return
        formats = [message.format for message in new]
        names = ", ".join(message.title for message in new or messages)
        for header in register_headers(formats, handled, is_ready=is_ready):
            self.call(header, f"declaring {names or 'that it is ready'}", within=within)
        self.session.add_declared(formats, handled, is_ready=is_ready)
        self._declared.update({message.name: message for message in new})

    def has_declared(self, message: Message[Any, Any]) -> bool:
        """Return whether *message* was declared here. Raises MisuseError if it is no message."""
        if not isinstance(message, Message):
            check_message(message)
        return self._declared.get(message.name) is message

    def call(
        self,
        header: headers.ToCentral,
        what: object,
        body: bytes = b"",
        within: float = ACKNOWLEDGED_WITHIN,
    ) -> int:
        """Make a request to central, and wait until central accepts it.

        Returns the id of the resulting task or message. *what* names the request in errors.
        """
        with self.locked():
            request = self.request(header, body, is_awaited=True)
            self._wait_for_acknowledgement(request, what, within)
            return request.accepted or 0

    def ask_central(
        self,
        header: headers.ToCentral,
        what: object,
        body: bytes = b"",
        within: float | None = ACKNOWLEDGED_WITHIN,
    ) -> Request:
        """Ask central a question that it answers at once; return the request with the answer.

        Raises Timeout if the answer does not arrive *within* that number of seconds.
        """
        request = self.request(header, body, wants_answer=True, is_awaited=True)
        if not self.wait(request, within, what):
            self.abandon(request)
            within = within or 0.0
            raise Timeout(
                f"{what} was not answered within {within:g} s, {self.line.why_late(within)}"
            )
        return request

    def _wait_for_acknowledgement(
        self, request: Request, what: object, within: float = ACKNOWLEDGED_WITHIN
    ) -> None:
        """Wait until central has accepted a request. Raises Timeout otherwise."""
        if not self.wait(request, within, what):
            self.abandon(request)
            why = self.line.why_late(within)
            fate = f"{what} {given_up.fate_of(self.session, request)}"
            raise Timeout(f"{what} was not acknowledged within {within:g} s, {why}; {fate}")

    # --- tasks ------------------------------------------------------------------------------------

    def send_task(self, header: headers.Send, body: bytes, what: str) -> TaskId:
        """Send a goal, command or monitor, and return its id without waiting for central.

        If central refuses the task, the error is raised by the first use of the id, the sender's
        next call, or ``raise_send_errors``. While central is away, this waits for central.
        """
        with self.locked():
            self.has_sent_tasks = True
            session, epoch = self.session, self.session.epoch
            self._wait_for_room()
            self.line.begin_send()
            self._check_numbers(header, epoch)
            body = self.line.stored(header, body)
            if not session.is_welcome:
                return TaskId(self.call(header, what, body))
            request = session.send(header, body, what)
            self.line.end_send(body)
            return TaskId(SentId(self, request))

    def send_change(self, header: ChangeState, body: bytes, what: str) -> Request:
        """Request a change of a task's state, without waiting. *what* describes the change.

        A refusal is raised by the next call of the same sender, or by ``raise_send_errors``. A
        change that came too late is only logged.
        """
        with self.locked():
            if self.session.is_welcome:
                self._wait_for_room()
            self.line.catch_up(is_sending=True)
            self._check_numbers(header)
            request = self.session.send(header, self.line.stored(header, body), what)
            self.line.flush(0.0, is_patient=True)
            return request

    def _wait_for_room(self) -> None:
        """Wait until central has acknowledged enough sends."""
        sends = self.session.sends
        if sends.unacknowledged >= MAX_UNACKNOWLEDGED:
            self.wait_loop.until(lambda: sends.unacknowledged < MAX_UNACKNOWLEDGED, None)

    def wait_for_id(self, request: Request) -> EpochNumber:
        """Wait until central has accepted a sent task, and return its id.

        Raises the error of the send. Works from any thread.
        """
        if not self.is_own_thread:
            self._wait_from_other_thread(request)
        try:
            if self.is_own_thread:
                self._wait_for_acknowledgement(request, request.what)
        finally:
            self.session.sends.discard(request)
        request.check(request.what)
        assert request.accepted is not None
        return request.accepted

    def _wait_from_other_thread(self, request: Request) -> None:
        """Wait, in a thread that does not own the connection, until a sent task is acknowledged.

        The owning thread may be busy, so the calling thread reads packets whenever the lock is
        free.
        """
        # The owning thread may hold the lock during its own wait. It then makes this call.
        self.call_soon(lambda: self.announce(request))
        until = self.now() + ACKNOWLEDGED_WITHIN
        while not request.is_over:
            if self._lock.acquire(timeout=STEP):
                try:
                    self.announce(request)
                    self.line.flush(0.0, is_patient=True)
                    self.line.listen(STEP)
                finally:
                    self._lock.release()
            if self.now() > until:
                raise Timeout(
                    f"{request.what} was not acknowledged within {ACKNOWLEDGED_WITHIN:g} s"
                )

    def raise_send_errors(self, origin: int, *, wait: bool) -> None:
        """Raise the first error of the tasks that were sent for the delivery *origin*.

        With *wait*, first wait until central has accepted or refused every sent task. For a handler
        this is not needed, because its Reply says how many refusals the handler knows, and central
        compares that number.
        """
        session = self.session
        if session.sends.unacknowledged:
            with self._lock:
                self.line.catch_up()
                if wait and session.sends.unacknowledged:
                    session.confirm()
                    self.line.flush()
                    self.wait_loop.until(lambda: not session.sends.unacknowledged, None)
        session.sends.check(origin)

    def request(
        self,
        header: headers.ToCentral,
        body: bytes = b"",
        *,
        wants_answer: bool = False,
        is_awaited: bool = False,
    ) -> Request:
        """Send a numbered request.

        With *is_awaited*, the caller calls ``wait`` next, and ``wait`` sends what does not leave at
        once. Otherwise this waits up to a second until central accepts the packet.
        """
        with self.locked():
            if is_awaited:
                self.line.catch_up(is_sending=True)
            else:
                self.line.begin_send()
            self._check_numbers(header)
            body = self.line.stored(header, body)
            if wants_answer and isinstance(header, headers.Send):
                request = self.session.ask(header, body)
            else:
                request = self.session.request(header, body, wants_answer=wants_answer)
            if is_awaited:
                self.line.flush(0.0, is_patient=True)
            else:
                self.line.end_send(body)
            return request

    def _check_numbers(self, header: headers.ToCentral, epoch: str | None = None) -> None:
        """Check a header that is about to be sent, after arrived packets were processed.

        Raises the error of an earlier send, or CentralLost if the header names tasks of an earlier
        central. *epoch*: that of the central that the header was written for; None: the present.
        """
        session = self.session
        epoch = session.epoch if epoch is None else epoch
        numbers = numbers_in(header)
        if not (numbers or session.sends.failed) and epoch == session.epoch:
            return
        try:
            self._check_header(header, numbers, epoch)
        except BaseException:
            self.line.flush(wait_seconds=0, is_patient=True)
            raise

    def _check_header(
        self, header: headers.ToCentral, numbers: list[EpochNumber], epoch: str
    ) -> None:
        """Raise what ``_check_numbers`` does."""
        session = self.session
        session.sends.check(getattr(header, "origin", None))
        if not numbers:
            # Plain numbers know no epoch. These come from the central before the restart.
            if epoch != session.epoch and refers_to_tasks(header):
                raise CentralLost(f"the request is lost: {RESTARTED}; start again")
            return
        for number in numbers:
            if isinstance(number, SentId):
                number.check_nameable(self)
        if first_foreign(numbers, session.epoch) is not None:
            # This connection may not know of the restart yet. An exchange with central shows it.
            with contextlib.suppress(CentralLost, Timeout):
                self.call(headers.Register(0, []), "an answer from central")
        check_epoch(numbers, session.epoch)

    def declared(self, name: str) -> Message[Any, Any] | None:
        """Return the message of that name, if it was declared here."""
        return self._declared.get(name)

    def release(self, request: Request, what: str, *, at_once: bool = False) -> bool:
        """Release the lock of a request; return whether it was still held.

        With *at_once*, do not wait for central. Raises CentralLost if central does not answer. The
        release is then repeated as soon as central is back.
        """
        header = headers.Release(0, request.header.number, getattr(request.header, "origin", 0))
        if self.is_lock_lost(request) or at_once:
            with self._lock:
                self.session.request(header)
                self.line.flush()
            return not request.why_lock_lost
        try:
            return bool(self.call(header, f"releasing {what}"))
        except CentralLost:
            if not request.why_lock_lost:
                raise
            return False

    def is_lock_lost(self, request: Request) -> bool:
        """Return whether the lock of a request was lost, as far as is known here. Never waits."""
        with self.locked():
            self.line.catch_up()
            return bool(request.why_lock_lost)

    def post(self, header: headers.ToCentral, body: bytes) -> None:
        """Send a message that has no answer.

        If central is not there, the message is lost, counted and logged.
        """
        with self.locked():
            self.line.begin_send()
            self._check_numbers(header)
            if self.session.is_welcome:  # else the message is lost
                body = self.line.stored(header, body)
            self.session.post(header, body)
            self.line.end_send(body)
            if self.session.dropped and not self._has_warned:
                self._has_warned = True
                self.log.warning(
                    "central at %s is not there: informs and broadcasts are lost",
                    self.line.where,
                )

    def reply(self, header: headers.Reply | headers.Fail, body: bytes) -> None:
        """Send the outcome of a handler. Its large data were stored when they were encoded."""
        with self._lock:
            if self.session.is_welcome:
                body = self.line.large.restore(body)
            if not self.session.reply(header, body, self.line.handler_time()):
                self.line.flush()

    def store(self, body: bytes, what: object) -> bytes:
        """Store the large data of a body that is sent later: until then their memory may change.

        Works from any thread. *what* names the message in errors. Raises BadData or Refused.
        """
        return self.line.large.store(body, what, is_away=not self.session.is_welcome)

    def opened(self, body: bytes) -> bytes:
        """Return a body that came inside of another one; a large one with its memory."""
        return self.line.large.opened(body)

    def postpone(self, header: headers.Postpone) -> None:
        """Report that a handler has returned, and replies later."""
        with self._lock:
            self.session.postpone(header)
            self.line.flush()

    def is_cancelled(self, delivery: int) -> bool:
        """Return whether a delivery's handler should clean up and return.

        If so, the handler counts as notified, and no wait raises TaskKilled or Stopped for the same
        reason.
        """
        with self.locked():
            self.line.catch_up()
            return self.session.open_deliveries.read_cancelled(delivery)

    def is_suspended(self, delivery: int) -> bool:
        """Return whether the task of an open delivery is suspended."""
        with self.locked():
            self.line.catch_up()
            return self.session.open_deliveries.is_suspended(delivery)

    def call_back(self, function: Callable[[], object], name: object) -> None:
        """Call a user's function; log its errors, and those of the tasks that it has sent."""
        try:
            function()
            self.raise_send_errors(0, wait=True)
        except ORDINARY:
            self.log.exception("%s failed", name)

    def run_requested_calls(self) -> None:
        """Run the functions that other threads have passed to ``call_soon``."""
        while self.session.pending_calls:
            self.session.pending_calls.popleft()()

    def return_prefetched(self) -> None:
        """Return the prefetched messages that have not begun to central."""
        with self._lock:
            if self.session.prefetched:
                self.session.return_prefetched()
                self.line.flush()

    # --- closing ----------------------------------------------------------------------------------

    def close(self, linger: float = LINGER, lost_before: int = 0) -> None:
        """Say goodbye when all that was sent has arrived, or after *linger* seconds.

        Raises NotSent if messages may be missing. *lost_before*: the number of lost messages that
        were logged already.
        """
        with self._lock:
            session = self.session
            try:
                self._wait_for_arrival(linger, lost_before)
                # If something is still unconfirmed, central is away, and callbacks would wait.
                if self.is_own_thread and session.is_confirmed:
                    self.process_pending()
                    self._wait_for_arrival(linger, lost_before)
            finally:
                number = self.missing - lost_before
                why = self._why_missing() if number else ""
                if session.post(headers.Bye(self.crash)):
                    self.line.flush(0.0 if number else SEND_WAIT)
                self.drop()
            if number:
                raise NotSent(number, f"{self.count_messages(number)} may not have reached {why}")
            session.sends.check(0)

    def acquire_for_closing(self, within: float) -> bool:
        """Lock the connection of another thread for good, so that the caller can close it at exit.

        Returns False without the lock, if the owning thread held it all the time or if everything
        that was sent has arrived.
        """
        self.call_soon(self.session.confirm)
        until = self.now() + within
        while self.now() < until and not self.session.is_confirmed:
            if self._lock.acquire(timeout=STEP):
                return True
        return False

    def drop(self) -> None:
        """Close without a goodbye: central counts unanswered deliveries as failed."""
        with self._lock:
            self.session.outgoing.clear()
            self.transport.close()
            self.line.large.close()

    @property
    def missing(self) -> int:
        """The number of messages that may not have arrived."""
        session = self.session
        return session.lost + session.unconfirmed + session.sends.unacknowledged

    def count_messages(self, number: int) -> str:
        """Return "*number* messages of this module", for errors."""
        return f"{number:,} message{'s' * (number != 1)} of '{self.session.module}'"

    def _wait_for_arrival(self, within: float, lost_before: int) -> None:
        """Wait until everything has arrived, at most *within* seconds.

        While central is away, this waits only if there are new losses or unacknowledged sends.
        """
        session, since = self.session, self.now()
        may_wait = (
            session.is_welcome or session.lost > lost_before or session.sends.unacknowledged > 0
        )
        if session.is_confirmed or not may_wait:
            return
        session.confirm()
        while not session.is_confirmed:
            left = since + within - self.now()
            self.line.send_due(self.now(), since)
            self.line.flush(max(0.0, min(SEND_WAIT, left)), is_patient=True)
            if left <= 0 or (session.outgoing and self._is_gone):
                return
            self.line.listen(min(STEP, left))

    @property
    def _is_gone(self) -> bool:
        """Whether no central listens. One that may move may soon listen elsewhere."""
        return not (self.transport.has_others or accepts_connections(self.transport.address))

    def _why_missing(self) -> str:
        """Return where messages may be missing, and why."""
        where = f"central at {self.line.where}"
        if not self.session.is_confirmed:
            return f"{where}: {self.line.advice()}"
        return f"{where}: the connection broke"
