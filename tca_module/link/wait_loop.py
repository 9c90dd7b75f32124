"""What a thread does while it waits: it sends and listens, handles what is delivered, and calls
what is due.
"""

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
# part of the patience that may pass between two waits of a handler and count as silence
_BETWEEN = 0.25


class WaitLoop:
    """All waits of one connection. Its thread calls them with the connection locked."""

    def __init__(self, line: PacketLine, lock: threading.RLock, patience: float) -> None:
        self._session = line.session
        self._turns = Turns(line, lock)
        self._direct = line.direct
        self._line = line
        self._clock = line.clock
        self.patience = patience  #: seconds without a word from central after which a wait ends with CentralLost
        #: handles a message that was delivered
        self.handle_delivery: Callable[[Deliver, bytes], None] | None = None
        self.callbacks: deque[Callable[[], None]] = deque()  #: users' functions that are due
        self.is_calling_back = False  #: one of them is being called
        self._one: OpenDelivery | None = None  #: the handler that waited last with ``in_turn``
        #: its silence counts from then; when that wait was over
        self._since = self._left = line.clock()
        #: asked of central: nothing that is ahead begins before its answer
        self._word: Request | None = None

    def until(
        self,
        is_over: Callable[[], bool],
        timeout: float | None,
        alarm: float = _FOR_EVER,
        since: float | None = None,
    ) -> bool:
        """Wait until *is_over*; whether it is in time. Raises CentralLost if central is silent for
        too long, which is counted from *since*, where this goes on with a wait. It looks again at
        the moment *alarm* of the clock on which callbacks are due.
        """
        return self._wait(is_over, timeout, self.patience, alarm=alarm, begun=since)

    def serve(self, is_over: Callable[[], bool], idle: Callable[[float], bool] | None) -> None:
        """Wait until *is_over*, however long central is silent; handle also what is ahead. *idle*
        is called in between, with the seconds that it may take; False: it did nothing.
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
        """Wait until *is_over*, or the handler is to be woken. An answer wins, unless the same kill
        ended both.
        """
        open_deliveries, one = (
            self._session.open_deliveries,
            self._session.open_deliveries.waiting_handler(),
        )
        can_wake = one is not None or open_deliveries.is_ending is not never
        if not can_wake or (request is not None and not request.waits_for_others):
            return self.until(is_over, timeout, alarm, since)
        came = self.until(
            lambda: is_over() or bool(open_deliveries.wake_reason(one)), timeout, alarm, since
        )
        why = open_deliveries.wake_reason(one)
        if why and (
            not is_over() or (why == KILLED and request is not None and request.is_ended_by_kill)
        ):
            self.check_woken(what)
        return came

    def in_turn(self, is_over: Callable[[], bool], what: object, alarm: float) -> bool:
        """Wait in a handler, perhaps one time of many, at most until *alarm*; whether *is_over*.
        Silence counts through all its waits, and raises CentralLost once. Of the time between two
        of them only a part counts: perhaps nobody could listen.
        """
        session, time, now = self._session, self._line.time, self._clock()
        one = session.open_deliveries.waiting_handler()
        if one is not self._one:
            self._one, self._since = one, now
        else:
            self._since += max(0.0, now - self._left - _BETWEEN * self.patience)
        self._since = max(self._since, session.heard)
        try:
            self.unless_woken(
                lambda: is_over() or time() >= alarm, None, what, alarm=alarm, since=self._since
            )
            if not (came := is_over()):  # a loop that is late hears it, too
                self.check_woken(what)
                if self._clock() >= max(self._since, session.heard) + self.patience:
                    raise self._line.lost()
        except CentralLost:
            self._since = self._clock()  # what is done to leave things safe has time again
            raise
        finally:
            self._left = self._clock()
        return came

    def check_woken(self, what: object) -> None:
        """Raise TaskKilled or Stopped if the calling handler is to be woken, from its wait for
        *what*.
        """
        open_deliveries, one = (
            self._session.open_deliveries,
            self._session.open_deliveries.waiting_handler(),
        )
        if why := open_deliveries.wake_reason(one):
            open_deliveries.mark_told(one)
            raise wake_error(one, why, self._session.module, str(what))

    @property
    def has_news(self) -> bool:
        """Whether ``take_news`` has something to do."""
        return bool(self._session.news or (self.callbacks and not self.is_calling_back))

    def take_news(self) -> None:
        """Do one thing that has come up: the library's own first, else one callback (never inside
        another).
        """
        if self._session.news:
            self._session.news.popleft()()
        elif self.callbacks and not self.is_calling_back:
            self.is_calling_back = True
            try:
                with working_on(None):
                    self.callbacks.popleft()()
            finally:
                self.is_calling_back = False

    def seconds_to(self, due: float, since: float, silence: float) -> float:
        """The seconds until something is due, if nothing comes; central has been silent for so
        long.
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
        deadline, since = (
            _FOR_EVER if timeout is None else now + timeout,
            now if begun is None else begun,
        )
        quiet = quiet_within(patience, is_idle=patience == _FOR_EVER)
        while not is_over():
            if self.has_news:
                self.take_news()
                continue
            if (session.deliveries or session.ahead) and self._handles_now(is_nested=idle is None):
                continue
            due = session.tend(now, since, quiet)
            if session.outgoing and not self._has_sent(
                max(0.0, min(deadline - now, alarm - line.time()))
            ):
                due = now
            is_next = idle is not None and self._has_next
            step = 0.0 if is_next else self._seconds_to(due, deadline, since, patience)
            line.listen(0.0 if idle is not None and idle(step) else step, alarm)
            before, now = now, self._clock()
            if now - before > step + STALL:
                # this process stood still, central's words are not read yet: blame nobody
                since = self._since = now
                self._doubt_what_is_ahead()
            if idle is not None and self.handle_delivery is not None:
                self._handle_next(self.handle_delivery)  # and central is heard in between
            is_silent = now >= max(session.heard, since) + patience
            if now >= deadline and (begun is None or not is_silent):
                return is_over()
            if is_silent:
                raise line.lost()
        return True

    def _handles_now(self, *, is_nested: bool) -> bool:
        """Handle a message that is to be handled now; in the wait of a callback also what is next,
        for the answer may depend on it. Whether there was one.
        """
        session, handle = self._session, self.handle_delivery
        if handle is None:
            return False
        delivery = self._direct.next_delivery() if session.deliveries else None
        if delivery is None and is_nested and self._may_begin_next() and not session.is_claiming:
            delivery = session.ahead.popleft()
        if delivery is not None:
            handle(*delivery)
        return delivery is not None

    def _has_sent(self, left: float) -> bool:
        """Send what is to be said; whether it left in time."""
        session = self._session
        within = (
            SEND_WAIT
            if session.is_welcome
            else 0.0
            if self._direct.is_used and session.epoch
            else STEP
        )
        return self._line.flush(min(within, left), is_patient=left < min(within, STEP))

    def _doubt_what_is_ahead(self) -> None:
        """Ask central for a word: what is ahead it may have given to another meanwhile."""
        self._hear_all()
        if self._session.ahead and (self._word is None or self._word.is_over):
            self._word = self._session.ask_for_word()

    def _hear_all(self) -> None:
        while self._line.listen(0.0):
            pass

    @property
    def _has_next(self) -> bool:
        return self._session.has_next and (self._word is None or self._word.is_over)

    def _may_begin_next(self) -> bool:
        """Whether the next message is ahead, and nothing that has arrived recalls it."""
        if self._has_next:
            self._hear_all()
            self._line.flush()  # what is given back does not wait for a handler
        return self._has_next

    def _goes_on(self) -> bool:
        return self._session.has_next and not self.has_news

    def _handle_next(self, handle: Callable[[Deliver, bytes], None]) -> None:
        """Handle, for a moment, what is next when nothing else is: messages that were sent ahead,
        or came directly.
        """
        if self._may_begin_next():
            self._turns.take(self._goes_on, handle)
            return
        until = self._clock() + QUICK
        while (message := self._direct.take()) is not None:
            handle(*message)
            if self.has_news or self._clock() >= until:
                return
