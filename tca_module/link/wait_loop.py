"""The loop of a waiting thread: it sends, receives, handles deliveries and makes due calls."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from tca_module.errors import CentralLost
from tca_module.link.packet_line import SEND_WAIT, STALL, STEP, PacketLine
from tca_module.link.turns import Turns
from tca_module.session.open_deliveries import KILLED, OpenDelivery, never, wake_error, working_on
from tca_module.session.request import Request
from tca_module.session.session import UNBROKEN, quiet_within
from tca_wire.packets.headers import Deliver

_FOR_EVER = float("inf")
# The most of the patience that a pause between two waits of a handler uses up as silence.
_PAUSE_SHARE = 0.25
# Seconds that an answer has to arrive after a message that was handled within the wait. The message
# may have ended after the timeout, and the answer follows its reply.
_ANSWER_WITHIN = 0.2


class WaitLoop:
    """All waits of one connection. The connection's thread calls them and has the lock."""

    def __init__(self, line: PacketLine, lock: threading.RLock, patience: float) -> None:
        self._session = line.session
        self._turns = Turns(line, lock)
        self._lock: Any = lock  # typeshed lacks the methods that release it as a condition does
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
        self._silent_since = line.clock()  #: when central's silence for that handler started
        self._wait_ended = self._silent_since  #: when the last wait of that handler ended
        self._looked_at = self._silent_since  #: when the thread last looked at its line

    def until(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        alarm: float = _FOR_EVER,
        since: float | None = None,
    ) -> bool:
        """Wait until *is_over* is true; return whether it became true in time.

        Raises CentralLost if central is silent for longer than the patience. If this wait continues
        an earlier one, silence counts from *since*. *is_over* is also tested at *alarm*, a time of
        the handlers' clock.
        """
        return self._wait(is_over, timeout, self.patience, alarm=alarm, since=since)

    def serve(self, is_over: Callable[[], bool], idle_wait: Callable[[float], bool] | None) -> None:
        """Handle messages, prefetched ones too, until *is_over*, however long central is silent.

        Between messages, *idle_wait* is called with the seconds that it may wait. *idle_wait*
        returns False if the loop must wait instead.
        """
        self._wait(is_over, None, _FOR_EVER, idle_wait)

    def wait_interruptibly(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        what: object,
        request: Request | None = None,
        alarm: float = _FOR_EVER,
        since: float | None = None,
    ) -> bool:
        """Wait until *is_over*, or raise TaskKilled or Stopped if the handler is woken.

        If *is_over* is true and the handler is woken at the same time, this returns. It raises
        TaskKilled only if the kill of the handler's task also ended *request*.
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
        """Wait until *is_over* or *alarm*, for a handler with many short waits.

        Returns the value of *is_over*. Central's silence counts through all these waits, and raises
        CentralLost once. A pause between two waits counts only in part, because perhaps no thread
        listened to central during the pause.
        """
        session, time, now = self._session, self._line.handler_time, self._clock()
        handler = session.open_deliveries.waiting_handler()
        if handler is not self._handler:
            self._handler, self._silent_since = handler, now
        else:
            pause = now - self._wait_ended
            self._silent_since += max(0.0, pause - _PAUSE_SHARE * self.patience)
        since = self._silent_since = max(self._silent_since, session.heard)
        try:
            self.wait_interruptibly(
                lambda: is_over() or time() >= alarm, None, what, alarm=alarm, since=since
            )
            is_in_time = is_over()
            if not is_in_time:
                # Also checked here, because a wait whose alarm has passed never really waits. A
                # handler may call only such waits in a loop.
                self.check_woken(what)
                if self._clock() >= max(self._silent_since, session.heard) + self.patience:
                    raise self._line.lost_error()
        except CentralLost:
            self._silent_since = self._clock()  # clean-up code gets the full patience again
            raise
        finally:
            self._wait_ended = self._clock()
        return is_in_time

    def check_woken(self, what: object) -> None:
        """Raise TaskKilled or Stopped if the caller must be woken from its wait for *what*."""
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
        """Make one pending call. Calls of the library come first. Callbacks do not nest."""
        if self._session.pending_calls:
            self._session.pending_calls.popleft()()
        elif self.callbacks and not self.is_calling_back:
            self.is_calling_back = True
            try:
                with working_on(None), self.unlocked():
                    self.callbacks.popleft()()
            finally:
                self.is_calling_back = False

    def unlocked(self) -> "Unlocked":
        """Return a block that runs a user's function, while other threads may send."""
        return Unlocked(self._line, self._lock)

    def run_pending_calls(self) -> None:
        """Make all pending calls."""
        while self.has_pending_call:
            self.run_pending_call()

    def seconds_until_due(
        self, due: float, since: float, patience: float, deadline: float = _FOR_EVER
    ) -> float:
        """Return the seconds until a wait must act if nothing arrives.

        It acts when something is *due*, at its *deadline*, or when central has been silent for
        *patience* seconds.
        """
        session, now = self._session, self._clock()
        until = min(deadline, due, max(session.heard, since) + patience)
        if not session.is_welcome:
            until = min(deadline, max(until, now + STEP))
        return max(0.0, until - now)

    def _wait(self, *arguments: Any, **options: Any) -> bool:
        """Do what ``_wait_occupied`` does, and note that the thread keeps the lock for it."""
        line = self._line
        was_occupied, line.is_occupied = line.is_occupied, True
        line.end_burst()
        try:
            return self._wait_occupied(*arguments, **options)
        finally:
            line.is_occupied = was_occupied

    def _wait_occupied(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        patience: float,
        idle_wait: Callable[[float], bool] | None = None,
        alarm: float = _FOR_EVER,
        since: float | None = None,
    ) -> bool:
        session, line, now = self._session, self._line, self._clock()
        deadline = _FOR_EVER if timeout is None else now + timeout
        grace = _ANSWER_WITHIN if timeout else 0.0
        silent_since = now if since is None else since
        quiet = quiet_within(patience, is_idle=patience == _FOR_EVER)
        while not is_over():
            if self.has_pending_call:
                self.run_pending_call()
                continue
            if (session.deliveries or session.prefetched) and self._handle_due(
                is_nested=idle_wait is None
            ):
                deadline, grace = self._after_message(deadline, grace)
                continue
            due = line.send_due(now, silent_since, quiet)
            if session.outgoing and not self._flush_within(
                max(0.0, min(deadline - now, alarm - line.handler_time()))
            ):
                due = now
            is_next = idle_wait is not None and session.can_begin_next
            step = 0.0 if is_next else self.seconds_until_due(due, silent_since, patience, deadline)
            line.listen(0.0 if idle_wait is not None and idle_wait(step) else step, alarm)
            before, now = now, self._clock()
            if now - before > step + STALL:
                silent_since = self._silent_since = now  # this process stood still
            self._end_pause(now - before - step)
            self._looked_at = now
            if idle_wait is not None and self.handle_delivery is not None:
                self._handle_next(self.handle_delivery)  # listens to central in between
            is_silent = now >= max(session.heard, silent_since) + patience
            # A wait that continues earlier ones may be too short to notice the silence, so its
            # silence is tested at the deadline, too.
            if now >= deadline and (since is None or not is_silent):
                return is_over()
            if is_silent:
                raise line.lost_error()
        return True

    def _handle_due(self, *, is_nested: bool) -> bool:
        """Handle a message that must be handled now; return whether there was one.

        A nested wait also handles the next prefetched message, because the awaited answer may
        depend on that message.
        """
        session, handle = self._session, self.handle_delivery
        if handle is None:
            return False
        delivery = session.deliveries.popleft() if session.deliveries else None
        if delivery is None and is_nested and self._check_next() and not session.is_claiming:
            delivery = session.prefetched.popleft()
        if delivery is not None:
            with self.unlocked():
                handle(*delivery)
        return delivery is not None

    def _flush_within(self, left: float) -> bool:
        """Send the outgoing headers; return whether they left in time."""
        within = SEND_WAIT if self._session.is_welcome else STEP
        return self._line.flush(min(within, left), is_patient=left < min(within, STEP))

    def _after_message(self, deadline: float, grace: float) -> tuple[float, float]:
        """Return a wait's deadline and the grace that is left, after a message handled within it.

        A message that ended after the deadline uses up the grace.
        """
        now = self._clock()
        return (deadline, grace) if now < deadline else (now + grace, 0.0)

    def _end_pause(self, seconds: float) -> None:
        """Probe central after a long pause. The packets that arrived in it are read first."""
        if seconds > UNBROKEN:
            self._line.listen_to_all()
            self._session.recheck_prefetched()

    def _check_next(self) -> bool:
        """Process recalls that have arrived; return whether a prefetched message may begin."""
        if self._session.can_begin_next:
            self._line.listen_to_all()
            self._line.flush()  # returned deliveries must not wait for a handler
            # A handler before this wait, or a packet that did not leave, made a pause.
            self._end_pause(self._clock() - self._looked_at)
        return self._session.can_begin_next

    def _handle_next(self, handle: Callable[[Deliver, bytes], None]) -> None:
        """Handle prefetched messages for a millisecond, when nothing else is due."""
        if self._check_next():
            session = self._session
            self._turns.run(lambda: session.may_begin_next and not self.has_pending_call, handle)


class Unlocked:
    """A block in which a connection is not locked, although its thread has the lock around it."""

    __slots__ = ("_line", "_lock", "_state", "_was_occupied")

    def __init__(self, line: PacketLine, lock: Any) -> None:
        self._line, self._lock = line, lock

    def __enter__(self) -> None:
        # The loop of coroutines calls users' functions, too, and may have no lock.
        self._state = self._lock._release_save() if self._lock._is_owned() else None  # noqa: SLF001
        self._was_occupied, self._line.is_occupied = self._line.is_occupied, False

    def __exit__(self, *_: object) -> None:
        if self._state is not None:
            self._lock._acquire_restore(self._state)  # noqa: SLF001
        self._line.is_occupied = self._was_occupied
