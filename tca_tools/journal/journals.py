"""Find, open and read the journals of runs: the files, not the meaning of their facts."""

import fcntl
import os
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import click

from tca_tools.errors import DamagedLog, UnusableLog
from tca_tools.journal.segments import Folder, listed, segments_in
from tca_wire.endpoint import (
    VARIABLE,
    BadAddresses,
    addresses_in,
    by_number,
    default_journals,
    journal_link,
)
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import JOURNAL_VERSION, Closed, Entry, Opened, Shortened
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader
from tca_wire.text.printable import printable

_POLL_SECONDS = 0.2
_LAST_BYTES = 1 << 16
"""The size of the end of a segment in which the last entry is searched."""
_TORN_SECONDS = 1.0
"""After this time without growth, an incomplete entry is no longer being written."""
_WAITING = "'tca view' and 'tca log show --follow' wait for the first entry"
_UNCERTAIN = "tasks that seem to be running since then may have ended"


def newest_journal() -> Path:
    """Return the journal of the newest run.

    If ``$TCA_CENTRAL`` is set, return the journal of the central that it names. If it names several
    addresses, return the journal of the central that leads, or was the last one to lead.

    Raises:
        UnusableLog: There is no such journal.
    """
    if named := os.environ.get(VARIABLE):
        try:
            links = [journal_link(address) for address in addresses_in(named)]
        except BadAddresses as error:
            raise UnusableLog(f"${VARIABLE}: {error}") from None
        if found := [link for link in links if link.is_dir() and segments_in(link)]:
            return max(found, key=_last_to_lead).resolve()
        raise UnusableLog(
            f"no journal of the central at {named} (${VARIABLE}) on this computer: "
            "name one as LOG, or start 'tca central' there first"
        )
    if newest := next(run_folders(), None):
        return newest.resolve()  # the link itself is replaced when central starts again there
    raise UnusableLog(
        f"no journal below {default_journals()}: name one as LOG, or start 'tca central' first"
    )


def _last_to_lead(link: Path) -> tuple[bool, float]:
    """Return a key by which to compare the links of centrals that lead in turn.

    A central makes its link when it begins to lead. A clock that has jumped does not matter while a
    central runs.
    """
    return Log(link).is_being_written, link.lstat().st_mtime


def open_log(path: Path | None, epoch: str | None = None) -> "Log":
    """Open a journal.

    Args:
        path: A journal folder or segment, or "FOLDER#2" for the second oldest run in a folder;
            None for the newest journal.
        epoch: The epoch of the run in a folder; None for the run that started last.

    Raises:
        UnusableLog: There is no journal to read.
    """
    path = path or newest_journal()
    try:
        if epoch is None and (named := _run_in(path)):
            path, epoch = named
        return Log(_checked(path), epoch)
    except OSError as error:
        raise UnusableLog(f"{path}: can't be read: {error.strerror}") from None


def _run_in(path: Path) -> tuple[Path, str] | None:
    """Return the folder and epoch that "FOLDER#2" names; None for any other path."""
    before, separator, wanted = path.name.rpartition("#")
    folder = path.with_name(before) if before else path.parent
    if not separator or path.exists() or not folder.is_dir():
        return None
    epochs = [opened.epoch for opened in Folder(folder).epochs()]
    by_number = {str(number): epoch for number, epoch in enumerate(epochs, 1)}
    found = wanted if wanted in epochs else by_number.get(wanted)
    if found is None:
        there = f"of the {len(epochs)} there" if len(epochs) > 1 else "there"
        raise UnusableLog(
            f"{folder}: no run '{wanted}' {there}: 'tca log runs {folder}' lists them"
        )
    return folder, found


def title_of(journal: Path) -> str:
    """Return the title of a journal's folder or file."""
    path = journal.resolve()
    return f"{path.parent.name}/{path.name}" if path.name == "journal" else path.name


