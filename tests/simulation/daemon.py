"""Central's process: the core, the log of its inputs on a simulated disk, and the turns of its loop.

A turn takes some packets, writes each to the log, lets the core have it, flushes the log, and only then sends what
follows from it. It may end at any of these steps. What is there afterwards is what the disk has.
"""

from collections import deque
from collections.abc import Callable, Iterator

from simulation.clockwork import Broken, Clockwork, shown
from simulation.disk import SimulatedFile, as_record, inputs_in
from simulation.likeness import difference
from simulation.network import PROBE, Network, Wire
from simulation.options import Options
from simulation.real_files import recovered

from tca_central.core import Central
from tca_central.events import (
    AWAY,
    Arrived,
    ConnectionId,
    ConnectionLost,
    Event,
    Input,
    Record,
    RequestReceived,
    Restarted,
    TellAll,
    Tick,
)
from tca_central.image.decoder import decode
from tca_central.image.encoder import encode, may_be_taken
from tca_central.inputs import events_of
from tca_central.invariants import check_invariants
from tca_central.shell.log_writer import SYNC_PERIOD, Sync
from tca_central.shell.recovery import GRACE, SKIPPED
from tca_wire.journal.facts import Entry
from tca_wire.packets import codec
from tca_wire.packets.headers import Beat, ToModule, Unknown

BEAT_PERIOD, SWEEP_PERIOD = 2.0, 30.0


class Crash(Exception):
    """Central's process ends here."""


