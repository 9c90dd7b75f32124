"""Whether all that was sent has arrived: how much may not have, and why."""

from collections.abc import Callable

from tca_module.direct.messages import DirectMessages
from tca_module.link.packet_line import SEND_WAIT, STEP, PacketLine
from tca_module.session.session import Session
from tca_module.sockets.transport import Transport, is_anybody_there


class Arrivals:
    """The messages of one connection that have yet to arrive, by central or directly."""

    def __init__(
        self, session: Session, direct: DirectMessages, line: PacketLine, transport: Transport,
        clock: Callable[[], float],
    ) -> None:  # fmt: skip
        self._session = session
        self._direct = direct
        self._line = line
        self._clock = clock
        self._address = transport.address

    @property
    def missing(self) -> int:
        """The number of messages that may not have arrived."""
        return self.lost + self._session.unheard + self._session.sends.untold + self._direct.unheard

    @property
    def lost(self) -> int:
        """The number of statements that did not arrive, or may not have."""
        return self._session.lost + self._direct.lost

    @property
    def are_owed(self) -> bool:
        """Whether central, or a handler, has yet to say that something has arrived."""
        return bool(self._direct.unheard) or not self._session.is_settled

    def messages(self, number: int) -> str:
        """So many messages of this module, for errors."""
        return f"{number:,} message{'s' * (number != 1)} of '{self._session.module}'"

    def wait(self, within: float, before: int) -> None:
        """Wait until all has arrived, unless central is gone. *before*: so much was lost earlier."""
        session, since = self._session, self._clock()
        is_waited_for = not session.is_settled and (
            session.is_welcome or self.lost > before or session.sends.untold > 0
        )
        if is_waited_for:
            session.confirm()
        self._direct.confirm()
        while (is_waited_for and not session.is_settled) or self._direct.unheard:
            left = since + within - self._clock()
            session.tend(self._clock(), since)
            self._line.flush(max(0.0, min(SEND_WAIT, left)), is_patient=True)
            if left <= 0 or (session.outgoing and not is_anybody_there(self._address)):
                return
            self._line.listen(min(STEP, left))

    def why_missing(self) -> str:
        """Where messages may not have arrived, and why."""
        where = f"central at {self._address}"
        if not self._session.is_settled:
            return f"{where}: {self._line.what_to_do()}"
        if self._direct.unheard:
            return "their handler, which does not answer"
        return f"{where}: the connection broke" if self._session.lost else "their handler, which is gone"
