"""Packets to and from one central, and direct ones. Never waits longer than it is told to."""

import math
from collections.abc import Callable

from tca_module.direct.messages import DirectMessages
from tca_module.errors import CentralLost
from tca_module.log import log_of
from tca_module.session.session import QUIET, Session
from tca_module.sockets.curve import why_not_let_in
from tca_module.sockets.transport import Transport, context, is_anybody_there, is_turned_away
from tca_wire.errors import ProtocolError
from tca_wire.packets.codec import packets, unpack_to_module
from tca_wire.packets.credit import Receipts

SEND_WAIT = 1.0  # seconds that a send waits for central to take the packet
STEP = 0.2  # seconds at a time that a wait listens while central is not there
_AT_ONCE = 0.2  # seconds in which a central that lives answers what it can answer at once
STALL = 2.0  # seconds by which a turn of a wait is never late unless the process itself was stopped


class PacketLine:
    """Sends and receives the packets of one connection."""

    def __init__(
        self,
        session: Session,
        transport: Transport,
        direct: DirectMessages,
        clock: Callable[[], float],
    ) -> None:
        self.session = session
        self._transport = transport
        #: the time of handlers, in seconds; on a stepped clock it stands still
        self.time = transport.time
        self.direct = direct
        self.clock = clock
        self._log = log_of(session.module)
        self._receipts = Receipts()
        self._silence = (
            0.0,
            -math.inf,
        )  #: the seconds of central's last silence though it was asked, and their end

    @property
    def silence(self) -> str:
        """Why central counts as silent, for errors: it says, or takes, nothing. "" if all is
        well.
        """
        session, now = self.session, self.clock()
        silent = now - session.heard
        is_owed = silent >= QUIET and now - session.asked_since >= _AT_ONCE
        if session.is_welcome and not session.outgoing and not is_owed:
            return ""
        where = f"central at {self._transport.address}"
        return f"{where} has said nothing for {silent:.1f} s; see with 'tca status' whether it runs"

    def why_late(self, within: float) -> str:
        """Why central has not given an answer of its own within the last seconds."""
        seconds, until = self._silence
        if self.clock() - until < within:
            return f"central was not heard for {seconds:.1f} s of it: the network, or central, stood still"
        return self.silence or "though central is alive: it is overloaded"

    def lost(self) -> CentralLost:
        """The CentralLost for a central that does not answer."""
        return CentralLost(
            f"central at {self._transport.address} does not answer: {self.what_to_do()}"
        )

    def what_to_do(self) -> str:
        """Advice for when central does not answer. Takes a moment."""
        if is_turned_away(self._transport.address):
            return (
                "it takes no more connections: end some programs, or start it with a higher limit of file descriptors \
(ulimit -Hn)"
            )
        if is_anybody_there(self._transport.address):
            if lacking := why_not_let_in(context(), self._transport.address):
                return lacking
            return (
                "it is there, but its process stands still (SIGSTOP, a paused container: let it go on) or is busy for \
very long; or no central listens there, but another program"
            )
        return "start it with 'tca central', or set $TCA_CENTRAL to where it listens"

    def catch_up(
        self, since: float = float("-inf"), quiet: float = QUIET, *, is_sending: bool = False
    ) -> float:
        """Take in arrived packets, and keep the line alive; when there is more to do. So a caller
        that never waits notices a cut, and comes back. After *quiet* seconds of silence, at most
        since then, central is asked for a word. A caller that *is_sending* flushes right after
        that, with what it has to say itself.
        """
        while self.listen(0.0):
            pass
        due = self.session.tend(self.clock(), since, quiet)
        if not is_sending:
            self.flush(wait_seconds=0)
        return due

    def listen(self, timeout: float, alarm: float = math.inf) -> bool:
        """Take in what arrives next; False if nothing does in time, or before the moment
        *alarm*.
        """
        packet = self._transport.receive(timeout, alarm)
        if packet is not None:
            self._take_in(packet)
        else:
            self.direct.report()  # now that all is read that central said: it may have ended
        self.direct.listen()
        return packet is not None

    def _take_in(self, packet: bytes) -> None:
        if (receipt := self._receipts.due(packet)) and self._transport.send(receipt, 0.0):
            self._receipts.sent()
        now, session = self.clock(), self.session
        was_asked = session.asked_since > session.heard and now - session.asked_since >= _AT_ONCE
        if was_asked and now - session.heard >= QUIET:
            self._silence = now - session.heard, now
        try:
            for header, body in unpack_to_module(packet):
                self.session.receive(header, body, now)
        except ProtocolError as error:
            self._log.warning(
                "central at %s sent what is no message: %s", self._transport.address, error
            )
        while self.session.complaints:
            self._log.warning("%s", self.session.complaints.pop(0))

    def flush(self, wait_seconds: float = SEND_WAIT, *, is_patient: bool = False) -> bool:
        """Send what the session says; whether it left. If not that breaks the connection, unless
        the caller *is_patient*.
        """
        if self.session.outgoing:
            outgoing = self.session.take_outgoing(self.time)
            for before, packet in packets(outgoing):
                if not self._transport.send(packet, wait_seconds):
                    self.session.outgoing = outgoing[before:]
                    if not is_patient:
                        self.direct.unsent(self.session.outgoing)
                        self.session.break_off()
                    return False
        return True
