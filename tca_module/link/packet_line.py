"""Exchanges packets with central. Each call has a bounded wait."""

import math
import threading
from collections.abc import Callable

from tca_module.errors import CentralLost
from tca_module.large.bodies import LargeBodies
from tca_module.late_calls import late_calls
from tca_module.log import log_of
from tca_module.session.request import check_fields
from tca_module.session.session import QUIET, Session
from tca_module.sockets.curve import key_problem
from tca_module.sockets.place import accepts_connections, rejects_connections
from tca_module.sockets.transport import Transport, context
from tca_wire.errors import ProtocolError
from tca_wire.packets.codec import packets, unpack_to_module
from tca_wire.packets.credit import Receipts
from tca_wire.packets.headers import Answer, ToCentral, ToModule, UsesStore, Welcome
from tca_wire.packets.large import MARK
from tca_wire.vocabulary import Limit

SEND_WAIT = 1.0  # seconds that a send waits for central to take the packet
STEP = 0.2  # seconds that a wait listens at a time while central is not there
_PROBE_ANSWERED_WITHIN = 0.2  # seconds within which a live central answers a probe
STALL = 2.0  # if a wait ends this many seconds too late, the whole process was stopped
SENT_AT_ONCE = 4  # sends in a row that leave at once
_MOST_HELD, _MOST_HELD_BYTES = 64, 16 << 10  # sends that wait to leave together
_SILENT = 1.0  # seconds without an answer after which central may lead at another address
_LOOK_PERIOD = 0.5  # seconds between two looks whether central is gone, if it may move
_SEEK_PERIOD = 0.25  # seconds between two looks for a central that is gone
_ACKNOWLEDGED_WITHIN = 0.02  # seconds; usually the next send takes the receipt along


