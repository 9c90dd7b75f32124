"""Removes ended tasks and messages from the journal of a run that continues. Knows facts; writes
whole segments anew.

A fact goes when all tasks and messages that it is about ended before a moment of the run's clock. A
task that stays keeps its ancestors, so every tree still has its root. The newest segment, which
central writes, is not touched, nor are those that a recovery compares with the inputs: they are
newer than the oldest inputs that lie there.
"""

import os
from array import array
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from tca_tools.errors import ToolError
from tca_wire.errors import JournalDamaged
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, Fact, Shortened
from tca_wire.journal.frames import payloads
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader, record
from tca_wire.points import END_ACHIEVING

INPUT_SUFFIX = ".tcai"
_CLOCK = 7
"""The place of central's clock in the first record of a segment of inputs."""

_OF_A_MOMENT = (
    facts.HandledDirectly,
    facts.LostDirectly,
    facts.RequestRefused,
    facts.Ignored,
    facts.MonitorTested,
)
"""Facts that are over with their entry."""

_ENDINGS = (
    facts.Returned,
    facts.Answered,
    facts.Dropped,
    facts.Unqueued,
    facts.Failed,
    facts.ClaimEnded,
)
"""Facts that end a message, one receiver's part of it, or a claim. A task ends when END_ACHIEVING
is reached.
"""


class Lives:
    """The end of each task, message and claim of a run, by its number, and the one to which it
    belongs.
    """

    def __init__(self) -> None:
        self.ended = array("d")  #: infinite for one that has not ended
        self.parent = array("q")
        self.time = 0.0  #: of the last entry
        #: By key the ends of the waits for no certain task; behind them that of one that has not
        #: ended.
        self.waits = defaultdict[Any, Any](lambda: array("d", [inf]))
        self._is_task = bytearray()
        self._kept: set[int] = set()  #: tasks whose records modules keep

    def apply(self, entry: Entry) -> None:
        """Take in an entry's facts."""
        self.time = entry.time
        for fact in entry.facts:
            match fact:
                case facts.Received() | facts.Queued() | facts.Delivered() | facts.Claimed():
                    self._take_beginning(fact)
                case facts.Reached() if fact.moments & END_ACHIEVING:
                    self._end(fact.task)
                case facts.WaitEnded() if not fact.task:
                    self.waits[fact.key].insert(-1, self.time)
                case facts.Kept():
                    self._kept.add(fact.task)
                case facts.Released() if not fact.module:
                    self._kept.discard(fact.task)
                case _ if isinstance(fact, _ENDINGS) and not getattr(fact, "is_beside", False):
                    self._take_ending(fact.id)

    def _take_beginning(
        self, fact: facts.Received | facts.Queued | facts.Delivered | facts.Claimed
    ) -> None:
        if isinstance(fact, facts.Claimed):
            self._begin(fact.id, fact.origin)
        elif not isinstance(fact, facts.Received):
            self._begin(fact.id, 0 if fact.id == fact.message_id else fact.message_id)
        else:
            self._begin(fact.id, fact.parent, is_task=fact.message_class.is_task)
            if fact.message_class.fans_out and not fact.message_class.has_reply:
                self._end(fact.id)  # its copies live on, each by itself

    def _take_ending(self, number: int) -> None:
        if not self._has(number) or not self._is_task[number]:
            self._end(number)

    def _has(self, number: int) -> bool:
        return 0 < number < len(self.ended)

    def _begin(self, number: int, parent: int, *, is_task: bool = False) -> None:
        if not 0 < number < 1 << 40:
            return
        missing = number + 1 - len(self.ended)
        if missing > 0:
            self.ended.extend([inf] * missing)
            self.parent.extend([0] * missing)
            self._is_task.extend(bytes(missing))
        if not self._is_task[number]:  # each handling of a task is told by the task's end
            self.ended[number] = inf
        self.parent[number] = parent or self.parent[number]
        self._is_task[number] |= is_task

    def _end(self, number: int) -> None:
        self._begin(number, 0)
        self.ended[number] = self.time

    def last(self) -> array:  # type: ignore[type-arg]  # array[float] is no class at run time
        """By number, when the last of a task and of all that belongs to it ended; infinite while
        one has not.
        """
        last = self.ended[:]
        for number in self._kept:
            self._begin(number, 0)
            last[number] = inf
        for number in range(len(last) - 1, 0, -1):  # what belongs to another is newer than that
            parent = self.parent[number]
            if self._has(parent):
                last[parent] = max(last[parent], last[number])
        return last


