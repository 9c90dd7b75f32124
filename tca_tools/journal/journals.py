"""Finds, opens and reads the journals of runs. Knows files; knows nothing of what the facts
mean.
"""

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
from tca_wire.endpoint import VARIABLE, by_number, default_journals, journal_link
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import JOURNAL_VERSION, Closed, Entry, Opened, Shortened
from tca_wire.journal.records import SEGMENT_SUFFIX, JournalReader
from tca_wire.text.printable import printable

_POLL_SECONDS = 0.2
_LAST_BYTES = 1 << 16
"""The end of a segment, in which the last entry is."""
_STILL = 1.0
"""Seconds: what is not whole for so long nobody is writing any more."""
_WAITING = "'tca view' and 'tca log show --follow' wait for what comes"
_SINCE = "what seems to go on since then may have ended"


def newest_journal() -> Path:
    """The journal of the last run; where ``$TCA_CENTRAL`` names a central, of that one's. Raises
    UnusableLog if there is none.
    """
    if address := os.environ.get(VARIABLE):
        if (link := journal_link(address)).is_dir() and segments_in(link):
            return link.resolve()
        msg = (
            f"no journal of the central at {address} (${VARIABLE}) on this computer: name one as LOG, or start 'tca \
central' there first"
        )
        raise UnusableLog(msg)
    if newest := next(run_folders(), None):
        return newest.resolve()  # a link goes when central is started anew there
    raise UnusableLog(
        f"no journal below {default_journals()}: name one as LOG, or start 'tca central' first"
    )


def open_log(path: Path | None, epoch: str | None = None) -> "Log":
    """The journal at *path*, or the newest one; of a folder with several runs that of an epoch or,
    as in "FOLDER#2", of a number (the oldest is 1), else the one that began last. Raises
    UnusableLog if there is none to read.
    """
    path = path or newest_journal()
    try:
        if epoch is None and (named := _run_in(path)):
            path, epoch = named
        return Log(_checked(path), epoch)
    except OSError as error:
        raise UnusableLog(f"{path}: can't be read: {error.strerror}") from None


def _run_in(path: Path) -> tuple[Path, str] | None:
    """The folder and epoch that "FOLDER#2" names; None if it is no such name."""
    before, is_one, wanted = path.name.rpartition("#")
    folder = path.with_name(before) if before else path.parent
    if not is_one or path.exists() or not folder.is_dir():
        return None
    epochs = [one.epoch for one in Folder(folder).epochs()]
    by_number = {str(number): one for number, one in enumerate(epochs, 1)}
    found = wanted if wanted in epochs else by_number.get(wanted)
    if found is None:
        there = f"of the {len(epochs)} there" if len(epochs) > 1 else "there"
        raise UnusableLog(
            f"{folder}: no run '{wanted}' {there}: 'tca log runs {folder}' lists them"
        )
    return folder, found


def called(journal: Path) -> str:
    """The title of a folder of journals, or of a file of one."""
    path = journal.resolve()
    return f"{path.parent.name}/{path.name}" if path.name == "journal" else path.name


def runs_in(folder: Path) -> Iterator[tuple[str, Opened, "Log"]]:
    """The runs that lie in a folder, oldest first, each with how it is named as LOG, and how it
    begins. Raises UnusableLog if it can't be read.
    """
    epochs = Folder(folder).epochs()
    for number, opened in enumerate(epochs, 1):
        yield (
            f"{folder}#{number}" if len(epochs) > 1 else str(folder),
            opened,
            Log(folder, opened.epoch),
        )


def run_folders() -> Iterator[Path]:
    """The folders in central's folder of journals in which runs lie, the one that began last
    first.
    """
    folder = default_journals()
    for path in reversed(by_number(listed(folder) if folder.is_dir() else [])):
        if path.is_dir() and segments_in(path):
            yield path


