"""Remove ended tasks and messages from the journal of a run that continues.

A fact is removed when all tasks and messages that it is about ended before a given time of the
run's clock. A task that stays keeps its ancestors, so every tree still has its root. Whole segments
are rewritten, with two exceptions. Central writes the newest segment. A recovery compares the
segments that are newer than the oldest stored input with the inputs.
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
from tca_tools.journal.segments import INPUT_SUFFIX
from tca_wire.errors import JournalDamaged
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, Fact, Shortened
from tca_wire.journal.frames import payloads
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader, record
from tca_wire.points import END_ACHIEVING

_CLOCK = 7
"""The index of central's clock in the first frame of a segment of inputs."""

_INSTANTANEOUS = facts.RequestRefused, facts.Ignored, facts.MonitorTested
"""Facts about something that ends with their entry."""

_ENDINGS = (
    facts.Returned,
    facts.Answered,
    facts.Dropped,
    facts.Unqueued,
    facts.Failed,
    facts.ClaimEnded,
)
"""Facts that end a message, its delivery to one receiver, or a claim.

A task ends when END_ACHIEVING is reached.
"""


class Lives:
    """The end and the parent of each task, message and claim of a run, by its number."""

    def __init__(self) -> None:
        self.ended = array("d")  #: infinite while it lives
        self.parent = array("q")
        self.time = 0.0  #: of the last entry
        #: The ends of the waits that are for no known task, by key; the last stands for the open
        #: wait.
        self.waits = defaultdict[Any, Any](lambda: array("d", [inf]))
        self._is_task = bytearray()
        self._retained: set[int] = set()

    def apply(self, entry: Entry) -> None:
        """Process an entry's facts."""
        self.time = entry.time
        for fact in entry.facts:
            match fact:
                case facts.Received() | facts.Queued() | facts.Delivered() | facts.Claimed():
                    self._apply_start(fact)
                case facts.Reached() if fact.moments & END_ACHIEVING:
                    self._set_end(fact.task)
                case facts.WaitEnded() if not fact.task:
                    self.waits[fact.key].insert(-1, self.time)
                case facts.Kept():
                    self._retained.add(fact.task)
                case facts.Released() if not fact.module:
                    self._retained.discard(fact.task)
                case _ if isinstance(fact, _ENDINGS) and not getattr(fact, "is_beside", False):
                    self._apply_end(fact.id)

    def _apply_start(
        self, fact: facts.Received | facts.Queued | facts.Delivered | facts.Claimed
    ) -> None:
        if isinstance(fact, facts.Claimed):
            self._set_start(fact.id, fact.origin)
        elif not isinstance(fact, facts.Received):
            self._set_start(fact.id, 0 if fact.id == fact.message_id else fact.message_id)
        else:
            self._set_start(fact.id, fact.parent, is_task=fact.message_class.is_task)
            if fact.message_class.fans_out and not fact.message_class.has_reply:
                self._set_end(fact.id)  # each copy has its own end

    def _apply_end(self, number: int) -> None:
        if not self._has(number) or not self._is_task[number]:
            self._set_end(number)

    def _has(self, number: int) -> bool:
        return 0 < number < len(self.ended)

    def _set_start(self, number: int, parent: int, *, is_task: bool = False) -> None:
        if not 0 < number < 1 << 40:
            return
        missing = number + 1 - len(self.ended)
        if missing > 0:
            self.ended.extend([inf] * missing)
            self.parent.extend([0] * missing)
            self._is_task.extend(bytes(missing))
        if not self._is_task[number]:  # a handling of a task ends with the task
            self.ended[number] = inf
        self.parent[number] = parent or self.parent[number]
        self._is_task[number] |= is_task

    def _set_end(self, number: int) -> None:
        self._set_start(number, 0)
        self.ended[number] = self.time

    def last(self) -> array:  # type: ignore[type-arg]  # array[float] is no class at run time
        """Return, by number, when a task and its descendants had ended; infinite if one lives."""
        last = self.ended[:]
        for number in self._retained:
            self._set_start(number, 0)
            last[number] = inf
        for number in range(len(last) - 1, 0, -1):  # descendants have higher numbers
            parent = self.parent[number]
            if self._has(parent):
                last[parent] = max(last[parent], last[number])
        return last