class EndedTasks:
    """The facts that can be removed of one run that continues."""

    def __init__(self, files: list[Path]) -> None:
        """*files*: all of the run, its segments last. Raises ToolError for one that can't be
        read.
        """
        paths = [path for path in files if path.suffix == SEGMENT_SUFFIX]
        lives = Lives()
        safe = min((clock for path in files if (clock := _clock_of(path)) is not None), default=inf)
        self._segments: dict[
            Path, float
        ] = {}  #: those that may be written anew -> the time of their last entries
        with _reported():
            self._size = sum(path.stat().st_size for path in files if path.exists())
            for path in paths:
                is_whole = _read(path, lives)
                if is_whole and path is not paths[-1] and lives.time < safe:
                    self._segments[path] = lives.time
        self._last, self._waits = lives.last(), lives.waits
        self._now = lives.time

    def until(self, keep: float | None, keep_bytes: float | None) -> float:
        """The moment of the run's clock such that all goes that ended by then: *keep* seconds
        before its last entry, or the earliest at which *keep_bytes* are left. Raises ToolError.
        """
        moment: float = self._now - keep if keep is not None else 0.0
        if keep_bytes is None:
            return moment
        moments = sorted(self._segments.values())
        sizes = [0.0] * (len(moments) + 1)
        with _reported():
            for path in self._segments:
                for entry, size in _entries(path):
                    for fact in entry.facts:
                        sizes[bisect_left(moments, self._end_of(fact, entry.time))] += size / len(
                            entry.facts
                        )
        left = float(self._size)
        for end, ended in zip(moments, sizes, strict=False):
            if left <= keep_bytes:
                break
            left -= ended
            moment = max(moment, end)
        return moment

    def remove(self, until: float, *, dry_run: bool = False) -> int:
        """Write the segments without what ended *until* then; the number of bytes gone. Raises
        ToolError.
        """
        gone, drafts = 0, dict[Path, bytes]()
        with _reported():
            for number, path in enumerate(self._segments):
                entries = self._shorter(path, until, is_first=not number)
                data, before = b"".join(map(record, entries)), path.stat().st_size
                if not number or len(data) < before:
                    drafts[path] = data  # the first one says so, before another one lacks anything
                if len(data) < before:
                    gone += before - len(data)
                    for draft in () if dry_run else drafts.items():
                        _replace(*draft)
                    drafts.clear()
        return gone

    def _shorter(self, path: Path, until: float, *, is_first: bool) -> Iterator[Entry]:
        for place, (entry, _) in enumerate(_entries(path)):
            left = [fact for fact in entry.facts if self._end_of(fact, entry.time) > until]
            if is_first and not place:
                said = [fact.until for fact in left if isinstance(fact, Shortened)]
                left = [fact for fact in left if not isinstance(fact, Shortened)]
                left.insert(1, Shortened(max([until, *said])))
            if left:
                yield Entry(entry.number, entry.time, left, entry.cause)

    def _end_of(self, fact: Fact, time: float) -> float:
        """When all ended that a fact is about; infinite for one that stays."""
        if isinstance(fact, _OF_A_MOMENT):
            return time
        if isinstance(fact, facts.Constrained | facts.TimedOut):
            constraints = (
                fact.constraints if isinstance(fact, facts.Constrained) else [fact.constraint]
            )
            return max((self._end(one.after.task) for one in constraints), default=time)
        if isinstance(fact, facts.TapFired):
            return min(self._end(fact.tapped), self._end(fact.listener))
        if isinstance(fact, facts.WaitBegan | facts.WaitEnded):
            end = self._end(fact.task)
            if not fact.task:
                at = bisect_left if isinstance(fact, facts.WaitEnded) else bisect_right
                end = (ends := self._waits[fact.key])[at(ends, time)]
            return min(end, self._end(fact.origin))
        if isinstance(fact, facts.Removed):
            return inf
        names = (
            ["handler"]
            if isinstance(fact, facts.NotResolved)
            else ["task", "id", "monitor", "handler"]
        )
        return next((self._end(getattr(fact, name)) for name in names if hasattr(fact, name)), inf)

    def _end(self, number: int) -> float:
        return self._last[number] if 0 < number < len(self._last) else inf


@contextmanager
def _reported() -> Iterator[None]:
    """Files may vanish, or not be ours."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{error.filename or 'a shorter segment'}: {error.strerror}") from None


def _entries(path: Path) -> Iterator[tuple[Entry, int]]:
    """The entries of a whole segment, each with its bytes."""
    with path.open("rb") as stream:
        reader, before = JournalReader(stream, str(path)), 0
        for entry in reader:
            yield entry, reader.offset - before
            before = reader.offset


def _read(path: Path, lives: Lives) -> bool:
    """Take in a segment; whether all of it could be read: what is damaged is left as it is."""
    with path.open("rb") as stream, suppress(JournalDamaged):
        reader = JournalReader(stream, str(path))
        for entry in reader:
            lives.apply(entry)
        return not (reader.holes or reader.unknown or reader.torn)
    return False


def _clock_of(path: Path) -> float | None:
    """The time of central's clock at which a segment of inputs begins; None for any other file."""
    if path.suffix != INPUT_SUFFIX:
        return None
    with (
        suppress(OSError, msgspec.MsgspecError, LookupError, TypeError, ValueError),
        path.open("rb") as stream,
    ):
        for _, head in payloads(stream):
            return float(msgspec.msgpack.decode(head)[_CLOCK])
    # One that says nothing: nothing is known to be older. Central may just have removed it.
    return 0.0 if path.exists() else None


def _replace(path: Path, data: bytes) -> None:
    """Write a segment anew, all or nothing. It stays its owner's: root may prune for a central of
    another user. Raises OSError, and leaves nothing on a full disk.
    """
    there = path.stat()
    with TemporaryDirectory(dir=path.parent) as place:
        draft = Path(place) / path.name
        with draft.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.chown(draft, there.st_uid, there.st_gid)
        draft.chmod(there.st_mode)
        draft.rename(path)
