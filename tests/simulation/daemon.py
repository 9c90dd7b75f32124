"""Central's process in a simulation: the core, the daemon's own logs on a disk that fails, and the
turns of the daemon's loop.

In each turn the daemon takes some packets. It writes each packet to the log, and passes the packet
to the core. Then the daemon flushes the log, and only then sends packets. The process may end at
each step. Only the disk remains then. The daemon's own code for recovery continues from the disk,
many times on one journal.
"""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress

from simulation.clockwork import Broken, Clockwork, shown
from simulation.disk import Disk
from simulation.likeness import difference
from simulation.network import PROBE, Network, Wire
from simulation.options import Options

from dev.invariants import check_invariants
from tca_central.core import Central
from tca_central.errors import CentralError, DiskFull
from tca_central.events import (
    AWAY,
    Arrived,
    ConfirmTasks,
    ConnectionId,
    ConnectionLost,
    Event,
    Input,
    Record,
    RequestReceived,
    Tick,
)
from tca_central.image.encoder import can_encode, encode
from tca_central.inputs import events_of
from tca_central.shell.images import write_image
from tca_central.shell.input_log import IMAGE_SUFFIX, InputLog
from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync, sync_path
from tca_central.shell.recovery import UnfinishedRun
from tca_central.shell.run_folder import RunFolder
from tca_central.shell.run_log import RunLog
from tca_wire.journal.facts import Entry
from tca_wire.packets import codec
from tca_wire.packets.headers import Beat, ToModule, Unknown

BEAT_PERIOD, SWEEP_PERIOD, SYNC_PERIOD = 2.0, 30.0, 1.0


class Crash(Exception):
    """The end of central's process."""


