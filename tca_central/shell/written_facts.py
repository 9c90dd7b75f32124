"""The facts in a run's journal, compared with the facts to which its inputs lead."""

import contextlib
from collections.abc import Generator, Iterator
from pathlib import Path

from tca_central.errors import CentralError
from tca_central.shell.log_writer import (
    cut,
    files_of,
    has_no_record,
    move_aside,
    move_file_aside,
    sync_path,
)
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import Closed, Entry, Opened
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader

_ADVICE = (
    "A tca of another version may have written it, or a power cut may have lost the last inputs. "
    "--resume facts continues from the inputs and moves the rest of the journal aside; "
    "--fresh starts a new run"
)


class Difference(CentralError):
    """The error that the journal differs from the facts to which the inputs lead."""

    def __init__(self, path: Path, offset: int, written: Entry, given: Entry | None) -> None:
        if given is None or written.number < given.number:
            what = f"it has entry {written.number}, to which no input leads"
        elif written.number > given.number:
            what = f"it lacks entry {given.number}"
        else:
            what = f"entry {given.number} has other facts"
        super().__init__(
            f"{path}, byte {offset}: the journal does not match the inputs: {what}. {_ADVICE}"
        )
        self.path, self.offset = path, offset
        #: At the first difference: the journal's entry, and the replay's (None: it has no more).
        self.written, self.given = written, given


class WrittenFacts:
    """The entries of one run's journal after the entry number *after*, in order."""

    def __init__(self, folder: Path, epoch: str, after: int) -> None:
        self.opened: Opened | None = None  #: the head of its newest segment
        self.last = Entry(0, 0.0, [])  #: the last entry
        self.compared = 0  #: the number of equal entries
        self.aside = 0  #: the number of entries moved aside
        self._folder, self._after = folder, after
        self._next_at = (folder, 0)  #: the file and offset of ``_next``
        self._has_holes = False  #: whether bytes were damaged, so that entries may be missing
        self._paths = self._segments(epoch)
        self._end = 0  #: the offset after the last entry
        self._entries = self._read()
        self._next = next(self._entries, None)  #: the first entry that is not compared yet

    def compare(self, given: Iterator[Entry], missing: list[Entry]) -> Difference | None:
        """Return the first difference between the journal and *given*; None: all are equal.

        *given* are the entries to which the inputs lead. Append to *missing* the entries that the
        journal lacks at its end, and the given entry at a difference.
        """
        for entry in given:
            if self._next is None:
                missing.append(entry)
                continue
            written_at, written, before = self._next_at, self._next, self.last
            if written.number == entry.number:
                written = self._read_whole()
                if written == entry:
                    self.compared += 1
                    continue
            elif written.number > entry.number and self._has_holes:
                continue  # the entry was in damaged bytes
            missing.append(entry)
            self.last = before
            return Difference(*written_at, written, entry)
        return Difference(*self._next_at, self._next, None) if self._next is not None else None

    def read_all(self) -> int:
        """Read all entries that are left. Return the number of the last one; 0: there are none."""
        number = 0
        while self._next is not None:
            number = self._next.number
            self._read_whole()
        return number

    def _read_whole(self) -> Entry:
        """Return the next entry. If it was too big for one record, join its parts."""
        assert self._next is not None
        whole = Entry(self._next.number, self._next.time, [], self._next.cause)
        while self._next is not None and self._next.number == whole.number:
            whole.facts.extend(self._next.facts)
            self.last, self._next = self._next, next(self._entries, None)
        return whole

    def move_aside(self, difference: Difference) -> None:
        """Cut the journal at a difference, and move the rest to files beside it."""
        path, after = difference.path, self._paths.index(difference.path) + 1
        self.aside += 1 + sum(1 for _ in self._entries)
        move_aside(path, difference.offset, *self._paths[after:])
        self.opened = _head_of(path)[0] or self.opened
        self._next, self._end, self._paths = None, difference.offset, self._paths[:after]

    def move_all_aside(self) -> None:
        """Move all segments to files beside them. Raises OSError."""
        self._entries.close()
        for path in self._paths:
            move_file_aside(path)

    def cut_journal(self) -> None:
        """Cut a partial record at the end, because another segment follows. Raises OSError."""
        for path in files_of(self._folder, SEGMENT_SUFFIX):
            if (not self._paths or path > self._paths[-1]) and has_no_record(path):
                path.unlink()
        sync_path(self._folder)
        for path in self._paths:
            # A replay from a later image does not lead to these facts again.
            sync_path(path)
        if self._paths:
            cut(self._paths[-1], self._end)

    # --- reading ----------------------------------------------------------------------------------

    def _segments(self, epoch: str) -> list[Path]:
        """Return the run's segments, from the one that contains the entry number ``_after``."""
        found: list[Path] = []
        for path in reversed(files_of(self._folder, SEGMENT_SUFFIX)):
            opened, entry_before = _head_of(path)
            if opened is None:
                if not has_no_record(path):  # else central ended while creating it
                    self._has_holes = True
                    found.append(path)
                continue
            if opened.epoch != epoch:
                break
            self.opened = self.opened or opened
            found.append(path)
            if entry_before <= self._after:
                break
        return found[::-1] if self.opened is not None else []

    def _read(self) -> Generator[Entry, None, None]:
        """Yield the entries after ``_after``, without heads of segments, which have no cause."""
        for path in self._paths:
            with path.open("rb") as stream:
                reader = JournalReader(stream, str(path))
                try:
                    for entry in reader:
                        self._has_holes = self._has_holes or bool(reader.holes)
                        if entry.cause is not None and entry.number > self._after:
                            self._next_at = (path, reader.offset)
                            yield entry
                        else:
                            self.last = entry
                except JournalDamaged:
                    self._has_holes = True
                self._end = reader.offset


def _head_of(path: Path) -> tuple[Opened | None, int]:
    """Return the first fact of a segment, and the number of the last entry before the segment."""
    with path.open("rb") as stream:
        try:
            entry = next(iter(JournalReader(stream, str(path))), None)
        except JournalDamaged:
            return None, 0
    if entry is None or not entry.facts or not isinstance(entry.facts[0], Opened):
        return None, 0
    return entry.facts[0], entry.number


def newest_segment(folder: Path) -> tuple[Path, str] | None:
    """Return the newest segment with a readable head, and the epoch of its run."""
    paths = reversed(files_of(folder, SEGMENT_SUFFIX))
    return next(
        ((path, opened.epoch) for path in paths if (opened := _head_of(path)[0]) is not None),
        None,
    )


def is_closed(path: Path) -> bool:
    """Whether a run has ended regularly, by its newest segment."""
    entry = None
    with path.open("rb") as stream, contextlib.suppress(JournalDamaged):
        for entry in JournalReader(stream, str(path)):  # noqa: B007 - the last one is wanted
            pass
    return entry is not None and any(isinstance(fact, Closed) for fact in entry.facts)