def runs_in(folder: Path) -> Iterator[tuple[str, Opened, "Log"]]:
    """Yield the runs in a folder, oldest first: the name to use as LOG, the first fact, the log.

    Raises:
        UnusableLog: The folder can't be read.
    """
    epochs = Folder(folder).epochs()
    for number, opened in enumerate(epochs, 1):
        yield (
            f"{folder}#{number}" if len(epochs) > 1 else str(folder),
            opened,
            Log(folder, opened.epoch),
        )


def run_folders() -> Iterator[Path]:
    """Yield the folders below central's folder of journals that contain runs, newest first."""
    folder = default_journals()
    for path in reversed(by_number(listed(folder) if folder.is_dir() else [])):
        if path.is_dir() and segments_in(path):
            yield path


class Losses:
    """Counts of what could not be read: damaged entries, unknown facts, unreadable ends of
    segments.
    """

    def __init__(self) -> None:
        self.entries = 0
        """The number of damaged entries; a lower bound if ``_is_counted`` is False."""
        self.facts = 0
        """The number of invalid facts and of facts that this version does not know."""
        self.ends: list[str] = []
        """For each segment whose end could not be read although another follows: the reason."""
        self._is_counted = True
        self._first_entry = self._first_fact = ""
        """The places of the first damaged entry and unknown fact, with the time before each."""
        self._later = ""
        """The remark on the first segment of a later version."""

    def add(
        self, reader: JournalReader, segment: Path, holes: int, unknown: int, time: float
    ) -> None:
        """Add the damaged places and unknown facts that a reader has passed since the last call.

        Args:
            reader: The reader of the segment.
            segment: The segment's file.
            holes: The number of damaged places added before.
            unknown: The number of unknown facts added before.
            time: The time of the last good entry.
        """
        if new := reader.holes[holes:]:
            self.entries += len(new)
            self._is_counted = self._is_counted and reader.is_counted
            self._first_entry = self._first_entry or f"{segment}, byte {new[0]}, after {time:.3f} s"
        if reader.unknown > unknown:
            self.facts += reader.unknown - unknown
            self._first_fact = (
                self._first_fact or f"{segment}, byte {reader.offset}, after {time:.3f} s"
            )

    def check_version(self, reader: JournalReader, segment: Path) -> None:
        """Add a remark if a segment was written by a later version."""
        if reader.version > JOURNAL_VERSION and not self._later:
            self._later = (
                f"{segment}: written by a later version ({reader.version}; this one reads up to "
                f"{JOURNAL_VERSION}), so some facts may not be shown: upgrade tca"
            )

    @property
    def places(self) -> int:
        """The number of places after which the state of the run is uncertain."""
        return self.entries + len(self.ends)

    @property
    def lines(self) -> list[str]:
        """The losses in words, a line each."""
        entry, entries = "a damaged entry", f"{self.entries} damaged entries"
        if not self._is_counted:
            entry, entries = "at least one entry, damaged or missing,", f"at least {entries}"
        unknown = "that this version does not know"
        found = [
            self._later,
            _left_out(self._first_entry, self.entries, entry, entries),
            _left_out(
                self._first_fact, self.facts, f"a fact {unknown}", f"{self.facts} facts {unknown}"
            ),
        ]
        return [
            *filter(None, found),
            *(f"{end}; the rest of that file is left out" for end in self.ends),
        ]


def _left_out(first: str, number: int, one: str, several: str) -> str:
    if not number:
        return ""
    losses = f"{one} is left out" if number == 1 else f"{several} are left out, the first one here"
    return f"{first}: {losses}: {_UNCERTAIN}"


class EntryPlace(NamedTuple):
    """The place of an entry: a segment and an offset in bytes."""

    segment: Path
    offset: int


def _sleep() -> None:
    time.sleep(_POLL_SECONDS)