class Daemon:
    """Central, as long as the town lives: it crashes, and comes again."""

    def __init__(
        self, clockwork: Clockwork, network: Network, options: Options, publish: Callable[[list[Entry]], None]
    ) -> None:
        self._clockwork, self._network, self._options = clockwork, network, options
        self._publish = publish  #: what is in the journal for good
        self.log = SimulatedFile()
        self.journal: list[Entry] = []  #: the facts that were written, none without its input
        self.image: tuple[bytes, int, int] | None = None  #: the newest, and how many inputs and entries led to it
        self._has_image = False  #: it is used
        self._is_half = False  #: an input is written, perhaps, and has not happened
        self._expected: Central | None = None  #: the state that the disk should give
        self.core: Central | None = None
        self.crashes = self.steps = self.replayed = self.images = self.read_again = 0
        self._synced_at = 0.0  #: when another thread last asked the disk
        self._life = 0  #: which process it is
        self._arrived: deque[tuple[Wire, bytes]] = deque()
        self._closed: deque[ConnectionId] = deque()
        self._outgoing: dict[ConnectionId, list[tuple[ToModule, bytes]]] = {}
        self._entries: list[Entry] = []
        self._unwritten = bytearray()
        self._began = 0.0  #: when the core's clock stood at 0, if it had never stood still
        self._wake_at = float("inf")
        self.take_back: Callable[[list[Entry]], None] = lambda _: None  #: the journal has no more than this
        self.is_gone: Callable[[str], bool] = lambda _: False  #: whether the process of an incarnation has ended
        self._next_beat, self._next_sweep = BEAT_PERIOD, SWEEP_PERIOD
        network.central = self

    # --- the process -------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """The process begins: with what the disk has."""
        is_new = self.core is None
        core = self.core = self._recovered()
        now = core.clock.now
        self._began = self._clockwork.now - now
        self._next_beat, self._next_sweep = now + BEAT_PERIOD, now + SWEEP_PERIOD
        self._clockwork.say("central", "starts" if is_new else f"starts, with {self.replayed} inputs")
        try:
            if not is_new:
                self._come_back(core)
            self._flush()
        except Crash:
            self.crash()
            return
        self._network.is_listening = True
        self._wake(0.0)

    def _come_back(self, core: Central) -> None:
        """Every connection has broken; some will not come back, as their processes are gone."""
        options = self._options
        skipped = SKIPPED if options.is_lossy else 0
        self._take(Restarted(self.now, 1.0, GRACE, options.hold, skipped))
        if skipped:
            self._write()
            self.log.sync()
        if options.sees_processes:
            for connection in [one for one in core.hold.awaited if self.is_gone(one.module.incarnation)]:
                self._take(ConnectionLost(self.now, connection.id, "its process had ended when central came back"))

    def _recovered(self) -> Central:
        """The newest image of the state, and the inputs since: what comes out is what the journal has, and goes on."""
        inputs, size = inputs_in(self.log.content)
        log = bytes(self.log.content)
        del self.log.content[size:]
        self.log.sync()
        core, since, before = self._empty(), 0, 0
        self._has_image = not self._clockwork.chance(0.1)  # else it is damaged, or was never finished
        if self.image is not None and self._has_image:
            core, since, before = decode(self.image[0]), self.image[1], self.image[2]
        again: list[Entry] = []
        for given in inputs[since:]:
            for event in events_of(given):
                again += [effect.entry for effect in core.handle(event) if isinstance(effect, Record)]
        self.replayed = len(inputs) - since
        if self._options.is_lossy and len(again) < len(self.journal) - before:
            del self.journal[before + len(again) :]  # --resume facts: the journal goes back to what the inputs lead to
            self.take_back(self.journal)
        known = len(self.journal) - before
        if again[:known] != self.journal[before:]:
            raise Broken("what was replayed is not what happened")
        if self._expected is not None and (unlike := difference(self._expected, core)):
            raise Broken(f"the state that was lost, and the one that was recovered: {unlike}")
        self._record(again[known:])
        if inputs and self._clockwork.chance(self._options.reads_files):
            self._compare_with_files(core, log)
        return core

    def _compare_with_files(self, core: Central, log: bytes) -> None:
        """Have the daemon's own code recover the same state from files."""
        image = self.image if self._has_image else None
        if self._options.trusts_all and image is None:
            return
        run, known = recovered(log, image, self.journal, self._clockwork.dice, is_behind=self._options.is_lossy)
        self.read_again += 1
        if unlike := difference(run.central, core):
            raise Broken(f"the state that the daemon recovers, and the one that was recovered: {unlike}")
        if run.missing != self.journal[known:] and not self._options.is_lossy:
            raise Broken(f"the daemon's journal lacks {len(self.journal) - known} entries, it says {len(run.missing)}")

    def _empty(self) -> Central:
        core = Central("simulated")
        core.dispatcher.messages_ahead.trusts_all = self._options.trusts_all
        return core

    def _take_image(self) -> None:
        """Write the state down, when all that led to it is on the disk."""
        if self.core is not None and may_be_taken(self.core):
            self.log.sync()
            self.image = encode(self.core), len(inputs_in(self.log.content)[0]), len(self.journal)
            self.images += 1

    def crash(self) -> None:
        """The process is killed, perhaps by a power cut."""
        self.crashes += 1
        self._life += 1
        clockwork, options = self._clockwork, self._options
        is_all_there = not (self._unwritten or self._is_half) and (
            self.log.synced == len(self.log.content) or not options.power_cuts
        )
        is_compared = is_all_there and self.core is not None and may_be_taken(self.core) and clockwork.chance(0.1)
        self._expected = self.core if is_compared else None
        if self._unwritten and clockwork.chance(0.5):
            self.log.write(self._unwritten[: clockwork.dice.randint(0, len(self._unwritten))])
        if options.power_cuts:
            self.log.cut_power(clockwork.dice)
        clockwork.say("central", "CRASHES" + " (power)" * options.power_cuts)
        self._arrived.clear()
        self._closed.clear()
        self._outgoing.clear()
        self._entries.clear()
        self._unwritten.clear()
        self._is_half = False
        self._wake_at = float("inf")
        self._network.lose_central()
        clockwork.after(clockwork.between(0.05, options.away), self.start)

    def _fault(self) -> None:
        """A step in which it may crash."""
        self.steps += 1
        if self.steps == self._options.crash_at or self._clockwork.chance(self._options.central_crashes):
            raise Crash

    @property
    def now(self) -> float:
        """Seconds on the core's clock, which stood still while it was away."""
        now = self._clockwork.now - self._began
        return now if self.core is None else max(now, self.core.clock.now)  # it was rounded

    # --- what comes --------------------------------------------------------------------------------------------------

    def arrive(self, wire: Wire, packet: bytes) -> None:
        """A packet is there."""
        self._arrived.append((wire, packet))
        self._wake(self._clockwork.between(0.0, 0.001))

    def see_closed(self, connection: ConnectionId) -> None:
        """A line is seen to have closed; what came on it before is heard first."""
        self._closed.append(connection)
        self._wake(0.0)

    def _wake(self, seconds: float) -> None:
        at = self._clockwork.now + seconds
        if at < self._wake_at:
            self._wake_at = at
            self._clockwork.after(seconds, self._turn, self._life, at)

    def _turn(self, life: int, at: float) -> None:
        if life != self._life or at != self._wake_at:
            return
        self._wake_at = float("inf")
        if self._clockwork.now >= self._synced_at + SYNC_PERIOD:  # by another thread
            self._synced_at = self._clockwork.now
            self.log.sync()
        try:
            for given in self._inputs():
                self._take(given)
            self._flush()
            if self._clockwork.chance(self._options.snapshots):
                self._take_image()
            self._send()
        except Crash:
            self.crash()
            return
        assert self.core is not None
        due = self.core.clock.next
        until = min(self._next_beat, self._next_beat if due is None else due)
        self._wake(0.0 if self._arrived or self._closed else max(0.0, until - self.now) + 0.0001)

    def _inputs(self) -> Iterator[Input]:
        """What happens in this turn."""
        core = self.core
        assert core is not None
        known = core.registry.connections
        for _ in range(self._clockwork.dice.choice((1, 4, 64))):
            if not self._arrived:
                break
            wire, packet = self._arrived.popleft()
            if packet != PROBE:
                yield Arrived(self.now, wire.id, packet)
            elif wire.id not in known:
                self._put(wire.id, Unknown(), b"")
        if self._closed and not self._arrived:
            closed = self._closed.popleft()
            if closed in known:
                yield ConnectionLost(self.now, closed)
        due = core.clock.next
        if due is not None and due <= self.now:
            yield Tick(self.now)
        if self.now >= self._next_beat:
            yield from self._beat(core)

    def _beat(self, core: Central) -> Iterator[Input]:
        """Beat to those who wait, and now and then to all; who is gone is found so."""
        is_sweep = self.now >= self._next_sweep
        if is_sweep:
            self._next_sweep = self.now + SWEEP_PERIOD
        self._next_beat = self.now + BEAT_PERIOD
        if core.untold:
            yield TellAll(self.now)
        for connection in [one for one in core.registry.connections.values() if is_sweep or one.outstanding]:
            if connection not in core.hold.awaited and not self._network.carry_down(connection.id, _BEAT):
                self._closed.append(connection.id)

    # --- what follows ------------------------------------------------------------------------------------------------

    def _take(self, given: Input) -> None:
        """Write an input, and let it happen."""
        core, clockwork = self.core, self._clockwork
        assert core is not None
        self._fault()
        self._is_half = True
        self._unwritten += as_record(given)
        if clockwork.chance(0.3):
            self._write()
        for event in events_of(given):
            if clockwork.is_told:
                clockwork.say("central", f"has {_shown(event)}")
            for effect in core.handle(event):
                if isinstance(effect, Record):
                    self._entries.append(effect.entry)
                else:
                    self._put(effect.connection, effect.header, effect.body)
            if core.events % self._options.checks_each == 0:
                check_invariants(core)
        self._is_half = False

    def _put(self, connection: ConnectionId, header: ToModule, body: bytes) -> None:
        self._outgoing.setdefault(connection, []).append((header, body))

    def _write(self) -> None:
        self._fault()
        self.log.write(bytes(self._unwritten))
        self._unwritten.clear()
        self._fault()

    def _flush(self) -> None:
        if self._unwritten:
            self._write()
        if self._options.sync is Sync.ALWAYS and self.log.synced < len(self.log.content):
            self.log.sync()
            self._fault()
        self._record(self._entries)
        self._entries = []

    def _record(self, entries: list[Entry]) -> None:
        if entries:
            self.journal += entries
            self._publish(entries)

    def _send(self) -> None:
        outgoing, self._outgoing = self._outgoing, {}
        for connection, items in outgoing.items():
            self._fault()
            for _, packet in codec.packets(items):
                self._clockwork.note(packet)
                if not connection.startswith(AWAY) and not self._network.carry_down(connection, packet):
                    self._closed.append(connection)
        self._fault()


_BEAT = codec.pack_item(Beat())


def _shown(event: Event) -> str:
    if isinstance(event, RequestReceived):
        return f"from {event.connection[1:].decode()}: {shown(event.header)}"
    return str(event)
