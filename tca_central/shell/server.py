"""The ZeroMQ shell around the core: reads packets, has the core handle them, and sends messages.

A turn of the loop: read the packets that have arrived, handle them, journal the effects, send the
messages. Messages of one turn to one connection leave in one packet. Packets for a connection that
accepts no more wait in its outbox, up to a bound. Apart from this file only bound_socket.py,
door.py and authenticator.py use central's sockets.
"""

import contextlib
import logging
import math
import os
import socket as sockets
import time
from collections.abc import Sequence
from typing import Any

import zmq

from tca_central.core import Central
from tca_central.errors import CentralError
from tca_central.events import (
    AWAY,
    Arrived,
    BadBytes,
    ConfirmTasks,
    ConnectionId,
    ConnectionLost,
    DiskSpace,
    Effect,
    Event,
    Input,
    LimitsSet,
    MembersChanged,
    RequestReceived,
    RequestSkipped,
    Tick,
    Transmit,
)
from tca_central.inputs import events_of
from tca_central.model.budget import MEMORY, TAP_DEPTH, TASK_DEPTH
from tca_central.shell.address_lock import lock_address
from tca_central.shell.bound_socket import LIVELY, bind, socket_in
from tca_central.shell.door import Door
from tca_central.shell.gate import Gate, gate_for
from tca_central.shell.large_bodies import LargeBodies
from tca_central.shell.log_lines import LogLines
from tca_central.shell.outboxes import Outboxes
from tca_central.shell.pulses import Pulses
from tca_central.shell.run_log import RunLog
from tca_central.shell.store import Store
from tca_wire.packets import codec, headers
from tca_wire.packets.headers import Beat, Bye, Closing, Receipt, Refused, ToModule, Unknown
from tca_wire.packets.large import LARGE
from tca_wire.vocabulary import Refusal

log = logging.getLogger("tca.central")

# As plain integers: combining pyzmq's enum members costs a microsecond each time.
_EVENTS, _POLLIN, _RCVMORE = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.RCVMORE)
_DONTWAIT, _SNDMORE = int(zmq.DONTWAIT), int(zmq.SNDMORE | zmq.DONTWAIT)

_BEAT = codec.pack_item(Beat())
_TRACKED = Bye, Receipt, headers.UsesStore
PULSE_PERIOD = 1.0  # seconds between heartbeats on pulses
BEAT_PERIOD = 2.0  # between heartbeats to connections that wait for an answer
SWEEP_PERIOD = 30.0  # between heartbeats to all connections
TICK_PERIOD = 5.0  # without input, while a timer is set: a crash loses the time since the last one
LOST_AFTER = 5
"""The number of unanswered heartbeats after which a process that stands still counts as lost."""
EVENTS_PER_TURN = 128
"""A turn ends after a packet with which it has at least so many events.

Few enough that one flooding sender can't starve the slots.

Slots get their next messages once a turn.
"""
BYTES_PER_TURN = 1 << 20
SECONDS_PER_TURN = 0.02
"""A turn ends once it exceeds these bytes or seconds: other connections wait for answers."""
MOST_DRAIN_TURNS = 1000
"""The limit for turns that read pending packets before a connection counts as lost.

Without a limit, a flood from others could hide the loss for ever.
"""


