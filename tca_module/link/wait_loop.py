"""The loop of a waiting thread: it sends, receives, handles deliveries and makes due calls."""

import threading
from collections import deque
from collections.abc import Callable

from tca_module.errors import CentralLost
from tca_module.link.packet_line import SEND_WAIT, STALL, STEP, PacketLine
from tca_module.link.turns import QUICK, Turns
from tca_module.session.open_deliveries import KILLED, OpenDelivery, never, wake_error, working_on
from tca_module.session.request import Request
from tca_module.session.session import quiet_within
from tca_wire.packets.headers import Deliver

_FOR_EVER = float("inf")
# the part of the patience that may pass between two waits of a handler and still count as silence
_BETWEEN = 0.25


class WaitLoop:
    """All waits of one connection. Its thread calls them with the connection locked."""

    def __init__(self, line: PacketLine, lock: threading.RLock, patience: float) -> None:
        self._session = line.session
        self._turns = Turns(line, lock)
        self._direct = line.direct
        self._line = line
        self._clock = line.clock
        #: seconds of central's silence after which a wait raises CentralLost
        self.patience = patience
        #: handles a delivered message
        self.handle_delivery: Callable[[Deliver, bytes], None] | None = None
        self.callbacks: deque[Callable[[], None]] = deque()  #: users' functions that are due
        self.is_calling_back = False  #: a callback is running
        #: the handler whose repeated wait (``wait_repeatedly``) came last
        self._handler: OpenDelivery | None = None
        #: when central's silence for that handler started; when its last wait ended
        self._since = self._left_at = line.clock()
        #: a probe of central: no prefetched message begins before its answer
        self._probe: Request | None = None

    def until(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        alarm: float = _FOR_EVER,
        since: float | None = None,
    ) -> bool:
        """Wait until *is_over*; return whether it is, in time.

        Raises CentralLost if central is silent for longer than the patience. Silence counts from
        *since* if this continues an earlier wait. The wait checks again at *alarm*, a time of the
        handlers' clock.
        """
        return self._wait(is_over, timeout, self.patience, alarm=alarm, begun=since)

    def serve(self, is_over: Callable[[], bool], idle: Callable[[float], bool] | None) -> None:
        """Wait until *is_over*, however long central is silent; also handle prefetched messages.

        Between messages, *idle* is called with the seconds that it may wait. It returns False if it
        did not wait.
        """
        self._wait(is_over, None, _FOR_EVER, idle)

    def unless_woken(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        what: object,
        request: Request | None = None,
        alarm: float = _FOR_EVER,
        since: float | None = None,
    ) -> bool:
        """Wait until *is_over*, or raise TaskKilled or Stopped if the handler is woken.

        If both happen at once, the result is returned, unless the same kill produced it.
        """
        open_deliveries = self._session.open_deliveries
        handler = open_deliveries.waiting_handler()
        can_wake = handler is not None or open_deliveries.is_ending is not never
        if not can_wake or (request is not None and not request.waits_for_others):
            return self.until(is_over, timeout, alarm, since)
        is_in_time = self.until(
            lambda: is_over() or bool(open_deliveries.wake_reason(handler)), timeout, alarm, since
        )
        why = open_deliveries.wake_reason(handler)
        if why and (
            not is_over() or (why == KILLED and request is not None and request.is_ended_by_kill)
        ):
            self.check_woken(what)
        return is_in_time

    def wait_repeatedly(self, is_over: Callable[[], bool], what: object, alarm: float) -> bool:
        """Wait in a handler that waits repeatedly, until *is_over* or *alarm*; return whether it is
        over.

        Central's silence counts through all waits of the handler, and raises CentralLost once. The
        time between two waits counts only in part, because perhaps no thread listened.
        """
        session, time, now = self._session, self._line.time, self._clock()
        handler = session.open_deliveries.waiting_handler()
        if handler is not self._handler:
            self._handler, self._since = handler, now
        else:
            self._since += max(0.0, now - self._left_at - _BETWEEN * self.patience)
        self._since = max(self._since, session.heard)
        try:
            self.unless_woken(
                lambda: is_over() or time() >= alarm, None, what, alarm=alarm, since=self._since
            )
            is_in_time = is_over()
            if not is_in_time:
                # Here, too, for a loop that comes late every time and so never really waits.
                self.check_woken(what)
                if self._clock() >= max(self._since, session.heard) + self.patience:
                    raise self._line.lost_error()
        except CentralLost:
            self._since = self._clock()  # clean-up code gets the full patience again
            raise
        finally:
            self._left_at = self._clock()
        return is_in_time

    def check_woken(self, what: object) -> None:
        """Raise TaskKilled or Stopped if the calling handler must be woken from its wait for
        *what*.
        """
        open_deliveries = self._session.open_deliveries
        handler = open_deliveries.waiting_handler()
        if why := open_deliveries.wake_reason(handler):
            open_deliveries.mark_notified(handler)
            raise wake_error(handler, why, self._session.module, str(what))

    @property
    def has_pending_call(self) -> bool:
        """Whether ``run_pending_call`` has something to do."""
        return bool(self._session.pending_calls or (self.callbacks and not self.is_calling_back))

    def run_pending_call(self) -> None:
        """Make one pending call: the library's own first, else a callback (not inside another)."""
        if self._session.pending_calls:
            self._session.pending_calls.popleft()()
        elif self.callbacks and not self.is_calling_back:
            self.is_calling_back = True
            try:
                with working_on(None):
                    self.callbacks.popleft()()
            finally:
                self.is_calling_back = False

    def seconds_to(self, due: float, since: float, silence: float) -> float:
        """Return the seconds until something is due if nothing arrives. *silence*: central's, so
        far.
        """
        patience = self.patience if silence < self.patience else _FOR_EVER
        return self._seconds_to(due, _FOR_EVER, since, patience)

    def _seconds_to(self, due: float, deadline: float, since: float, patience: float) -> float:
        session, now = self._session, self._clock()
        until = min(deadline, due, max(session.heard, since) + patience)
        if not session.is_welcome:
            until = min(deadline, max(until, now + STEP))
        return self._direct.patience(max(0.0, until - now))

    def _wait(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        patience: float,
        idle: Callable[[float], bool] | None = None,
        alarm: float = _FOR_EVER,
        begun: float | None = None,
    ) -> bool:
        session, line, now = self._session, self._line, self._clock()
        deadline = _FOR_EVER if timeout is None else now + timeout
        since = now if begun is None else begun
        quiet = quiet_within(patience, is_idle=patience == _FOR_EVER)
        while not is_over():
            if self.has_pending_call:
                self.run_pending_call()
                continue
            if (session.deliveries or session.prefetched) and self._handle_due(
                is_nested=idle is None
            ):
                continue
            due = session.send_due(now, since, quiet)
            if session.outgoing and not self._flush_within(
                max(0.0, min(deadline - now, alarm - line.time()))
            ):
                due = now
            is_next = idle is not None and self._has_next
            step = 0.0 if is_next else self._seconds_to(due, deadline, since, patience)
            line.listen(0.0 if idle is not None and idle(step) else step, alarm)
            before, now = now, self._clock()
            if now - before > step + STALL:
                # This process stood still: central may have sent packets that are not read yet.
                since = self._since = now
                self._recheck_prefetched()
            if idle is not None and self.handle_delivery is not None:
                self._handle_next(self.handle_delivery)  # listens to central in between
            is_silent = now >= max(session.heard, since) + patience
            if now >= deadline and (begun is None or not is_silent):
                return is_over()
            if is_silent:
                raise line.lost_error()
        return True

    def _handle_due(self, *, is_nested: bool) -> bool:
        """Handle a message that must be handled now; return whether there was one.

        The wait of a callback also handles the next prefetched message: the answer may depend on
        it.
        """
        session, handle = self._session, self.handle_delivery
        if handle is None:
            return False
        delivery = self._direct.next_delivery() if session.deliveries else None
        if delivery is None and is_nested and self._may_begin_next() and not session.is_claiming:
            delivery = session.prefetched.popleft()
        if delivery is not None:
            handle(*delivery)
        return delivery is not None

    def _flush_within(self, left: float) -> bool:
        """Send the outgoing headers; return whether they left in time."""
        session = self._session
        if session.is_welcome:
            within = SEND_WAIT
        elif self._direct.is_used and session.epoch:
            within = 0.0  # direct messages still arrive while central is away
        else:
            within = STEP
        return self._line.flush(min(within, left), is_patient=left < min(within, STEP))

    def _recheck_prefetched(self) -> None:
        """Probe central after this process stood still.

        Central may have given the prefetched messages to another slot in the meantime.
        """
        self._receive_all()
        if self._session.prefetched and (self._probe is None or self._probe.is_over):
            self._probe = self._session.probe()

    def _receive_all(self) -> None:
        while self._line.listen(0.0):
            pass

    @property
    def _has_next(self) -> bool:
        return self._session.has_next and (self._probe is None or self._probe.is_over)

    def _may_begin_next(self) -> bool:
        """Return whether a prefetched message may begin: no arrived packet recalls it."""
        if self._has_next:
            self._receive_all()
            self._line.flush()  # returned deliveries must not wait for a handler
        return self._has_next

    def _may_continue(self) -> bool:
        return self._session.has_next and not self.has_pending_call

    def _handle_next(self, handle: Callable[[Deliver, bytes], None]) -> None:
        """Handle, for a moment, the messages that come when nothing else is due: prefetched and
        direct ones.
        """
        if self._may_begin_next():
            self._turns.run(self._may_continue, handle)
            return
        until = self._clock() + QUICK
        while (message := self._direct.next_message()) is not None:
            handle(*message)
            if self.has_pending_call or self._clock() >= until:
                return