class PacketLine:
    """Sends and receives the packets of one connection."""

    def __init__(
        self,
        session: Session,
        transport: Transport,
        clock: Callable[[], float],
        lock: threading.RLock,
    ) -> None:
        """*lock*: the lock of the connection. Callers have it, except those of ``send_held``."""
        self.session = session
        self._transport = transport
        self._lock = lock
        #: Its thread keeps the lock beyond a call, so that no other thread could send.
        self.is_occupied = False
        self._send_at = math.inf  #: when another thread will call ``send_held``
        self._hold_until = -math.inf  #: until then the line counts as busy after a send
        self._in_a_row = 0  #: sends before the present one, each within a millisecond of the last
        self._is_busy = False  #: the present send may wait for others, to leave with them
        self._held_bytes = 0  #: bytes of the bodies that wait
        #: the handlers' clock, in seconds; a stepped clock stands still
        self.handler_time = transport.time
        self.clock = clock
        self._log = log_of(session.module)
        self._receipts = Receipts()
        self.large = LargeBodies()
        self._seek_at = -math.inf  #: when to look for central elsewhere, at the earliest
        #: the length and the end of the last silence in which central left a probe unanswered
        self._last_silence = 0.0, -math.inf

    @property
    def why_silent(self) -> str:
        """The reason why central counts as silent, for errors; "" if packets come and go."""
        session, now = self.session, self.clock()
        if session.is_welcome and not session.outgoing and not self._owes_answer(now):
            return ""
        where, silence = f"central at {self._transport.address}", now - session.heard
        return (
            f"{where} has said nothing for {silence:.1f} s; see with 'tca status' whether it runs"
        )

    def _owes_answer(self, now: float) -> bool:
        """Whether central has been silent for long, and has not answered a probe."""
        heard, probed = self.session.heard, self.session.probed_since
        return now - heard >= QUIET and probed > heard and now - probed >= _PROBE_ANSWERED_WITHIN

    def why_late(self, within: float) -> str:
        """Return why central has not answered within the last *within* seconds."""
        seconds, until = self._last_silence
        if self.clock() - until < within:
            where = "the network, or central, stood still"
            return f"central was silent for {seconds:.1f} s of it: {where}"
        return self.why_silent or "though central is alive: it is overloaded"

    @property
    def where(self) -> str:
        """Central's address, or all addresses at which it may be, for errors."""
        return " or ".join(self._transport.addresses)

    def lost_error(self) -> CentralLost:
        """Return the CentralLost for a central that does not answer."""
        return CentralLost(f"central at {self.where} does not answer: {self.advice()}")

    def advice(self) -> str:
        """Return advice for when central does not answer. Takes a moment."""
        for address in self._transport.addresses:
            if advice := _advice_on(address):
                return f"at {address} {advice}" if self._transport.has_others else advice
        return "start it with 'tca central', or set $TCA_CENTRAL to where it listens"

    def catch_up(
        self, since: float = float("-inf"), quiet: float = QUIET, *, is_sending: bool = False
    ) -> float:
        """Process arrived packets, keep the line alive, and return when there is more to do.

        After *quiet* seconds of silence, counted from *since* at the earliest, this probes central.
        Every call checks for silence, so that a program that never waits also notices a broken
        connection. With *is_sending*, the caller flushes right after this.
        """
        self.listen_to_all()
        now = self.clock()
        due = self.send_due(now, since, quiet)
        if not is_sending:
            # A send that waits to share a packet has as long as any other to leave.
            self.flush(wait_seconds=0, is_patient=now < self._hold_until + SEND_WAIT)
        return due

    def send_due(self, now: float, since: float, quiet: float = QUIET) -> float:
        """Do what ``Session.send_due`` does, and look for central where it may be."""
        if not self._transport.has_others:
            return self.session.send_due(now, since, quiet)
        look_at = self._seek(now)
        return min(look_at, self.session.send_due(now, since, quiet))

    def _seek(self, now: float) -> float:
        """Look for central at its other addresses if it is gone from the present one.

        Return when to look again.
        """
        session, transport = self.session, self._transport
        if now < self._seek_at:
            return self._seek_at
        is_silent = session.heard < session.probed_since <= now - _SILENT
        if not (is_silent or transport.is_lost()):
            return now + (_LOOK_PERIOD if session.is_welcome else _SEEK_PERIOD)
        self._seek_at = now + _SEEK_PERIOD
        if (pulse := transport.seek()) is not None:
            session.set_pulse(pulse)
            session.break_off()
            self._seek_at = now + _SILENT  # central has this long to answer there
        return self._seek_at

    def listen_to_all(self) -> None:
        """Process all packets that have arrived."""
        while self.listen(0.0):
            pass

    def listen(self, timeout: float, alarm: float = math.inf) -> bool:
        """Process the next packet; return False if none arrives within *timeout* seconds.

        The wait also ends at *alarm*, a time of the handlers' clock.
        """
        packet = self._transport.receive(timeout, alarm)
        if packet is None:
            return False
        self._process(packet)
        return True

    def _process(self, packet: bytes) -> None:
        if (receipt := self._receipts.due(packet)) and self._transport.send(receipt, 0.0):
            self._receipts.sent()
        now, session = self.clock(), self.session
        if self._owes_answer(now):
            self._last_silence = now - session.heard, now
        try:
            for header, body in unpack_to_module(packet):
                if body[:1] == MARK:
                    body = self._opened(header, body)  # noqa: PLW2901
                session.receive(header, body, now)
                if header.__class__ is Welcome:
                    self._on_welcome(header)
        except ProtocolError as error:
            self._log.warning(
                "central at %s sent an invalid packet: %s", self._transport.address, error
            )
        while session.complaints:
            self._log.warning("%s", session.complaints.pop(0))

    def _opened(self, header: ToModule, body: bytes) -> bytes:
        """Return a large body with its memory."""
        if isinstance(header, Answer):
            self.acknowledge([header.number])
        return self.large.opened(body)

    def _on_welcome(self, header: Welcome) -> None:
        """Use the store of the central, which may be another one than before."""
        session = self.session
        shares_memory = self.large.on_welcome(header, session.incarnation)
        session.outgoing = [(one, self.large.restore(body)) for one, body in session.outgoing]
        if shares_memory:
            session.outgoing.insert(0, (UsesStore(), b""))

    def stored(self, header: ToCentral, body: bytes) -> bytes:
        """Return a body that can be sent with a header, see ``LargeBodies.store``."""
        if body[:1] != MARK:
            return body
        check_fields(header)  # a refused header must leave no segment
        name = getattr(header, "message", "") or getattr(header, "variable", "")
        what = f"'{name}'" if name else "the message"
        return self.large.store(body, what, is_away=not self.session.is_welcome)

    def acknowledge(self, answers: list[int]) -> None:
        """Report what was read, so that central no longer holds the large data in it.

        *answers*: the requests that are answered.
        """
        self.session.outgoing.append((self._receipts.now(answers[: Limit.LIST]), b""))
        self.hold(self.clock() + _ACKNOWLEDGED_WITHIN)

    def begin_send(self) -> None:
        """Prepare to send a header that nothing waits for; ``end_send`` comes next.

        Such headers share packets. The first ones after a millisecond leave at once, because a few
        sends are no stream. Arrived packets are processed as rarely as packets leave.
        """
        is_soon = not self.is_occupied and self.clock() < self._hold_until
        self._in_a_row = self._in_a_row + 1 if is_soon else 0
        self._is_busy = self._in_a_row >= SENT_AT_ONCE
        if not self._is_busy:
            self.catch_up(is_sending=True)

    def end_send(self, body: bytes) -> None:
        """Send the outgoing headers, or hold them back until the line is no longer busy."""
        self._held_bytes += len(body)
        if self._is_busy:
            if len(self.session.outgoing) < _MOST_HELD and self._held_bytes < _MOST_HELD_BYTES:
                self.hold(self._hold_until)
                return
            self.catch_up(is_sending=True)
        self.flush()
        self._hold_until = self.clock() + self._transport.hold_seconds

    def end_burst(self) -> None:
        """Note that the thread waits for something: its next send leaves at once."""
        self._hold_until = -math.inf

    def hold(self, until: float) -> None:
        """Have another thread send the outgoing headers if this one has not at the time *until*."""
        if until < self._send_at:
            self._send_at = until
            late_calls().add(self.send_held, until - self.clock())

    def send_held(self) -> bool:
        """Send the outgoing headers, from another thread; return False if that is not possible."""
        # Reset first, because a send first adds its header, and then calls ``hold``.
        self._send_at = math.inf
        if not self.session.outgoing:
            return True
        if not self._lock.acquire(blocking=False):
            return False
        try:
            has_left = self.flush(0.0, is_patient=True)
            if self._transport.hold_seconds:
                # ZeroMQ's file signals changes only, and the send may have consumed one. So a loop
                # of coroutines that waits for the file must look again.
                self._transport.wake()
            return has_left
        finally:
            self._lock.release()

    def flush(self, wait_seconds: float = SEND_WAIT, *, is_patient: bool = False) -> bool:
        """Send the session's outgoing headers; return whether they left.

        If they did not leave, the connection counts as broken, unless the caller *is_patient*.
        """
        if self.session.outgoing:
            self._held_bytes = 0
            if self._transport.has_others:
                wait_seconds = min(wait_seconds, _SEEK_PERIOD)
            outgoing = self.session.pop_outgoing(self.handler_time)
            for sent, packet in packets(outgoing):
                if not self._transport.send(packet, wait_seconds):
                    self.session.outgoing = outgoing[sent:]
                    if not is_patient:
                        self.session.break_off()
                    return False
        return True


def _advice_on(address: str) -> str:
    """Return why the program at an address does not answer; "" if none listens there."""
    if rejects_connections(address):
        return (
            "it takes no more connections: end some programs, or start it with a higher limit"
            " of file descriptors (ulimit -Hn)"
        )
    if not accepts_connections(address):
        return ""
    return key_problem(context(), address) or (
        "it accepts connections, but its process is stopped (SIGSTOP, a paused container:"
        " continue it) or very busy; or it waits for its replicated log, as its output says; or"
        " another program listens there, not a central"
    )
