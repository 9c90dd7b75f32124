"""All members of a simulated central with a replicated log, and what they must agree about."""

import logging
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

from log_model import ModelLog
from simulation.clockwork import Broken, Clockwork
from simulation.engine import Engine
from simulation.harbour import Harbour
from simulation.likeness import difference
from simulation.member import LogMember, replayed
from simulation.options import Options

from tca_central.core import Central
from tca_central.image.encoder import encode
from tca_central.replication import follower, records, shared_log
from tca_central.replication.shared_log import Kind, cut
from tca_central.shell.log_writer import files_of
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import CentralFailed, Closed, Entry, Opened
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader

EPOCH = "simulated"
_OWN = CentralFailed | Closed | Opened
"""Facts of a journal, not of the run."""


class Members:
    """Central as several processes with one log. To a life it is as one daemon."""

    def __init__(
        self,
        clockwork: Clockwork,
        harbour: Harbour,
        options: Options,
        publish: Callable[[list[Entry]], None],
        count: Callable[[str], None],
    ) -> None:
        self.clockwork, self.harbour, self.options = clockwork, harbour, options
        self.publish, self.count = publish, count
        self.engine = Engine(clockwork, options)
        self.journal: list[Entry] = []  #: the entries of the run
        self._entries: dict[int, Entry] = {}
        self._lives = 0
        self.take_back: Callable[[list[Entry]], None] = lambda _: None
        self.members = [LogMember(number, self, door) for number, door in enumerate(harbour.doors)]
        self._patches = ExitStack()
        self.is_healed = False  #: whether there are no more faults

    # --- its life ---------------------------------------------------------------------------------

    @property
    def disk(self) -> "Members":
        """The disks of all members, as a context manager."""
        return self

    def __enter__(self) -> Self:
        patches, options = self._patches, self.options
        for member in self.members:
            patches.enter_context(member.disk)
        for place, name, value in (
            (shared_log, "PIECE_BYTES", options.piece_bytes),
            (follower, "token_hex", lambda _: EPOCH),
        ):
            patches.callback(setattr, place, name, getattr(place, name))
            setattr(place, name, value)
        logger = logging.getLogger("tca.central")
        patches.callback(setattr, logger, "disabled", logger.disabled)
        logger.disabled = not self.clockwork.has_trace_reader
        return self

    def __exit__(self, *_: object) -> None:
        for member in self.members:
            if member.is_running:
                member.fiber.kill()
        self._patches.close()

    def start(self) -> None:
        """Start all members, with a first image perhaps."""
        if self.options.trusts_all:
            central = Central(EPOCH)
            central.dispatcher.prefetcher.trusts_all = True
            image = records.Image(0, EPOCH, encode(central))
            held, self.options.held_messages = self.options.held_messages, 0.0
            ModelLog(self.engine).append(Kind.IMAGE, cut(records.encode(image)), 0)
            self.options.held_messages = held
        for member in self.members:
            member.start()

    def is_standby(self, member: LogMember) -> bool:
        """Whether a process starts as a standby."""
        if not self.engine.last or (member is self.members[0] and not self._lives):
            return member is not self.members[0]
        return not self.clockwork.chance(0.2)

    def next_life(self) -> int:
        """Return a number that no client had."""
        self._lives += 1
        return self._lives

    def heal(self) -> None:
        """Have no faults from now on."""
        now, options, self.is_healed = self.clockwork.now, self.options, True
        options.lost_requests = options.lost_answers = options.held_messages = 0.0
        self.engine.down_until = now
        for member in self.members:
            member.disk.room = None
            if member.way is not None:
                member.way.cut_until = now
            if member.is_running:
                member.fiber.frozen_until = min(member.fiber.frozen_until, now + 1.0)

    # --- what a life asks -------------------------------------------------------------------------

    @property
    def core(self) -> Central | None:
        """The state of the leader, or of the follower that knows most."""
        leading = [one for one in self.members if one.core is not None]
        if leading:
            return max(leading, key=lambda one: one.term).core
        known = [one.member._follower for one in self.members if one.member is not None]
        return max(known, key=lambda one: one.last).central if known else None

    def _sum(name: str) -> Any:  # type: ignore[misc]  # noqa: N805
        return property(lambda self: sum(getattr(one, name) for one in self.members))

    crashes, cuts, full, images = map(_sum, ("crashes", "cuts", "full", "images"))

    @property
    def writes(self) -> int:
        """The number of writes to all disks."""
        return sum(one.disk.writes for one in self.members)

    @property
    def is_gone(self) -> Callable[[str], bool]:
        """Whether the process of an incarnation has ended."""
        return self.members[0].is_gone

    @is_gone.setter
    def is_gone(self, value: Callable[[str], bool]) -> None:
        for member in self.members:
            member.is_gone = value

    # --- checks -----------------------------------------------------------------------------------

    def record(self, name: str, entries: Sequence[Entry]) -> None:
        """Note the entries of a member. All members must have equal ones."""
        new = []
        for entry in entries:
            if self.journal and entry.number <= self.journal[-1].number:
                if (known := self._entries.get(entry.number)) != entry:
                    raise Broken(f"{name} has {entry}, and another member has {known}")
                continue
            self.journal.append(entry)
            self._entries[entry.number] = entry
            new.append(entry)
        if new:
            self.publish(new)

    def begin_term(self, member: LogMember, core: Central) -> None:
        """Note that a member leads. Compare its state with a replay, sometimes."""
        self.count("terms")
        if self.clockwork.chance(0.3):
            self._compare(member, core, member.term)

    def _compare(self, member: LogMember, core: Central, last: int) -> None:
        assert member.member is not None
        clients = self.engine.clients
        other = replayed(member.member._follower, ModelLog(self.engine), last)
        clients.pop()
        if other is not None and (unlike := difference(core, other)):
            raise Broken(f"{member.name} has another state than a replay of the log: {unlike}")

    def judge(self) -> None:
        """Compare the states and the journals of all members at the end of a life."""
        for member in self.members:
            if member.member is not None and member.core is None:
                known = member.member._follower
                if known.central is not None:
                    self._compare(member, known.central, known.last)
            self._judge_journal(member)

    def _judge_journal(self, member: LogMember) -> None:
        """Check that a member's files have entries of the run only, without gaps."""
        written = list(_written(member.disk.folder))
        if not written:
            return
        first = bisect_left(self.journal, written[0].number, key=lambda one: one.number)
        for entry, known in zip(written, self.journal[first : first + len(written)], strict=True):
            if entry != known:
                raise Broken(f"{member.name} has {entry} in its files, and not {known}")


def _written(folder: Path) -> Iterator[Entry]:
    """Yield the entries of a journal's files that are about the run."""
    for path in files_of(folder, SEGMENT_SUFFIX):
        with path.open("rb") as stream, suppress(JournalDamaged):  # by a power cut
            for entry in JournalReader(stream):
                if any(not isinstance(one, _OWN) for one in entry.facts):
                    yield entry