class Losses:
    """The losses, counted: damaged entries, facts that this version does not know, the ends of
    segments.
    """

    def __init__(self) -> None:
        self.entries = 0
        """Damaged ones; where not all can be told apart, there were more."""
        self.facts = 0
        """Those that this version does not know, or that are none."""
        self.ends: list[str] = []
        """Why no more could be read of a segment, where others follow."""
        self._is_counted = True
        self._first_entry = self._first_fact = ""
        """Where the first of them stands, and after what time."""
        self._later = ""
        """The first segment of a later version, and which."""

    def note(
        self, reader: JournalReader, segment: Path, holes: int, unknown: int, time: float
    ) -> None:
        """A reader has passed over more than so many *holes* and *unknown* facts, behind what was
        written at *time*.
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

    def note_version(self, reader: JournalReader, segment: Path) -> None:
        """A segment begins."""
        if reader.version > JOURNAL_VERSION and not self._later:
            which = f"{reader.version}; this one reads up to {JOURNAL_VERSION}"
            self._later = f"{segment}: written by a later version ({which}), in which more may have happened: upgrade tca"

    @property
    def places(self) -> int:
        """How often something was lost behind which nothing is sure."""
        return self.entries + len(self.ends)

    @property
    def lines(self) -> list[str]:
        """All of it in words."""
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
            *(f"{end}; what comes behind it in that file is left out" for end in self.ends),
        ]


def _left_out(first: str, number: int, one: str, several: str) -> str:
    if not number:
        return ""
    what = (
        f"{one} is left out" if number == 1 else f"{several} are left out, the first of them here"
    )
    return f"{first}: {what}: {_SINCE}"


class EntryPlace(NamedTuple):
    """Where an entry stands: a segment, and a byte of it."""

    segment: Path
    offset: int


class Log:
    """One journal: a directory of segments, or one segment. Of a directory with segments of several
    runs it is the run that began last; of a file in which one run follows another, the first.

    Iterating passes over what is damaged or not known to this version and ends quietly where
    nothing more can be read, so that what is good can be shown; ``check`` then tells of it.
    """

    def __init__(self, path: Path, epoch: str | None = None) -> None:
        self.path = path
        self.losses = Losses()
        """The losses until now."""
        self.segment = path
        """The segment that is being followed, or was last."""
        self._damage = ""
        """Why nothing more can be read of the segment that was read last."""
        self.lost: EntryPlace | None = None
        """The end of a part that was read and is not there any more."""
        self._has_entries = False
        self._time = 0.0
        """Of the last entry that was read."""
        self._torn: tuple[Path, int, int] | None = None
        self._torn_since = 0.0
        self._folder = Folder(path, epoch) if path.is_dir() else None
        self.epoch = epoch
        """Which run of the folder was asked for (None: the newest there)."""
        self._number = (
            f"#{self._folder.number_of(epoch)}" if self._folder is not None and epoch else ""
        )
        self._said: set[str] = set()
        self._opened: Opened | None = None
        self._shortened = ""
        """The end of what was removed from the run."""
        self._followed_by = ""
        """The start of the file's part behind the journal."""

    @property
    def name(self) -> str:
        """The name of this journal in titles."""
        return called(self.path) + self._number

    @property
    def run(self) -> str | None:
        """The epoch of the run that is read of a folder; None while it is not known, and of a
        file.
        """
        return self._folder.epoch if self._folder is not None else None

    def segments(self) -> list[Path]:
        """The segments there are now, oldest first."""
        return self._folder.segments() if self._folder is not None else [self.path]

    def __iter__(self) -> Iterator[Entry]:
        """The entries of all segments. Raises UnusableLog if there are none."""
        for segment in self.segments():
            self._leave_damage_behind()
            with self._excused(), segment.open("rb") as stream:
                reader = JournalReader(stream, str(segment))
                yield from self._counted(reader, segment)
                self._note_end(segment, reader)
        self._check_entries()
        if not self._has_entries:
            raise UnusableLog(
                f"{self.path}: empty, central has written nothing to it yet: {_WAITING}"
            )

    def follow(
        self, wait: Callable[[], object] = lambda: time.sleep(_POLL_SECONDS)
    ) -> Iterator[Entry]:
        """The entries there are and those that come, calling *wait* before looking again; ends only
        at damage.
        """
        return (entry for entry, _ in self.follow_places(wait))

    def follow_places(
        self, wait: Callable[[], object] = lambda: time.sleep(_POLL_SECONDS)
    ) -> Iterator[tuple[Entry, EntryPlace]]:
        """The entries as in *follow*, each with its place."""
        followed: set[Path] = set()
        while not (self._followed_by and self._folder is None):
            segment = self._next_to(followed)
            if segment is not None:
                self._leave_damage_behind()
                yield from self._follow_segment(segment, wait)
                followed.add(segment)
            elif self._damage:
                break
            else:
                wait()
        self._check_entries()

    def _next_to(self, followed: set[Path]) -> Path | None:
        """The first segment that is not among them; None if there is none yet."""
        try:
            return next((one for one in self.segments() if one not in followed), None)
        except UnusableLog:
            if self._damage:  # that says more
                return None
            raise

    @property
    def is_empty(self) -> bool:
        """Whether there is not a byte in it yet."""
        return not any(segment.stat().st_size for segment in self.segments())

    def check_beginning(self) -> None:
        """Raise UnusableLog if this is no journal; one that is empty may become one."""
        wrong = [_why_none(segment) for segment in self.segments()]
        if wrong and all(wrong):
            raise UnusableLog(wrong[0])

    @property
    def is_cut_short(self) -> bool:
        """Whether something is left at the end that can't be read."""
        return bool(self._damage or self.cut)

    @property
    def is_being_written(self) -> bool:
        """Whether a central on this machine has the journal open: its run goes on."""
        try:
            with self.segments()[-1].open("rb") as stream:
                fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except (OSError, IndexError, UnusableLog):  # it is gone
            pass
        return False

    def present(self, last: float) -> float | None:
        """The present on the run's clock, if its last entry was at *last* and more may come; None
        if it is over.

        It is reckoned from when the journal was last written to: a wall clock that was set since
        the run began, as on a robot that learns the time late, does little harm.
        """
        if self._damage or not self.is_being_written:
            return None
        try:
            silence = time.time() - self.segments()[-1].stat().st_mtime
        except (OSError, IndexError, UnusableLog):
            return None
        return last + min(
            max(silence, 0.0), time.monotonic()
        )  # its central has run since the machine was started

    @property
    def cut(self) -> str:
        """The remark on a last entry that is not whole, and that nobody is writing just now."""
        is_fresh = time.monotonic() - self._torn_since < _STILL
        if not self._torn or (is_fresh and self.is_being_written):
            return ""
        return _cut_off(*self._torn)

    @property
    def remarks(self) -> list[str]:
        """Remarks, a line each: other runs or missing segments in the folder, losses, and what
        follows in a file.
        """
        also = filter(None, [self._shortened, self._followed_by])
        return [*self._of_folder(), *self.losses.lines, *also]

    def _of_folder(self, *, of_missing: bool = True) -> list[str]:
        folder = self._folder
        return [] if folder is None else [*folder.others, *(folder.missing if of_missing else ())]

    def print_remarks(self, *, of_missing: bool = True) -> None:
        """Say on the standard error what there is to say of the folder (*of_missing*: of segments
        that are missing, too); nothing is said twice.
        """
        for remark in self._of_folder(of_missing=of_missing):
            self._say(remark)

    def check(self, *, of_missing: bool = True) -> None:
        """Raise DamagedLog if reading stopped early, with the one line that says where and why;
        ``print_remarks`` the rest.

        Of a journal that is cut only the end is missing, as after a power cut: a line on the
        standard error says so.
        """
        self.print_remarks(of_missing=of_missing)
        for remark in filter(None, [self._shortened, self._followed_by]):
            self._say(remark)
        also = "; ".join(self.losses.lines)
        if self._damage:
            shown = "what was read before" if self.lost else "what comes before it"
            raise DamagedLog(f"{self._damage}; {shown} is shown" + (f" ({also})" if also else ""))
        if also:
            raise DamagedLog(also)
        if cut := self.cut:
            self._say(f"{cut}; what comes before it is shown")

    def _say(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            click.echo(f"tca: {printable(line)}", err=True)

    def _follow_segment(
        self, segment: Path, wait: Callable[[], object]
    ) -> Iterator[tuple[Entry, EntryPlace]]:
        self.segment = segment
        with self._excused(), segment.open("rb") as stream:
            reader = JournalReader(stream, str(segment))
            while True:
                is_last = self.segments()[-1:] == [
                    segment
                ]  # asked first: after that nothing is added to it
                for entry in self._counted(reader, segment):
                    yield entry, EntryPlace(segment, reader.offset)
                self._note_end(segment, reader)
                self._check_is_whole(segment, reader)
                if not is_last or self._followed_by:
                    return
                wait()

    def _check_is_whole(self, segment: Path, reader: JournalReader) -> None:
        """Raise JournalDamaged if a segment that is followed is gone, or has lost something that
        was read.
        """
        if not segment.exists():
            self.lost = EntryPlace(segment, 0)  # another one may come in its place
            raise JournalDamaged(f"{segment}: has been removed")
        if reader.torn < 0:
            self.lost = EntryPlace(segment, reader.offset)
            raise JournalDamaged(
                f"{segment}: has become shorter than what was read of it, by {-reader.torn} bytes"
            )

    def _note_end(self, segment: Path, reader: JournalReader) -> None:
        torn = (segment, reader.offset, reader.torn) if reader.torn else None
        if torn != self._torn:
            self._torn, self._torn_since = torn, time.monotonic()

    def _counted(self, reader: JournalReader, segment: Path) -> Iterator[Entry]:
        """The entries of a segment, until another run, or the same anew, begins in it."""
        holes, unknown = len(reader.holes), reader.unknown
        try:
            for entry in reader:
                if len(reader.holes) > holes or reader.unknown > unknown:
                    self.losses.note(reader, segment, holes, unknown, self._time)
                    holes, unknown = len(reader.holes), reader.unknown
                self._time = entry.time
                facts = entry.facts
                if (
                    facts
                    and type(facts[0]) is Opened
                    and self._is_another(facts[0], reader, segment)
                ):
                    return
                if facts[1:] and type(facts[1]) is Shortened:
                    until = f"{facts[1].until:.0f} s"
                    self._shortened = (
                        f"{self.path}: what had ended by {until} was removed ('tca log prune')"
                    )
                if not self._has_entries or not reader.offset:
                    self._has_entries = True
                    self.losses.note_version(reader, segment)
                yield entry
        finally:  # something may be lost behind the last of them, too
            self.losses.note(reader, segment, holes, unknown, self._time)

    def _is_another(self, opened: Opened, reader: JournalReader, segment: Path) -> bool:
        """Whether, in the midst of a file, something begins that does not go on with what comes
        before it.
        """
        last = self._opened if reader.offset else None
        if last is None or (opened.epoch == last.epoch and opened.segment > last.segment):
            self._opened = opened
            return False
        what = (
            "another run"
            if opened.epoch != last.epoch
            else f"segment {opened.segment} of this run, once more,"
        )
        self._followed_by = (
            f"{segment}, byte {reader.offset}: {what} begins here; only what comes before it is shown: to see the rest,"
            f" take it out of the file ('tail -c +{reader.offset + 1}')"
        )
        return True

    @contextmanager
    def _excused(self) -> Iterator[None]:
        """Reading may fail; ``check`` tells of it."""
        try:
            yield
        except JournalDamaged as error:
            self._damage = str(error)
        except OSError as error:
            self._damage = f"{error.filename or self.path}: can't be read: {error.strerror}"

    def _leave_damage_behind(self) -> None:
        """There is another segment: go on there."""
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
    """Whether a segment ends with central's goodbye."""
    try:
        with segment.open("rb") as stream:
            last = deque(
                JournalReader(stream, offset=max(segment.stat().st_size - _LAST_BYTES, 0)), 1
            )
    except (OSError, JournalDamaged):
        return False
    return any(type(fact) is Closed for entry in last for fact in entry.facts)


def _cut_off(segment: Path, offset: int, torn: int) -> str:
    return f"{segment}, byte {offset}: cut off, the last {torn} bytes are no whole entry"


def _why_none(segment: Path) -> str:
    """Why a file is no journal; "" if it is one, or is empty and may become one."""
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
            one = f", such as {below.parent}" if below else ""
            raise UnusableLog(
                f"{path}: a directory without segments (*{SEGMENT_SUFFIX}): name the journal of one run{one}"
            )
    elif not path.exists():
        raise UnusableLog(
            f"{path}: there is no such file or directory: name a journal directory or a segment"
        )
    elif not path.is_file():
        raise UnusableLog(
            f"{path}: neither a file nor a directory: name a journal directory or a segment"
        )
    return path
