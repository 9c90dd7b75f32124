"""The end of a connection: whether all that was sent has arrived, how much may not have, and why."""

from tca_module.errors import NotSent
from tca_module.link.packet_line import SEND_WAIT, STEP
from tca_module.link.waits import Waits
from tca_module.sockets.transport import is_anybody_there
from tca_wire.packets import headers

LINGER = 10.0  # seconds that a program which leaves waits for what it sent to arrive


class Leaving(Waits):
    """The part of a Connection that ends it. Messages have yet to arrive by central, or directly."""

    def close(self, linger: float = LINGER, before: int = 0) -> None:
        """Say goodbye when all that was sent has arrived, or after *linger* seconds. Raises NotSent if something may
        not have; *before*: so much was lost, and logged, earlier.
        """
        with self._lock:
            session = self.session
            try:
                self.direct.shut()
                self._wait_for_arrival(linger, before)
                if self.is_mine and not self.are_owed:  # else central is gone, for which functions would wait
                    self.attend()
                    self._wait_for_arrival(linger, before)
            finally:
                number = self.missing - before
                why = self._why_missing() if number else ""
                self.direct.report(at_once=True)
                if session.post(headers.Bye()):
                    self.line.flush(0.0 if number else SEND_WAIT)
                self.drop()
            if number:
                raise NotSent(number, f"{self.messages(number)} may not have reached {why}")
            session.sends.check(0)

    def take_over(self, within: float) -> bool:
        """Stop its own thread at its next use, for ever, so that another may close it at the end of the process. False
        if that thread waited all the time, or all that was sent has arrived meanwhile.
        """
        self.call_soon(self.session.confirm)
        self.call_soon(self.direct.confirm)
        until = self.now() + within
        while self.now() < until and self.are_owed:
            if self._lock.acquire(timeout=STEP):
                return True
        return False

    def drop(self) -> None:
        """Close without goodbye: deliveries begun and not answered have failed."""
        with self._lock:
            self.direct.close()
            self.transport.close()

    @property
    def missing(self) -> int:
        """The number of messages that may not have arrived."""
        return self.lost + self.session.unheard + self.session.sends.untold + self.direct.unheard

    @property
    def lost(self) -> int:
        """The number of statements that did not arrive, or may not have."""
        return self.session.lost + self.direct.lost

    @property
    def are_owed(self) -> bool:
        """Whether central, or a handler, has yet to say that something has arrived."""
        return bool(self.direct.unheard) or not self.session.is_settled

    def messages(self, number: int) -> str:
        """So many messages of this module, for errors."""
        return f"{number:,} message{'s' * (number != 1)} of '{self.session.module}'"

    def _wait_for_arrival(self, within: float, before: int) -> None:
        """Wait until all has arrived, unless central is gone. *before*: so much was lost earlier."""
        session, since = self.session, self.now()
        is_waited_for = not session.is_settled and (
            session.is_welcome or self.lost > before or session.sends.untold > 0
        )
        if is_waited_for:
            session.confirm()
        self.direct.confirm()
        while (is_waited_for and not session.is_settled) or self.direct.unheard:
            left = since + within - self.now()
            session.tend(self.now(), since)
            self.line.flush(max(0.0, min(SEND_WAIT, left)), is_patient=True)
            if left <= 0 or (session.outgoing and not is_anybody_there(self.transport.address)):
                return
            self.line.listen(min(STEP, left))

    def _why_missing(self) -> str:
        """Where messages may not have arrived, and why."""
        where = f"central at {self.transport.address}"
        if not self.session.is_settled:
            return f"{where}: {self.line.what_to_do()}"
        if self.direct.unheard:
            return "their handler, which does not answer"
        return f"{where}: the connection broke" if self.session.lost else "their handler, which is gone"