class Daemon:
    """Central during a life. It crashes and restarts."""

    def __init__(
        self,
        clockwork: Clockwork,
        network: Network,
        options: Options,
        publish: Callable[[list[Entry]], None],
    ) -> None:
        self.name = "central"
        self._clockwork, self._network, self._options = clockwork, network, options
        self._publish = publish  #: receives entries that the journal keeps
        self.disk = Disk(clockwork.dice)
        self.log: RunLog | None = None
        self.stopping = ""
        self.journal: list[Entry] = []  #: published entries, each with its input
        self._safe = 0  #: the number of entries with synced inputs
        self._perhaps: list[Entry] = []  #: unpublished entries that the journal may contain
        self._is_half = False  #: some input may be handled, but not on the disk
        self._expected: Central | None = None  #: the state to recover from the disk
        self.core: Central | None = None
        self.crashes = self.cuts = self.full = self.steps = self.images = 0
        self._synced_at = 0.0  #: time of the last sync
        self._life = 0  #: number of the process
        self._arrived: deque[tuple[Wire, bytes]] = deque()
        self._closed: deque[ConnectionId] = deque()
        self._outgoing: dict[ConnectionId, list[tuple[ToModule, bytes]]] = {}
        self._entries: list[Entry] = []
        self._began = 0.0  #: time at which the core's clock read 0, adjusted for pauses
        self._wake_at = float("inf")
        #: receives the entries that are left after a loss
        self.take_back: Callable[[list[Entry]], None] = lambda _: None
        #: whether the process of an incarnation has ended
        self.is_gone: Callable[[str], bool] = lambda _: False
        self._next_beat, self._next_sweep = BEAT_PERIOD, SWEEP_PERIOD
        network.central = self

    # --- the process ------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the process from the disk."""
        is_new = not self.disk.folder.exists()
        if is_new:
            self._begin_run()
        try:
            self._recover(is_new=is_new)
            self._flush()
        except Crash:
            self.crash()
            return
        except CentralError as error:
            self._refused(error)
            return
        self._network.is_listening = True
        self._wake(0.0)

    def _begin_run(self) -> None:
        """Create a new run, with an image of its first state."""
        folder, options = self.disk.folder, self._options
        folder.mkdir()
        central = Central("simulated")
        central.dispatcher.prefetcher.trusts_all = options.trusts_all
        InputLog(folder, epoch=central.epoch, sync=options.sync)
        write_image(encode(central), folder / f"00000001{IMAGE_SUFFIX}")
        self.disk.kill()
        self.disk.sync()
        self.disk.fault = self._fault

    def _recover(self, *, is_new: bool) -> None:
        """Recover from the disk. Every connection has broken. The connections of ended processes do
        not return.
        """
        options, clockwork = self._options, self._clockwork
        if clockwork.chance(0.1):
            self._damage_image()
        folder = RunFolder(self.disk.folder)
        if (run := folder.run) is None:
            raise Broken("the run is over")
        core = self.core = run.central
        self._compare(run)
        self._began = clockwork.now - core.clock.now
        self._next_beat, self._next_sweep = (
            core.clock.now + BEAT_PERIOD,
            core.clock.now + SWEEP_PERIOD,
        )
        clockwork.trace(self.name, "starts" if is_new else f"starts, with {run.inputs} inputs")
        folder.open(self, options.sync, hold=options.hold and not is_new)
        assert self.log is not None
        self.log.images = None  # ``_take_image`` writes images instead
        if options.sees_processes:
            for connection in [
                one for one in core.restart_pause.awaited if self.is_gone(one.module.incarnation)
            ]:
                self.handle_input(
                    ConnectionLost(
                        self.now, connection.id, "its process had ended when central came back"
                    )
                )

    def _refused(self, error: CentralError) -> None:
        """Crash because the disk is full; with an even chance it has room afterwards. Raise Broken
        for any other error.
        """
        if not isinstance(error, DiskFull) or self.disk.room is None:
            raise Broken(f"central does not come back: {error}")
        self.full += 1
        if self.disk.room is not None and self._clockwork.chance(0.5):
            self.disk.room = None
        self.crash(power=False)

    def _damage_image(self) -> None:
        """Damage the newest image, unless it is the first one."""
        if images := sorted(self.disk.folder.glob(f"*{IMAGE_SUFFIX}"))[1:]:
            images[-1].write_bytes(images[-1].read_bytes()[:-1])

    def _compare(self, run: UnfinishedRun) -> None:
        """Compare the recovered state and facts with those from before the crash."""
        if self._expected is not None and (unlike := difference(self._expected, run.central)):
            raise Broken(f"the state that was lost, and the one that was recovered: {unlike}")
        before, self._perhaps = self.journal + self._perhaps, []
        known = sum(entry.number <= run.last.number for entry in before)
        if any(one != other for one, other in zip(before[known:], run.missing, strict=False)):
            raise Broken("what was replayed is not what happened")
        now = before[:known] + run.missing
        if len(now) < self._safe or (
            len(now) < len(self.journal) and not (self._options.is_lossy and run.may_lack)
        ):
            raise Broken(
                f"of {len(self.journal)} entries, {self._safe} of them synced, {len(now)} are left"
            )
        if len(now) < len(self.journal):
            del self.journal[len(now) :]
            self.take_back(self.journal)
        self._record(now[len(self.journal) :])
        self._safe = len(self.journal)

    def _take_image(self) -> None:
        """Write an image, as a child process of the daemon does."""
        if self.core is not None and can_encode(self.core):
            inputs, journal = self._logs
            before = inputs.write_now()
            number = inputs.next_segment(self.core.clock.now)
            for path in (before, journal.write_now()):
                sync_path(path)
            with suppress(OSError):  # on a full disk the child ends without an image
                write_image(encode(self.core), self.disk.folder / f"{number:08d}{IMAGE_SUFFIX}")
                self.images += 1

    def _sync(self) -> None:
        """Sync the two logs, in either order."""
        if self.log is not None:
            for log in self._logs if self._clockwork.chance(0.5) else self._logs[::-1]:
                log._fsync()
            self._safe = len(self.journal)

    @property
    def _logs(self) -> tuple[InputLog, JournalWriter]:
        assert self.log is not None
        assert isinstance(self.log._inputs, InputLog)
        return self.log._inputs, self.log._journal

    def crash(self, *, power: bool = True) -> None:
        """Kill the process, perhaps by a power cut."""
        self.crashes += 1
        self._life += 1
        clockwork, options = self._clockwork, self._options
        is_cut = power and clockwork.chance(options.power_cuts)
        is_all_there = not (self._entries or self._is_half or is_cut)
        is_compared = (
            is_all_there
            and self.core is not None
            and can_encode(self.core)
            and clockwork.chance(0.1)
        )
        self._expected = self.core if is_compared else None
        self._perhaps += self._entries
        self.disk.kill()
        if is_cut:
            self.cuts += 1
            self.disk.cut_power()
        clockwork.trace(self.name, "CRASHES" + " (power)" * is_cut)
        self.core = self.log = None
        self._arrived.clear()
        self._closed.clear()
        self._outgoing.clear()
        self._entries = []
        self._is_half = False
        self._wake_at = float("inf")
        self._network.lose_central()
        clockwork.after(clockwork.between(0.05, options.away), self.start)

    def _fault(self) -> None:
        """Crash at this step, perhaps."""
        self.steps += 1
        if self.steps == self._options.crash_at or self._clockwork.chance(
            self._options.central_crashes
        ):
            raise Crash

    def heal(self) -> None:
        """Have no faults from now on."""
        self.disk.room = None

    @property
    def now(self) -> float:
        """Seconds on the core's clock. This clock stood still while central was away."""
        now = self._clockwork.now - self._began
        return now if self.core is None else max(now, self.core.clock.now)  # because of rounding

    # --- inputs ---------------------------------------------------------------------------------

    def arrive(self, wire: Wire, packet: bytes) -> None:
        """Accept a packet that arrives."""
        self._arrived.append((wire, packet))
        self._wake(self._clockwork.between(0.0, 0.001))

    def see_closed(self, connection: ConnectionId) -> None:
        """Notice a closed line. Packets that arrived earlier are handled first."""
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
        try:
            self._do_turn()
        except Crash:
            self.crash()
            return
        except CentralError as error:
            self._refused(error)
            return
        self._wake(self._rest())

    def _do_turn(self) -> None:
        """Take some packets, handle them, write the logs, send packets."""
        if self._clockwork.now >= self._synced_at + SYNC_PERIOD:
            self._synced_at = self._clockwork.now
            self._sync()
        if self._clockwork.chance(self._options.full_disks):
            self.disk.room = self._clockwork.dice.randint(0, 2000)
        for given in self._inputs():
            self.handle_input(given)
        self._flush()
        if self._clockwork.chance(self._options.snapshots):
            self._take_image()
        self._send()

    def _rest(self) -> float:
        """Return the seconds until the next turn."""
        if self._arrived or self._closed:
            return 0.0
        return max(0.0, min(self._next_beat, self._next_tick()) - self.now) + 0.0001

    def _next_tick(self) -> float:
        """Return the time of the next tick."""
        assert self.core is not None
        due = self.core.clock.next
        return float("inf") if due is None else due

    def _inputs(self) -> Iterator[Input]:
        """Yield the inputs of this turn."""
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
                self._enqueue(wire.id, Unknown(), b"")
        if self._closed and not self._arrived:
            closed = self._closed.popleft()
            if closed in known:
                yield ConnectionLost(self.now, closed)
        if self._next_tick() <= self.now:
            yield Tick(self.now)
        if self.now >= self._next_beat:
            yield from self._beat(core)

    def _beat(self, core: Central) -> Iterator[Input]:
        """Send heartbeats to the connections that wait, and every ``SWEEP_PERIOD`` to all. A
        heartbeat that cannot leave shows a closed line.
        """
        is_sweep = self.now >= self._next_sweep
        if is_sweep:
            self._next_sweep = self.now + SWEEP_PERIOD
        self._next_beat = self.now + BEAT_PERIOD
        if core.unconfirmed:
            yield ConfirmTasks(self.now)
        for connection in [
            one for one in core.registry.connections.values() if is_sweep or one.outstanding
        ]:
            if connection not in core.restart_pause.awaited and not self._network.carry_down(
                connection.id, _BEAT
            ):
                self._closed.append(connection.id)

    # --- effects ---------------------------------------------------------------------------------

    def handle_input(self, event: Input) -> None:
        """Write an input to the log, and handle it."""
        core, log, clockwork = self.core, self.log, self._clockwork
        assert core is not None
        assert log is not None
        self._fault()
        self._is_half = True
        log.add_input(event)
        if clockwork.chance(0.3):
            self._logs[0].flush()
        for one in events_of(event):
            if clockwork.has_trace_reader:
                clockwork.trace(self.name, f"has {_shown(one)}")
            for effect in core.handle(one):
                if isinstance(effect, Record):
                    log.add_entry(effect.entry)
                    self._entries.append(effect.entry)
                else:
                    self._enqueue(effect.connection, effect.header, effect.body)
            if core.event_count % self._options.checks_each == 0:
                check_invariants(core)

    def _enqueue(self, connection: ConnectionId, header: ToModule, body: bytes) -> None:
        self._outgoing.setdefault(connection, []).append((header, body))

    def _flush(self) -> None:
        assert self.core is not None
        assert self.log is not None
        self.log.flush(self.core)
        self._is_half = False
        entries, self._entries = self._entries, []
        self._record(entries)
        if self._options.sync is Sync.ALWAYS:
            self._safe = len(self.journal)

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
                if not connection.startswith(AWAY) and not self._network.carry_down(
                    connection, packet
                ):
                    self._closed.append(connection)
        self._fault()


_BEAT = codec.pack_item(Beat())


def _shown(event: Event) -> str:
    if isinstance(event, RequestReceived):
        return f"from {event.connection[1:].decode()}: {shown(event.header)}"
    return str(event)