class Log:
    """One journal: a folder of segments, or one segment.

    If a folder contains several runs, the journal is that of the run that started last. If a file
    contains several runs one after another, the journal is that of the first.

    Iterating skips damaged entries and unknown facts. It ends without an error where nothing more
    can be read, so that good entries can be shown; ``check`` then reports the error.
    """

    def __init__(self, path: Path, epoch: str | None = None) -> None:
        self.path = path
        self.losses = Losses()
        """The losses so far."""
        self.segment = path
        """The segment that is being followed, or was last."""
        self._damage = ""
        """Why the rest of the segment read last can't be read."""
        self.lost: EntryPlace | None = None
        """The end of entries that were read and have been removed since."""
        self._has_entries = False
        self._time = 0.0
        """The time of the last entry read."""
        self._torn: tuple[Path, int, int] | None = None
        """The incomplete entry at the end: its segment, its offset, its size in bytes."""
        self._torn_since = 0.0
        self._folder = Folder(path, epoch) if path.is_dir() else None
        self.epoch = epoch
        """The run of the folder that was requested (None: the newest there)."""
        self._number = (
            f"#{self._folder.number_of(epoch)}" if self._folder is not None and epoch else ""
        )
        self._printed: set[str] = set()
        self._opened: Opened | None = None
        self._shortened = ""
        """The remark that the start of the run was removed."""
        self._followed_by = ""
        """The remark that another run follows in the file."""

    @property
    def name(self) -> str:
        """The name of this journal in titles."""
        return title_of(self.path) + self._number

    @property
    def run(self) -> str | None:
        """The epoch of the run in a folder; None while it is not known, and for a file."""
        return self._folder.epoch if self._folder is not None else None

    def segments(self) -> list[Path]:
        """Return the current segments, oldest first."""
        return self._folder.segments() if self._folder is not None else [self.path]

    def __iter__(self) -> Iterator[Entry]:
        """Yield the entries of all segments. Raises UnusableLog if all are empty."""
        for segment in self.segments():
            self._start_next_segment()
            with self._store_error(), segment.open("rb") as stream:
                reader = JournalReader(stream, str(segment))
                yield from self._entries_of(reader, segment)
                self._check_end(segment, reader)
        self._check_entries()
        if not self._has_entries:
            raise UnusableLog(
                f"{self.path}: empty, central has written nothing to it yet: {_WAITING}"
            )

    def follow(self, wait: Callable[[], object] = _sleep) -> Iterator[Entry]:
        """Yield the entries, then new ones as they arrive; ends only at damage.

        Args:
            wait: Called before each check for new entries; the default sleeps for 0.2 seconds.
        """
        return (entry for entry, _ in self.follow_places(wait))

    def follow_places(
        self, wait: Callable[[], object] = _sleep
    ) -> Iterator[tuple[Entry, EntryPlace]]:
        """Yield the entries as ``follow`` does, each with its place."""
        followed: set[Path] = set()
        while not (self._followed_by and self._folder is None):
            segment = self._next_segment(followed)
            if segment is not None:
                self._start_next_segment()
                yield from self._follow_segment(segment, wait)
                followed.add(segment)
            elif self._damage:
                break
            else:
                wait()
        self._check_entries()

    def _next_segment(self, followed: set[Path]) -> Path | None:
        """Return the first segment not yet followed; None if there is none."""
        try:
            return next((one for one in self.segments() if one not in followed), None)
        except UnusableLog:
            if self._damage:  # the better explanation
                return None
            raise

    @property
    def is_empty(self) -> bool:
        """Whether all its segments are empty."""
        return not any(segment.stat().st_size for segment in self.segments())

    def check_beginning(self) -> None:
        """Raise UnusableLog if this is not a journal; an empty file may become one."""
        objections = [_why_not_journal(segment) for segment in self.segments()]
        if objections and all(objections):
            raise UnusableLog(objections[0])

    @property
    def is_cut_short(self) -> bool:
        """Whether the end of the journal can't be read."""
        return bool(self._damage or self.cut)

    @property
    def is_being_written(self) -> bool:
        """Whether a central on this machine has the journal open: the run is live."""
        try:
            with self.segments()[-1].open("rb") as stream:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except (OSError, IndexError, UnusableLog):  # the journal was removed
            pass
        return False

    def present(self, last: float) -> float | None:
        """Return the present on the run's clock; None if the run is over.

        The result is *last* plus the time since the journal was last written. This does not use
        the wall-clock time of the run's start: a robot may set its clock late.

        Args:
            last: The time of the journal's last entry, on the run's clock.
        """
        if self._damage or not self.is_being_written:
            return None
        try:
            silence = time.time() - self.segments()[-1].stat().st_mtime
        except (OSError, IndexError, UnusableLog):
            return None
        # central has been running for no longer than the machine
        return last + min(max(silence, 0.0), time.monotonic())

    @property
    def cut(self) -> str:
        """The remark on an incomplete last entry that central is not writing at the moment."""
        is_fresh = time.monotonic() - self._torn_since < _TORN_SECONDS
        if not self._torn or (is_fresh and self.is_being_written):
            return ""
        return _cut_off(*self._torn)

    @property
    def remarks(self) -> list[str]:
        """Remarks, a line each: other runs, missing segments, losses, removed or later parts."""
        also = filter(None, [self._shortened, self._followed_by])
        return [*self._folder_remarks(), *self.losses.lines, *also]

    def _folder_remarks(self, *, of_missing: bool = True) -> list[str]:
        folder = self._folder
        return [] if folder is None else [*folder.others, *(folder.missing if of_missing else ())]

    def print_remarks(self, *, of_missing: bool = True) -> None:
        """Print the remarks on the folder to standard error, each only once.

        Args:
            of_missing: Whether to print remarks on missing segments, too.
        """
        for remark in self._folder_remarks(of_missing=of_missing):
            self._print(remark)

    def check(self, *, of_missing: bool = True) -> None:
        """Print the remarks to standard error, and raise an error if entries were lost.

        A journal that is only cut off at the end, as after a power cut, is no error: a remark says
        so.

        Args:
            of_missing: Whether to print remarks on missing segments, too.

        Raises:
            DamagedLog: Reading stopped early or skipped something; the message says where and why.
        """
        self.print_remarks(of_missing=of_missing)
        for remark in filter(None, [self._shortened, self._followed_by]):
            self._print(remark)
        also = "; ".join(self.losses.lines)
        if self._damage:
            shown = "entries read earlier" if self.lost else "the entries before it"
            raise DamagedLog(f"{self._damage}; {shown} are shown" + (f" ({also})" if also else ""))
        if also:
            raise DamagedLog(also)
        if cut := self.cut:
            self._print(f"{cut}; the entries before it are shown")

    def _print(self, line: str) -> None:
        if line not in self._printed:
            self._printed.add(line)
            click.echo(f"tca: {printable(line)}", err=True)

    def _follow_segment(
        self, segment: Path, wait: Callable[[], object]
    ) -> Iterator[tuple[Entry, EntryPlace]]:
        self.segment = segment
        with self._store_error(), segment.open("rb") as stream:
            reader = JournalReader(stream, str(segment))
            while True:
                # Check this before reading: a segment does not grow once another follows it
                is_last = self.segments()[-1:] == [segment]
                for entry in self._entries_of(reader, segment):
                    yield entry, EntryPlace(segment, reader.offset)
                self._check_end(segment, reader)
                self._check_is_whole(segment, reader)
                if not is_last or self._followed_by:
                    return
                wait()

    def _check_is_whole(self, segment: Path, reader: JournalReader) -> None:
        """Raise JournalDamaged if a followed segment was removed or is shorter than before."""
        if not segment.exists():
            self.lost = EntryPlace(segment, 0)  # another segment may get its name
            raise JournalDamaged(f"{segment}: has been removed")
        if reader.torn < 0:
            self.lost = EntryPlace(segment, reader.offset)
            raise JournalDamaged(
                f"{segment}: {-reader.torn} bytes that were read have been cut off"
            )

    def _check_end(self, segment: Path, reader: JournalReader) -> None:
        """Store an incomplete entry at the end, and since when it has been incomplete."""
        torn = (segment, reader.offset, reader.torn) if reader.torn else None
        if torn != self._torn:
            self._torn, self._torn_since = torn, time.monotonic()

    def _entries_of(self, reader: JournalReader, segment: Path) -> Iterator[Entry]:
        """Yield the entries of a segment until another run, or the same one again, starts in it."""
        holes, unknown = len(reader.holes), reader.unknown
        try:
            for entry in reader:
                if len(reader.holes) > holes or reader.unknown > unknown:
                    self.losses.add(reader, segment, holes, unknown, self._time)
                    holes, unknown = len(reader.holes), reader.unknown
                self._time = entry.time
                for fact in entry.facts[:1]:
                    if type(fact) is Opened and self._starts_another(fact, reader, segment):
                        return
                for fact in entry.facts[1:2]:
                    if type(fact) is Shortened:
                        until = f"{fact.until:.0f} s"
                        self._shortened = (
                            f"{self.path}: what had ended by {until} was removed ('tca log prune')"
                        )
                if not self._has_entries or not reader.offset:
                    self._has_entries = True
                    self.losses.check_version(reader, segment)
                yield entry
        finally:  # there may be losses after the last entry
            self.losses.add(reader, segment, holes, unknown, self._time)

    def _starts_another(self, opened: Opened, reader: JournalReader, segment: Path) -> bool:
        """Whether another run, or a segment out of order, starts in the middle of the file."""
        last = self._opened if reader.offset else None
        if last is None or (opened.epoch == last.epoch and opened.segment > last.segment):
            self._opened = opened
            return False
        is_other_run = opened.epoch != last.epoch
        start = "another run" if is_other_run else f"segment {opened.segment} of this run, again,"
        self._followed_by = (
            f"{segment}, byte {reader.offset}: {start} starts here; only the entries before it are "
            f"shown: to see the rest, extract it with 'tail -c +{reader.offset + 1}'"
        )
        return True

    @contextmanager
    def _store_error(self) -> Iterator[None]:
        """Store an error of reading for ``check`` to report."""
        try:
            yield
        except JournalDamaged as error:
            self._damage = str(error)
        except OSError as error:
            self._damage = f"{error.filename or self.path}: can't be read: {error.strerror}"

    def _start_next_segment(self) -> None:
        """Count the unreadable end of the last segment as a loss, as another segment follows."""
        if self._torn:
            self.losses.ends.append(_cut_off(*self._torn))
        if self._damage:
            self.losses.ends.append(self._damage)
        self._damage, self._torn, self.lost = "", None, None

    def _check_entries(self) -> None:
        """Raise UnusableLog if reading failed, and nothing was read."""
        if self._damage and not self._has_entries:
            raise UnusableLog((*self.losses.ends, self._damage)[0])