class Daemon:
    """Central as a daemon: the core, its journal and its socket.

    Args:
        central: The core, new or recovered.
        endpoint: The address to bind, ``ipc:///path`` or ``tcp://host:port``.
        lost_after: Seconds of silence after which a process that stands still counts as lost; 0:
            never.
        gate: Decides which programs may connect (default: over TCP, every program).
        memory: Bytes of modules' data that central holds at most.
        tap_depth: Listeners of wiretaps in one chain of messages at most.
        task_depth: Depth of the task tree at most.
        store: The store of large data, which ``close`` closes (default: none).
    """

    def __init__(
        self,
        central: Central,
        endpoint: str,
        *,
        lost_after: int = LOST_AFTER,
        gate: Gate | None = None,
        memory: int = MEMORY,
        tap_depth: int = TAP_DEPTH,
        task_depth: int = TASK_DEPTH,
        store: Store | None = None,
    ) -> None:
        self._limits = memory, tap_depth, task_depth
        self.central = central
        self.log: RunLog | None = None
        #: Whether to continue without a journal when the journal can't be written.
        self.continues_unrecorded = False
        self.stopping = ""  #: why the loop must end; "" while it runs
        self._is_over = False  #: whether the run is over, and does not continue at the next start
        self._is_kept = False  #: whether ``stop`` was called, and keeps the run
        self._started_at = time.monotonic() - central.clock.now
        self._outboxes = Outboxes(self._send)
        self._large_bodies = LargeBodies(central, store or Store(), self._outboxes)
        self._too_slow: dict[ConnectionId, str] = {}  #: connections that will be cut, and why
        self._lines = LogLines(log, central, lambda fact: self.stop(fact.by, keep=fact.keep))
        self._next_pulse, self._next_beat = PULSE_PERIOD, BEAT_PERIOD
        self._next_sweep = SWEEP_PERIOD
        self._lost_after = lost_after
        self._pulses = Pulses(lost_after)
        self._gate = gate or gate_for(endpoint, insecure=True)
        self._lock = lock_address(endpoint)
        self._context = zmq.Context()
        #: Whether a connection has closed without Bye. Heartbeats to all connections show which.
        self._has_lost = False
        self._closed = 0  #: number of sockets that have closed, as the door counts them
        #: Number of closed sockets that are explained: by a Bye, or by a search for the loss.
        self._explained = 0
        self._wake_sender, self._wake_receiver = sockets.socketpair()
        self._wake_sender.setblocking(False)
        self.socket, self._door = self._bind(endpoint)
        self.endpoint = self.socket.get_string(zmq.LAST_ENDPOINT)
        self._is_lively = False  #: whether a packet has just arrived, so that another is likely
        self._poller = zmq.Poller()
        self._poller.register(self._wake_receiver.fileno(), _POLLIN)
        self._poller.register(self.socket, _POLLIN)

    def stop(self, why: str, *, keep: bool = False) -> None:
        """End the loop, and the run unless *keep*. Signal handlers and other threads may call this.

        A kept run continues at the next start, as after a crash. Modules wait for that start.
        """
        if keep and (self.log is None or not self.log.keeps_inputs):
            log.error("does not end: the run can't be kept, because no inputs are stored")
            return
        self._is_over, self._is_kept = not keep, keep
        self.stopping = why
        self._wake_up()

    def check_soon(self) -> None:
        """Check keys, permissions and log files soon. Signal handlers may call this."""
        self._next_pulse = 0.0
        self._wake_up()

    def _count_closed(self, sockets_closed: int) -> None:
        """Note closed sockets. The door's thread calls this."""
        self._closed += sockets_closed
        self._wake_up()

    def _wake_up(self) -> None:
        """End the loop's present wait."""
        # OSError: the loop has ended and closed the socket, or earlier wake-ups fill its buffer.
        with contextlib.suppress(OSError):
            self._wake_sender.send(b".")

    # --- the loop ---------------------------------------------------------------------------------

    def serve(self) -> None:
        """Run until ``stopping`` says why to stop."""
        self._apply_gate_changes()
        self._set_limits()
        while not self.stopping:
            patience = self._poll_timeout()
            if self._is_lively and patience > LIVELY:
                # A wait inside ZeroMQ is cheaper than a poll, but only a packet ends such a wait.
                self._is_lively = self._receive(0)
            else:
                for source, _ in self._poller.poll(patience):
                    if source is self.socket:
                        self._is_lively = self._receive()
                    else:
                        self._wake_receiver.recv(4096)
            if not patience:
                self._run_due_work()
            self._flush()
        if self._is_kept:  # the clock of the continued run starts at the last input
            self.handle_input(Tick(self.now()))
            self._flush()

    def _set_limits(self) -> None:
        """Have the core apply the present limits, if it has others."""
        keeps_inputs = self.log is not None and self.log.keeps_inputs
        limits = *self._limits, keeps_inputs
        budget = self.central.budget
        known = budget.total, budget.tap_depth, budget.task_depth, budget.keeps_inputs
        if known != limits:
            self.handle_input(LimitsSet(self.now(), *limits))

    def handle_input(self, event: Input) -> None:
        """Log an input, pass it to the core, carry out its effects. Raises CentralError."""
        events = events_of(event, adopt=self._large_bodies.store.adopt)
        if self.log is not None:
            self.log.add_input(_as_logged(event, events))
        handle = self.central.handle
        for index, one in enumerate(events):
            if isinstance(one, RequestReceived) and isinstance(one.header, _TRACKED):
                self._track(one.connection, one.header)
            try:
                effects = handle(one)
            except Exception as error:
                raise self._internal_error(one, error, index) from error
            self._perform(effects)

    def _track(self, connection: ConnectionId, header: Bye | Receipt | headers.UsesStore) -> None:
        """Note that a connection will close its sockets, has read bytes, or shares memory."""
        if isinstance(header, Bye):
            self._explained += self._count_sockets(connection)
        elif isinstance(header, headers.UsesStore):
            self._large_bodies.note_sharing(connection)
        else:
            self._outboxes.credit(connection, header.size)
            self._large_bodies.credit(connection, header.size)

    def _internal_error(self, event: Event, error: Exception, index: int) -> CentralError:
        """Return the error with which central ends after an error of its own (decision 52).

        Log that a replay must refuse this request, which would end central again.
        """
        if self.log is not None:
            self.log.add_input(RequestSkipped(index))
        kind, owner = type(event).__name__, ""
        if isinstance(event, RequestReceived):
            kind = type(event.header).__name__
            sender = self.central.registry.connections.get(event.connection)
            owner = f" of module '{sender.module.name}'" if sender is not None else ""
        number = self.central.event_count
        self.stopping = f"internal error: {type(error).__name__} in event {number}, {kind}{owner}"
        log.error("%s; the event was %.1000r", self.stopping, event, exc_info=error)
        return CentralError(
            f"{self.stopping}; this is a bug in central, please report it with the journal"
        )

    def _perform(self, effects: list[Effect]) -> None:
        """Journal entries and queue messages; ``_flush`` writes and sends them."""
        log, lines = self.log, self._lines
        for effect in effects:
            if isinstance(effect, Transmit):
                self._enqueue(effect.connection, effect.header, effect.body)
                continue
            if log is not None:
                log.add_entry(effect.entry)
            lines.write(effect)

    def _run_due_work(self) -> None:
        """Handle losses, heartbeats and timers that are due."""
        if self._closed > self._explained:
            self._has_lost, self._explained = True, self._closed
        if self._has_lost or self._too_slow or self.now() >= self._next_beat:
            self._check_connections()
        if self.now() >= self._next_pulse:
            self._next_pulse = self.now() + PULSE_PERIOD
            self._check_log()
            self._apply_gate_changes()
            self._lines.losses.write_due(self.now())
            self._check_pulses()
            self._check_members()
            self._flush()  # a central that has lost its lead ends here, and removes no segment
            self._large_bodies.sweep()
        if (now := self.now()) >= self._next_tick():
            self.handle_input(Tick(now))

    def _next_tick(self) -> float:
        """Return the time of the next tick, if no other input comes before it."""
        clock, beat = self.central.clock, self.log.beat if self.log is not None else math.inf
        due = min(clock.next, clock.now + TICK_PERIOD) if clock.next is not None else math.inf
        return min(due, clock.now + beat)

    def _flush(self) -> None:
        """End a turn: write the log first, then send the messages that it records."""
        if self.log is not None:
            try:
                self.log.flush(self.central)
                self._large_bodies.store.flush()
            except CentralError as error:
                self._on_log_failure(error)
        for connection in self._outboxes.send_all():  # the next heartbeats find the loss
            self._has_lost |= connection in self.central.registry.connections
        for connection, size in self._outboxes.drop_beyond(self.central.budget.unread).items():
            self._too_slow[connection] = f"it reads too slowly: {size:,} bytes wait for it"
        self._large_bodies.store.settle(self.central.registry.modules)

    def _on_log_failure(self, error: CentralError) -> None:
        """Continue without a journal if that was asked for; else raise the error."""
        if self.log is None or not self.continues_unrecorded:
            self._outboxes.forget_all()  # nothing may be sent that is not recorded
            raise error
        advice = (
            ""
            if self.log.abandon()
            else f"; remove {self.log.folder} before central is started again"
        )
        log.error(
            "%s; central continues without a journal (--if-journal-fails go-on): "
            "a crash would lose all tasks%s",
            error,
            advice,
        )
        self.log = None
        self._set_limits()

    def _check_log(self) -> None:
        """Find problems that a write would not: removed files, and a disk that is nearly full."""
        if self.log is None:
            return
        try:
            self.log.check()
            is_low = self.log.is_nearly_full()
        except CentralError as error:
            self._on_log_failure(error)
        except OSError:  # the next write will fail, too
            return
        else:
            if is_low != self.central.is_disk_low:
                self.handle_input(DiskSpace(self.now(), is_low))

    def _check_members(self) -> None:
        """Handle a change among the centrals that follow the same replicated log."""
        if self.log is None or (standbys := self.log.standbys()) is None:
            return
        leader, known = f"{sockets.gethostname()}:{os.getpid()}", self.central.members
        if known is None or (known.leader, known.standbys) != (leader, standbys):
            self.handle_input(MembersChanged(self.now(), leader, self.endpoint, standbys))

    def now(self) -> float:
        """Return the seconds since the run started, on a clock that never jumps."""
        return time.monotonic() - self._started_at

    def _poll_timeout(self) -> int:
        """Return the milliseconds until the next heartbeat, timer or retry of a slow connection."""
        left = min(self._next_beat, self._next_pulse, self._next_tick()) - self.now()
        if left <= 0 or self._has_lost or self._too_slow or self._closed > self._explained:
            return 0
        return 10 if self._outboxes.has_waiting else int(left * 1000) + 1

    # --- receiving --------------------------------------------------------------------------------

    def _receive(self, flags: int = _DONTWAIT) -> bool:
        """Handle the packets that have arrived, up to a bound. Return whether there were any.

        With *flags* 0 wait up to LIVELY milliseconds for the first one.
        """
        receive, size, until, central = self.socket.recv, 0, 0.0, self.central
        last = central.event_count + EVENTS_PER_TURN
        # Reading EVENTS makes ZeroMQ notice other senders. Otherwise, while one sender has more,
        # ZeroMQ would notice the others only every hundred frames.
        self._has_arrived()
        for count in range(EVENTS_PER_TURN):
            is_over = size > BYTES_PER_TURN or central.event_count >= last
            if is_over or (count == 1 and not self._has_arrived()):
                break
            try:
                connection = ConnectionId(receive(_DONTWAIT if count else flags))
            except zmq.Again:
                # The exception costs more than ``_has_arrived``, but is rare: after a second packet
                # there are often more.
                return count > 0
            frame, now = receive(_DONTWAIT, copy=False), self.now()
            until = until or now + SECONDS_PER_TURN
            if size and len(frame) > BYTES_PER_TURN:  # answers to earlier packets need not wait
                self._flush()
            size += len(frame) if now < until else BYTES_PER_TURN
            self._accept_packet(connection, frame, now)
        return True

    def _accept_packet(self, connection: ConnectionId, frame: zmq.Frame, now: float) -> None:
        """Handle a packet if its sender may connect."""
        if (principal := self._gate.principal_of(frame)) is None or connection.startswith(AWAY):
            self._reject(connection, frame)
            return
        if self._gate.has_changes:
            self._apply_gate_changes()
        self._pulses.active.add(connection)
        if frame.more:
            self.handle_input(BadBytes(now, connection, self._discard_frames(frame)))
            return
        packet = frame.bytes
        if len(packet) >= LARGE:
            packet = self._large_bodies.with_segments(packet)
        if not packet:  # a new connection
            self._ask_identity(connection)
        elif packet != _BEAT:  # a pulse returns heartbeats
            self.handle_input(Arrived(now, connection, packet, principal))

    def _reject(self, connection: ConnectionId, frame: zmq.Frame) -> None:
        """Discard a packet of a program that may not connect. Answer only its first packet."""
        self._discard_frames(frame)
        if self._gate.is_first_rejection(connection):
            self._enqueue(connection, Refused(0, Refusal.SHUT_OUT, self._gate.rejection))

    def _discard_frames(self, frame: zmq.Frame) -> str:
        """Discard the other frames of a message. Return what is wrong with the message."""
        frames, receive, is_more = 1, self.socket.recv, self.socket.getsockopt
        more: Any = frame.more
        while more:  # central handles nothing else in the meantime: keep it short
            receive(_DONTWAIT)
            frames, more = frames + 1, is_more(_RCVMORE)
        return f"{frames:,} frames; a packet is one"

    def _ask_identity(self, connection: ConnectionId) -> None:
        """Ask an unknown connection to identify itself."""
        if connection not in self.central.registry.connections:
            self._enqueue(connection, Unknown())

    def _count_sockets(self, connection: ConnectionId) -> int:
        """Return the number of sockets that close with a connection.

        With the last connection of a process the pulse closes, too.
        """
        known = self.central.registry.connections
        if (leaving := known.get(connection)) is None:
            return 0
        return 1 + (
            bool(leaving.pulse) and sum(one.pulse == leaving.pulse for one in known.values()) == 1
        )

    def _apply_gate_changes(self) -> None:
        """Handle changes of keys and permissions."""
        for event in self._gate.changes(self.now(), self.central):
            self.handle_input(event)
            if isinstance(event, ConnectionLost):
                self._enqueue(event.connection, Refused(0, Refusal.SHUT_OUT, event.why))

    def _check_connections(self) -> None:
        """Send heartbeats to connections, and handle the loss of closed and slow ones.

        Usually heartbeats go only to connections that wait for an answer. They go to all once per
        SWEEP_PERIOD, and after an unexplained close: the door counts closed sockets, but does not
        know whose they are.
        """
        now, known = self.now(), self.central.registry.connections
        is_sweep = self._has_lost or now >= self._next_sweep
        if self._has_lost:
            # Sweep again soon: the door may see a close before the socket does.
            self._has_lost, self._next_sweep = False, now + PULSE_PERIOD
        elif is_sweep:
            self._next_sweep = now + SWEEP_PERIOD
            # Some connections say Bye and stay open: they explain no close.
            self._explained = min(self._explained, self._closed)
        self._next_beat = min(now + BEAT_PERIOD, self._next_sweep)
        for stranger in [one for one in self._outboxes.idle_connections() if one not in known]:
            self._outboxes.forget(stranger, is_closed=not self._send_heartbeat(stranger))
        if self.central.unconfirmed:
            self.handle_input(ConfirmTasks(now))
        for connection, why in self._too_slow.items():
            self.handle_input(ConnectionLost(now, connection, why))
            self._ask_identity(connection)
        self._too_slow.clear()
        awaited = self.central.restart_pause.awaited
        checked = [
            one.id for one in known.values() if (is_sweep or one.outstanding) and one not in awaited
        ]
        closed = [connection for connection in checked if not self._send_heartbeat(connection)]
        if closed:
            self._drain()
        for connection in closed:
            self.handle_input(ConnectionLost(self.now(), connection))

    def _send_heartbeat(self, connection: ConnectionId) -> bool:
        """Send a heartbeat. Return False if the connection is closed."""
        try:
            self.socket.send_multipart((connection, _BEAT), zmq.DONTWAIT)
        except zmq.Again:
            return True  # earlier heartbeats are still on their way
        except zmq.ZMQError:
            return False
        return True

    def _check_pulses(self) -> None:
        """Send heartbeats to all pulses, and handle the loss of processes that stand still.

        A stopped process returns no heartbeat, although the kernel keeps its sockets open.
        """
        known, pulses = self.central.registry.connections, self._pulses
        beating = pulses.start_round(known.values()) if self._lost_after else set()
        if pulses.silent():
            self._drain()  # their heartbeats may have arrived without being read
            pulses.count_signs(known.values())
        silent = pulses.silent()
        for connection in [one for one in known.values() if one.pulse in silent]:
            why = f"its process was silent for {self._lost_after} s"
            self.handle_input(ConnectionLost(self.now(), connection.id, why))
            self._ask_identity(connection.id)  # for when the process continues
        for pulse in beating - silent:
            if self._send_heartbeat(ConnectionId(pulse)):
                pulses.mark_sent(pulse)
            else:
                pulses.mark_closed(pulse)

    def _drain(self) -> None:
        """Handle all packets that have arrived: a connection may have said Bye before it closed."""
        for _ in range(MOST_DRAIN_TURNS):
            if not self._receive():
                return
            self._flush()

    def _has_arrived(self) -> bool:
        """Whether a packet has arrived. Cheaper than the exception of a socket without packets."""
        return bool(int(self.socket.getsockopt(_EVENTS)) & _POLLIN)

    # --- sending ----------------------------------------------------------------------------------

    def _enqueue(self, connection: ConnectionId, header: ToModule, body: bytes = b"") -> None:
        """Queue a message for the end of the turn."""
        if self.central.restart_pause.awaited and connection.startswith(AWAY):
            return  # a connection that returns gets its messages again
        if type(body) is not bytes or type(header) is headers.Welcome:
            self._large_bodies.enqueue(connection, header, body)
            return
        self._outboxes.add(connection, codec.pack_in_pieces(header, body))

    def _send(self, connection: ConnectionId, packet: bytes) -> bool:
        """Send a packet. Return False if the connection accepts no more now.

        Raises ConnectionError if it is closed.
        """
        try:
            self.socket.send(connection, _SNDMORE)
            self.socket.send(packet, _DONTWAIT)
        except zmq.Again:
            # Report a message to an unknown connection as sent: it is dropped, not stored.
            return connection not in self.central.registry.connections
        except zmq.ZMQError as error:
            raise ConnectionError from error
        return True

    # --- start and end ----------------------------------------------------------------------------

    def _bind(self, endpoint: str) -> tuple[zmq.Socket[bytes], Door]:
        """Return the bound socket and its open door. Raises CentralError."""
        socket = socket_in(self._context)
        door = Door(socket, self._count_closed)
        try:
            bind(socket, endpoint, self._context, self._gate)
        except CentralError:
            self._close_wakers()
            raise
        door.open()
        return socket, door

    def close(self) -> None:
        """Say goodbye to the modules, close the journal, free the address."""
        self._lines.losses.write_due()
        if not self._is_kept:  # else modules see a break of the connection, and repeat requests
            self._perform(self.central.handle(ConfirmTasks(self.now())))
            for connection in self.central.registry.connections:
                self._enqueue(connection, Closing(self.stopping))
        is_over = self._is_over
        try:
            self._flush()
            if self.log is not None:
                why = "" if self._is_kept else self.stopping
                self.log.end(self.central, why, is_over=is_over)
        except CentralError:  # it has been reported
            is_over = False
            if self.log is not None and self.log.images is not None:
                self.log.images.close()
        self._door.close()
        self._gate.close()
        self.socket.close()
        self._context.term()
        self._close_wakers()
        is_kept = not is_over and self.log is not None and self.log.keeps_inputs
        self._large_bodies.store.close(is_over=not is_kept)
        if self._lock >= 0:
            os.close(self._lock)

    def _close_wakers(self) -> None:
        self._wake_sender.close()
        self._wake_receiver.close()


def _as_logged(event: Input, events: Sequence[Event]) -> Input:
    """Return an input as the log stores it: for bytes that are not a packet, the error in them."""
    return events[0] if isinstance(event, Arrived) and isinstance(events[0], BadBytes) else event
