"""Finds, opens and reads the journals of runs. Knows files; knows nothing of what the facts mean."""

import fcntl
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import click

from tca_tools.errors import DamagedLog, UnusableLog
from tca_tools.segments import Folder, listed, segments_in
from tca_tools.terminal import printable
from tca_wire.endpoint import default_journals
from tca_wire.errors import JournalDamaged
from tca_wire.facts import Entry, Opened
from tca_wire.journal import SEGMENT_SUFFIX, JournalReader

_POLL_SECONDS = 0.2
_WAITING = "'tca view' and 'tca log show --follow' wait for what comes"


def newest_journal() -> Path:
    """The journal of the last run. Raises UnusableLog if there is none."""
    folder = default_journals()
    runs = listed(folder) if folder.is_dir() else []
    for run in reversed(runs):
        if run.is_dir() and segments_in(run):
            return run
    raise UnusableLog(f"no journal below {folder}: name one as LOG, or start 'tca central' first")


def open_log(path: Path | None, epoch: str | None = None) -> "Log":
    """The journal at *path*, or the newest one; of a folder with several runs that of an epoch, or the one that began
    last. Raises UnusableLog if there is none to read.
    """
    path = path or newest_journal()
    try:
        return Log(_checked(path), epoch)
    except OSError as error:
        raise UnusableLog(f"{path}: can't be read: {error.strerror}") from None


class Place(NamedTuple):
    """Where an entry stands: a segment, and a byte of it."""

    segment: Path
    offset: int