def is_closed(segment: Path) -> bool:
    """Whether a segment ends with the fact that central closed the run."""
    try:
        with segment.open("rb") as stream:
            last = deque(
                JournalReader(stream, offset=max(segment.stat().st_size - _LAST_BYTES, 0)), 1
            )
    except (OSError, JournalDamaged):
        return False
    return any(type(fact) is Closed for entry in last for fact in entry.facts)


def _cut_off(segment: Path, offset: int, torn: int) -> str:
    return f"{segment}, byte {offset}: cut off: the last {torn} bytes are not a complete entry"


def _why_not_journal(segment: Path) -> str:
    """Return why a file is not a journal; "" if it is one, or is empty and may become one."""
    try:
        with segment.open("rb") as stream:
            next(iter(JournalReader(stream, str(segment))), None)
    except JournalDamaged as error:
        return str(error)
    except OSError as error:
        return f"{segment}: can't be read: {error.strerror}"
    return ""


def _checked(path: Path) -> Path:
    if path.is_dir():
        if not segments_in(path):
            below = max(path.glob(f"*/*{SEGMENT_SUFFIX}"), default=None)
            example = f", such as {below.parent}" if below else ""
            raise UnusableLog(
                f"{path}: a directory without segments (*{SEGMENT_SUFFIX}): "
                f"name the journal of one run{example}"
            )
    elif not path.is_file():
        what = "neither a file nor a directory" if path.exists() else "no such file or directory"
        raise UnusableLog(f"{path}: {what}: name a journal directory or a segment")
    return path
