"""One member of a simulated central with a replicated log: a process that follows, leads, stands
still and dies. The product's own code follows the log, takes over and writes the journal.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import msgspec
from log_model import ModelLog
from simulation.clockwork import Broken
from simulation.daemon import Crash, Daemon
from simulation.engine import Way
from simulation.fibers import Fiber, Killed
from simulation.harbour import Door

from tca_central.core import Central
from tca_central.errors import CentralError, DiskFull
from tca_central.events import (
    ConfirmTasks,
    ConnectionLost,
    Input,
    MembersChanged,
    Record,
)
from tca_central.image.encoder import can_encode, encode
from tca_central.replication.follower import FollowedRunLost, Follower
from tca_central.replication.member import Member
from tca_central.replication.shared_inputs import SharedInputs
from tca_central.replication.shared_log import Deposed, Kind
from tca_central.shell.images import write_image
from tca_central.shell.input_log import IMAGE_SUFFIX, Ended
from tca_central.shell.log_writer import Sync
from tca_central.shell.store import Store
from tca_wire.journal.facts import Entry

if TYPE_CHECKING:
    from simulation.members import Members

PULSE_PERIOD = 1.0
_decode_turn = msgspec.msgpack.Decoder(list[Input | Ended]).decode


class LogMember(Daemon):
    """A member during a life.

    Args:
        number: Its number; member 0 leads first.
        members: All members.
        door: The address at which it listens.
    """

    def __init__(self, number: int, members: "Members", door: Door) -> None:
        super().__init__(members.clockwork, door, members.options, members.publish)
        self.name, self._members, self._door = f"member{number}", members, door
        self.take_back = members.take_back
        self.fiber: Fiber
        self.member: Member | None = None
        self.way: Way | None = None
        self.is_running = self._is_leading = self._is_resting = False
        self.term = 0  #: the message with which its term began
        self._handled: list[Input] = []  #: inputs since packets last left
        self._sent_to = 0  #: the last message at that time
        self._next_pulse = 0.0
        self._image = 0  #: the image that is being written

    # --- the process ------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the process."""
        self.is_running = True
        self.disk.fault = self.fault
        if self.disk.folder.exists() and self._clockwork.chance(0.3):
            for path in self.disk.folder.iterdir():
                path.unlink()
        self.fiber = Fiber(self._clockwork, self._live)

    def kill(self) -> None:
        """Let the process die."""
        if self.is_running:
            self.fiber.kill()

    def freeze(self, seconds: float) -> None:
        """Let the process stand still."""
        self._clockwork.trace(self.name, f"stands still for {seconds:.1f} s")
        self.fiber.frozen_until = self._clockwork.now + seconds

    def fault(self) -> None:
        """Die at this step, perhaps."""
        self._fault()

    def _live(self) -> None:
        """Follow and lead, as ``tca central`` and ``tca standby`` do, and end some time."""
        power = self._live_until_end(is_standby=self._members.is_standby(self))
        # Outside of any handler: no frame of the dead process has a file open.
        self._fall(power=power)

    def _live_until_end(self, *, is_standby: bool) -> bool:
        """Return whether the process dies, and the power may fail at the same time."""
        while True:
            self._clockwork.trace(self.name, "stands by" if is_standby else "starts")
            try:
                self._follow_and_lead(is_standby=is_standby)
            except (Crash, Killed):
                return True
            except CentralError as error:
                self._clockwork.trace(self.name, f"steps down: {error}")
                self._members.count(type(error).__name__)
                if isinstance(error, DiskFull):
                    self.full += 1
                    self.disk.room = None
                try:
                    self._step_down()
                except (Crash, Killed):
                    return True
                if not isinstance(error, Deposed | FollowedRunLost):
                    return False
                is_standby = True

    def _follow_and_lead(self, *, is_standby: bool) -> None:
        members, clockwork = self._members, self._clockwork
        self.way = Way(members.engine, clockwork, self._options, self)
        shared = ModelLog(members.engine, self.way, f"{self.name}.{members.next_life()}")
        shared.patience = self._options.patience
        address, folder = f"ipc:///{self.name}", self.disk.folder
        member = self.member = Member(shared, address, folder, Store(), "", lambda: clockwork.now)
        self.disk.sync()
        member._name = shared.name
        write = member._follower._write

        def note(central: Central, entries: Sequence[Entry]) -> None:
            members.record(self.name, entries)
            write(central, entries)

        member._follower._write = note
        if is_standby:
            member.stand_by(lambda: False)
        else:
            member.begin(is_fresh=False)
        self._lead(member)

    def _lead(self, member: Member) -> None:
        core, clockwork, options = member.central, self._clockwork, self._options
        self.term = self._sent_to = member._follower.last
        clockwork.trace(self.name, f"LEADS from message {self.term}")
        self._members.begin_term(self, core)
        self.core, self._began = core, clockwork.now - core.clock.now
        self._next_beat, self._next_sweep = core.clock.now + 2.0, core.clock.now + 30.0
        self._next_pulse, self._image = core.clock.now + PULSE_PERIOD, 0
        self._is_leading = True
        member.open(self, Sync.BATCH, hold=options.hold and not self._members.is_healed)
        assert self.log is not None
        self.log.images = None  # ``_take_image`` writes images instead
        if options.sees_processes:
            gone = [
                one for one in core.restart_pause.awaited if self.is_gone(one.module.incarnation)
            ]
            for connection in gone:
                why = "its process had ended when central came back"
                self.handle_input(ConnectionLost(self.now, connection.id, why))
        self._flush()
        self._door.beat_at = clockwork.now
        self._door.is_listening = True
        while True:
            self._is_resting = True
            self.fiber.sleep(self._rest())
            self._is_resting = False
            self._door.beat_at = clockwork.now
            self._do_turn()

    def _step_down(self) -> None:
        """Close everything, as the product's process does, which then follows or ends."""
        core, log, member = self.core, self.log, self.member
        self._is_leading = False
        with suppress(CentralError):
            if core is not None and log is not None:
                for effect in core.handle(ConfirmTasks(self.now)):
                    if isinstance(effect, Record):
                        log.add_entry(effect.entry)
                log.flush(core)
                log.end(core, "deposed", is_over=False)
        self._forget()
        if member is not None:
            with suppress(CentralError):
                member.close()
        if self.way is not None:
            self.way.is_gone = True

    def _forget(self) -> None:
        """Forget what belongs to a term."""
        self.core = self.log = None
        self._arrived.clear()
        self._closed.clear()
        self._outgoing.clear()
        self._entries, self._handled = [], []
        self._is_resting = False
        self._network.lose_central()

    def _fall(self, *, power: bool) -> None:
        """End the process. It starts again later."""
        self.is_running = self._is_leading = False
        self.member = None
        if self.way is not None:
            self.way.is_gone = True
        self._entries, self._handled, self._is_resting = [], [], False
        self.crash(power=power)

    # --- turns ------------------------------------------------------------------------------------

    def _wake(self, seconds: float) -> None:
        if self._is_resting:
            self.fiber.nudge(seconds)

    def _next_tick(self) -> float:
        assert self.core is not None
        assert self.log is not None
        return min(super()._next_tick(), self.core.clock.now + self.log.beat)

    def _inputs(self) -> Iterator[Input]:
        yield from super()._inputs()
        if self.now < self._next_pulse or self.log is None or self.core is None:
            return
        self._next_pulse = self.now + PULSE_PERIOD
        standbys, known, leader = self.log.standbys(), self.core.members, self._shared.name
        if standbys is not None and (
            known is None or (known.leader, known.standbys) != (leader, standbys)
        ):
            yield MembersChanged(self.now, leader, f"ipc:///{self.name}", standbys)

    @property
    def _shared(self) -> ModelLog:
        assert self.member is not None
        assert isinstance(self.member.shared, ModelLog)
        return self.member.shared

    @property
    def _shared_inputs(self) -> SharedInputs:
        assert self.log is not None
        assert isinstance(self.log._inputs, SharedInputs)
        return self.log._inputs

    def handle_input(self, event: Input) -> None:
        """Append an input to the log, and handle it."""
        self._handled.append(event)
        super().handle_input(event)

    @property
    def _logs(self) -> tuple[SharedInputs, object]:  # type: ignore[override]
        return self._shared_inputs, None

    def _sync(self) -> None:
        if self.log is not None:
            self.log._journal._fsync()

    def _record(self, entries: list[Entry]) -> None:
        self._members.record(self.name, entries)

    def _take_image(self) -> None:
        """Begin an image, or use the one that was begun, as a child process has written it."""
        inputs = self._shared_inputs
        if self._image:
            inputs.use_image(self._image, 0)
            self._image = 0
            self.images += 1
        elif self.core is not None and not inputs._image and can_encode(self.core):
            inputs.write_now()
            self._image = inputs.next_segment(self.core.clock.now)
            path = inputs.folder / f"{self._image:08d}{IMAGE_SUFFIX}"
            with suppress(OSError):  # on a full disk
                write_image(encode(self.core), path)

    def _send(self) -> None:
        if self._outgoing or self._handled:
            self._check_accepted()
        super()._send()

    def _check_accepted(self) -> None:
        """Check that the log has all inputs whose effects are about to leave."""
        if not self._is_leading:
            raise Broken(f"{self.name} sends, and does not lead")
        engine, name, last = self._members.engine, self._shared.name, self._shared_inputs._last
        span, self._sent_to = range(self._sent_to + 1, last + 1), last
        handled, self._handled = self._handled, []
        if any(engine.marks[number - 1].split()[0] != name for number in span):
            raise Broken(f"{self.name} sends, and others have written messages of {span}")
        found = [engine.message(number) for number in span]
        if not all(found):
            return  # another member has removed them since
        turns = [one.message for one in found if one is not None and one.message.kind is Kind.TURN]
        data, inputs = b"", list[Input | Ended]()
        for one in turns:
            data = one.data if not one.part else data + one.data
            if not one.is_more:
                inputs += _decode_turn(data)
        if msgspec.msgpack.encode(inputs) != msgspec.msgpack.encode(handled):
            raise Broken(f"{self.name} sends what follows from {handled}, and the log has {inputs}")


def replayed(follower: Follower, shared: ModelLog, last: int) -> Central | None:
    """Return the state to which the log leads up to message *last*; None if it has later ones."""
    other = Follower(shared, lambda _central, _entries: None)
    while other.last < last and other.follow(0.0):
        pass
    return other.central if other.last == last else None