class Log:
    """One journal: a directory of segments, or one segment. Of a directory with segments of several runs it is the run
    that began last; of a file in which one run follows another, the first.

    Iterating passes over entries that are damaged and ends quietly where nothing more can be read, so that what is good
    can be shown; ``check`` then tells of it.
    """

    lost = 0
    """How many damaged entries were passed over."""

    def __init__(self, path: Path, epoch: str | None = None) -> None:
        self.path = path
        self._damage = ""
        self._has_entries = False
        self._first_lost = ""
        """Where the first of them is, and when it was written."""
        self._time = 0.0
        """Of the last entry that was read."""
        self._torn: tuple[Path, int, int] | None = None
        self._folder = Folder(path, epoch) if path.is_dir() else None
        self._said: set[str] = set()
        self._opened: Opened | None = None
        self._followed_by = ""
        """What begins in a file behind what is read of it."""

    @property
    def name(self) -> str:
        """What a title calls this journal."""
        path = self.path.resolve()
        return f"{path.parent.name}/{path.name}" if path.name == "journal" else path.name

    def segments(self) -> list[Path]:
        """The segments there are now, oldest first."""
        return self._folder.segments() if self._folder is not None else [self.path]

    def __iter__(self) -> Iterator[Entry]:
        """The entries of all segments. Raises UnusableLog if there are none."""
        for segment in self.segments():
            with self._excused(), segment.open("rb") as stream:
                reader = JournalReader(stream, str(segment))
                yield from self._counted(reader, segment)
                self._note_end(segment, reader)
            if self._damage:
                return
        if not self._has_entries:
            raise UnusableLog(f"{self.path}: empty, central has written nothing to it yet: {_WAITING}")

    def follow(self, wait: Callable[[], object] = lambda: time.sleep(_POLL_SECONDS)) -> Iterator[Entry]:
        """The entries there are and those that come, calling *wait* before looking again; ends only at damage."""
        return (entry for entry, _ in self.follow_places(wait))

    def follow_places(
        self, wait: Callable[[], object] = lambda: time.sleep(_POLL_SECONDS)
    ) -> Iterator[tuple[Entry, Place]]:
        """The same, with where each entry stands."""
        followed: set[Path] = set()
        while not self._damage and not (self._followed_by and self._folder is None):
            segment = next((one for one in self.segments() if one not in followed), None)
            if segment is not None:
                yield from self._follow_segment(segment, wait)
                followed.add(segment)
            else:
                wait()

    @property
    def is_empty(self) -> bool:
        """Whether there is not a byte in it yet."""
        return not any(segment.stat().st_size for segment in self.segments())

    def check_beginning(self) -> None:
        """Raise UnusableLog if this is no journal; one that is empty may become one."""
        for segment in self.segments()[:1]:
            with self._excused(), segment.open("rb") as stream:
                next(iter(JournalReader(stream, str(segment))), None)

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
        """The present on the run's clock, if its last entry was at *last* and more may come; None if it is over.

        It is reckoned from when the journal was last written to: a wall clock that was set since the run began, as on
        a robot that learns the time late, does no harm.
        """
        if self._damage or not self.is_being_written:
            return None
        try:
            silence = time.time() - self.segments()[-1].stat().st_mtime
        except (OSError, IndexError, UnusableLog):
            return None
        return last + max(silence, 0.0)

    @property
    def cut(self) -> str:
        """What there is to say of a last entry that is not whole, and that nobody is writing just now."""
        if not self._torn or self.is_being_written:
            return ""
        segment, offset, torn = self._torn
        return f"{segment}, byte {offset}: cut off, the last {torn} bytes are no whole entry"

    @property
    def remarks(self) -> list[str]:
        """What there is to say of its folder, a line each: other runs lie there, or segments are missing; of damaged
        entries; and of what follows in a file.
        """
        folder = [*self._folder.others, *self._folder.missing] if self._folder is not None else []
        return [*folder, *filter(None, [self.left_out, self._followed_by])]

    @property
    def left_out(self) -> str:
        """A line for the damaged entries that were passed over; "" if there were none."""
        if not self.lost:
            return ""
        what = "a damaged entry is" if self.lost == 1 else f"{self.lost} damaged entries are"
        first = ", the first of them here" * (self.lost > 1)
        return f"{self._first_lost}: {what} left out{first}: what seems to go on since then may have ended"

    def tell(self, *, of_missing: bool = True) -> None:
        """Say on the standard error what there is to say of the folder (*of_missing*: of segments that are missing,
        too); nothing is said twice.
        """
        folder = self._folder
        if folder is not None:
            for remark in [*folder.others, *(folder.missing if of_missing else ())]:
                self._say(remark)

    def check(self, *, of_missing: bool = True) -> None:
        """Raise DamagedLog if reading stopped early, with the one line that says where and why; ``tell`` the rest.

        Of a journal that is cut only the end is missing, as after a power cut: a line on the standard error says so.
        """
        self.tell(of_missing=of_missing)
        if self._followed_by:
            self._say(self._followed_by)
        if self._damage:
            also = f" ({self.left_out})" if self.lost else ""
            raise DamagedLog(f"{self._damage}; what comes before it is shown{also}")
        if self.lost:
            raise DamagedLog(self.left_out)
        if cut := self.cut:
            self._say(f"{cut}; what comes before it is shown")

    def _say(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            click.echo(f"tca: {printable(line)}", err=True)

    def _follow_segment(self, segment: Path, wait: Callable[[], object]) -> Iterator[tuple[Entry, Place]]:
        with self._excused(), segment.open("rb") as stream:
            reader = JournalReader(stream, str(segment))
            while True:
                is_last = self.segments()[-1:] == [segment]  # asked first: after that nothing is added to it
                for entry in self._counted(reader, segment):
                    yield entry, Place(segment, reader.offset)
                self._note_end(segment, reader)
                self._check_is_whole(segment, reader)
                if not is_last or self._followed_by:
                    return
                wait()

    def _check_is_whole(self, segment: Path, reader: JournalReader) -> None:
        """Raise JournalDamaged if a segment that is followed is gone, or has lost something that was read."""
        if not segment.exists():
            raise JournalDamaged(f"{segment}: has been removed")
        if reader.torn < 0:
            raise JournalDamaged(f"{segment}: has become shorter than what was read of it, by {-reader.torn} bytes")

    def _note_end(self, segment: Path, reader: JournalReader) -> None:
        self._torn = (segment, reader.offset, reader.torn) if reader.torn else None

    def _counted(self, reader: JournalReader, segment: Path) -> Iterator[Entry]:
        """The entries of a segment, until another run, or the same anew, begins in it."""
        known = len(reader.holes)
        for entry in reader:
            if len(reader.holes) > known:
                self._first_lost = (
                    self._first_lost or f"{segment}, byte {reader.holes[known]}, after {self._time:.3f} s"
                )
                self.lost += len(reader.holes) - known
                known = len(reader.holes)
            self._time = entry.time
            facts = entry.facts
            if facts and type(facts[0]) is Opened and self._is_another(facts[0], reader, segment):
                return
            yield entry

    def _is_another(self, opened: Opened, reader: JournalReader, segment: Path) -> bool:
        """Whether, in the midst of a file, something begins that does not go on with what comes before it."""
        self._has_entries = True  # each segment begins so
        last = self._opened if reader.offset else None
        if last is None or (opened.epoch == last.epoch and opened.segment > last.segment):
            self._opened = opened
            return False
        what = "another run" if opened.epoch != last.epoch else f"segment {opened.segment} of this run, once more,"
        self._followed_by = (
            f"{segment}, byte {reader.offset}: {what} begins here; only what comes before it is shown: to see the rest,"
            f" take it out of the file ('tail -c +{reader.offset + 1}')"
        )
        return True

    @contextmanager
    def _excused(self) -> Iterator[None]:
        """Reading may fail where something was read before; ``check`` tells of it."""
        try:
            yield
        except JournalDamaged as error:
            self._damage = str(error)
        except OSError as error:
            self._damage = f"{error.filename or self.path}: can't be read: {error.strerror}"
        if self._damage and not self._has_entries:
            raise UnusableLog(self._damage)


def _checked(path: Path) -> Path:
    if path.is_dir():
        if not segments_in(path):
            raise UnusableLog(f"{path}: a directory without segments (*{SEGMENT_SUFFIX}): name the journal of one run")
    elif not path.exists():
        raise UnusableLog(f"{path}: there is no such file or directory: name a journal directory or a segment")
    elif not path.is_file():
        raise UnusableLog(f"{path}: neither a file nor a directory: name a journal directory or a segment")
    return path