class EndedTasks:
    """The removable facts of one run that continues."""

    def __init__(self, files: list[Path]) -> None:
        """*files*: all of the run, its segments last. Raises ToolError if one is unreadable."""
        paths = [path for path in files if path.suffix == SEGMENT_SUFFIX]
        lives = Lives()
        safe = min((clock for path in files if (clock := _clock_of(path)) is not None), default=inf)
        #: The segments that may be rewritten, with the times of their last entries.
        self._segments: dict[Path, float] = {}
        with _as_tool_errors():
            self._size = sum(path.stat().st_size for path in files if path.exists())
            for path in paths:
                is_whole = _read(path, lives)
                if is_whole and path is not paths[-1] and lives.time < safe:
                    self._segments[path] = lives.time
        self._last, self._waits = lives.last(), lives.waits
        self._now = lives.time

    def until(self, keep: float | None, keep_bytes: float | None) -> float:
        """Return the time of the run's clock up to which ended tasks are to be removed.

        It is *keep* seconds before the last entry, or later if that leaves more than *keep_bytes*.
        Raises ToolError.
        """
        time: float = self._now - keep if keep is not None else 0.0
        if keep_bytes is None:
            return time
        ends = sorted(self._segments.values())
        sizes = [0.0] * (len(ends) + 1)
        with _as_tool_errors():
            for path in self._segments:
                for entry, size in _entries(path):
                    for fact in entry.facts:
                        sizes[bisect_left(ends, self._end_of(fact, entry.time))] += size / len(
                            entry.facts
                        )
        left = float(self._size)
        for end, ended in zip(ends, sizes, strict=False):
            if left <= keep_bytes:
                break
            left -= ended
            time = max(time, end)
        return time

    def remove(self, until: float, *, dry_run: bool = False) -> int:
        """Rewrite the segments without what ended by *until*.

        Returns the number of bytes removed. Raises ToolError.
        """
        removed, drafts = 0, dict[Path, bytes]()
        with _as_tool_errors():
            for number, path in enumerate(self._segments):
                entries = self._shorter(path, until, is_first=not number)
                data, before = b"".join(map(record, entries)), path.stat().st_size
                if not number or len(data) < before:
                    # the first segment, with the fact Shortened, is written before any shorter one
                    drafts[path] = data
                if len(data) < before:
                    removed += before - len(data)
                    for draft in () if dry_run else drafts.items():
                        _replace(*draft)
                    drafts.clear()
        return removed

    def _shorter(self, path: Path, until: float, *, is_first: bool) -> Iterator[Entry]:
        for place, (entry, _) in enumerate(_entries(path)):
            left = [fact for fact in entry.facts if self._end_of(fact, entry.time) > until]
            if is_first and not place:
                earlier = [fact.until for fact in left if isinstance(fact, Shortened)]
                left = [fact for fact in left if not isinstance(fact, Shortened)]
                left.insert(1, Shortened(max([until, *earlier])))
            if left:
                yield Entry(entry.number, entry.time, left, entry.cause)

    def _end_of(self, fact: Fact, time: float) -> float:
        """Return when everything that a fact is about had ended; infinite if the fact stays."""
        if isinstance(fact, _INSTANTANEOUS):
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
        """Return when a task or message and its descendants had ended; inf if it is not known."""
        return self._last[number] if 0 < number < len(self._last) else inf


@contextmanager
def _as_tool_errors() -> Iterator[None]:
    """A context that turns errors of files into ToolError."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{error.filename or 'a shorter segment'}: {error.strerror}") from None


def _entries(path: Path) -> Iterator[tuple[Entry, int]]:
    """Yield the entries of an undamaged segment, each with its size in bytes."""
    with path.open("rb") as stream:
        reader, before = JournalReader(stream, str(path)), 0
        for entry in reader:
            yield entry, reader.offset - before
            before = reader.offset


def _read(path: Path, lives: Lives) -> bool:
    """Process a segment. Return whether it is undamaged: only such a segment is rewritten."""
    with path.open("rb") as stream, suppress(JournalDamaged):
        reader = JournalReader(stream, str(path))
        for entry in reader:
            lives.apply(entry)
        return not (reader.holes or reader.unknown or reader.torn)
    return False


def _clock_of(path: Path) -> float | None:
    """Return the time of central's clock at which a file of inputs starts; None for other files."""
    if path.suffix != INPUT_SUFFIX:
        return None
    with (
        suppress(OSError, msgspec.MsgspecError, LookupError, TypeError, ValueError),
        path.open("rb") as stream,
    ):
        for _, head in payloads(stream):
            return float(msgspec.msgpack.decode(head)[_CLOCK])
    # an unreadable file may hold the oldest inputs, unless central has just removed it
    return 0.0 if path.exists() else None


def _replace(path: Path, data: bytes) -> None:
    """Replace a segment atomically, with the same owner: root may prune for another user.

    Raises OSError, and leaves no draft on a full disk.
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
