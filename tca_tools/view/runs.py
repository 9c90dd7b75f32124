"""The runs that a page can show, and their readings.

Without a LOG, these are the runs in central's folder of journals. With a LOG, these are the runs of
the LOG. If the LOG is in central's folder, the other runs of that folder can be shown, too.

Pages request a run by its *address*: folder and epoch, which never change. Users see the run's
*name*: "FOLDER" if the folder has one run, else "FOLDER#2". Each run has another name.
"""

import threading
from collections import Counter, OrderedDict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from secrets import token_hex
from time import monotonic
from typing import NamedTuple

from tca_tools.errors import UnusableLog
from tca_tools.journal.journals import Log, newest_journal, open_log, title_of
from tca_tools.journal.segments import Folder, listed, segments_in
from tca_tools.view.reading import Reading
from tca_wire.endpoint import by_number, default_journals

_KEPT = 4
"""Readings that are retained after their last request."""
_UNREQUESTED = 60.0
"""Seconds after its last request for which a reading is always retained."""
_SCAN_SECONDS = 1.0
"""Seconds for which a list of the runs is valid."""


class RunName(NamedTuple):
    """The address of a run, and its name for users."""

    address: str
    """As LOG accepts it: "FOLDER#EPOCH" with the full path; for an empty journal or a file, the
    path.
    """
    name: str


class ListedRun(NamedTuple):
    """One run that can be shown."""

    address: str
    name: str
    path: Path
    """The resolved folder or file, since links to it may change."""
    epoch: str | None
    began: float | None
    """Wall-clock time of its start, if its journal has it."""


class ShownRun(NamedTuple):
    """A run that is being read."""

    place: Path
    reading: Reading
    token: str
    """Identifies this reading: rows of an earlier one do not continue in it."""

    @property
    def address(self) -> str:
        """The present address; it gets an epoch when the journal is no longer empty."""
        return _address(self.place, self.reading.log.run)


class Runs:
    """All present runs. Several threads may use it, also while they access a reading.

    To avoid a deadlock, the lock's holder never waits for a reading. A signal handler may call
    `stop` at any time, so the lock is re-entrant.
    """

    def __init__(self, log: Log, *, follows: bool) -> None:
        self.follows = follows
        """Whether the newest run is shown."""
        self._own = log.path.resolve()
        self._shown: OrderedDict[str, tuple[ShownRun, float]] = OrderedDict()
        self._folders: dict[Path, tuple[tuple[int, int], Folder]] = {}
        """Scanned folders, valid until a file is added or removed."""
        self._places = {self._own: None}
        """The places of runs that remain known without a link to them."""
        self._lock = threading.RLock()
        self._is_stopped = False
        self._given: Log | None = log
        self._names: dict[str, str] = {}
        """The names of all runs ever listed, by address."""
        self._first = self._newest = _address(self._own, log.run)
        self._next_scan = 0.0
        self.all()
        self.newest_at_start = self._newest
        """The address of the newest run at the start. A page of a LOG announces only later runs."""

    def all(self) -> list[ListedRun]:
        """List the present runs, oldest first, and remember their names and the newest one."""
        newest = self._own
        with self._lock:
            if self.follows:
                try:
                    newest = newest_journal().resolve()
                except UnusableLog:  # the folder of the newest run was removed
                    newest = Path()
                else:
                    self._places.setdefault(newest)
            places = _distinct_names(self._all_places())
            found = [run for place, name in places.items() for run in self._in(place, name)]
            self._names.update((run.address, run.name) for run in found)
            self._newest = next(
                (run.address for run in reversed(found) if run.path == newest), self._newest
            )
            self._next_scan = monotonic() + _SCAN_SECONDS
        return found

    @property
    def first(self) -> RunName:
        """The run to show first."""
        return self.newest if self.follows else self._named(self._first)

    @property
    def newest(self) -> RunName:
        """The run that started last, or the last run of a LOG. It is cached for a second."""
        with self._lock:
            if monotonic() >= self._next_scan:
                self.all()
        return self._named(self._newest)

    def names(self, shown: ShownRun) -> tuple[RunName, RunName]:
        """Return the names of a run that is being read, and of the newest one, consistently."""
        newest, address = self.newest, shown.address
        # the journal of *shown* was empty until now, and its reading does not know the epoch yet
        if newest.address.startswith(f"{address}#"):
            return newest, newest
        return self._named(address), newest

    def show(self, address: str | None) -> ShownRun | None:
        """Return a run by its address (None: the first one), and start to read it if necessary.

        Returns None if there is no such run.
        """
        address = address or self.first.address
        with self._lock:
            known = self._first_address(address)
            if (
                not self._is_being_read(known)
                and not self._is_stopped
                and (log := self._open(known)) is not None
            ):
                reading = Reading(log)
                reading.start()
                shown = ShownRun(log.path.resolve(), reading, token_hex(8))
                self._shown[known] = shown, 0.0
            if known not in self._shown:
                return None
            shown, _ = self._shown.pop(known)
            # ordered by the last request
            self._shown[known] = shown, monotonic()
            unused = self._remove_unused()
        for one in unused:
            one.reading.stop()
        return shown

    def stop(self) -> None:
        """Stop all readings, and wake all waiting callers."""
        with self._lock:
            self._is_stopped = True
            readings = [shown.reading for shown, _ in self._shown.values()]
        for reading in readings:
            reading.stop()

    def _named(self, address: str) -> RunName:
        return RunName(
            address, self._names.get(address) or title_of(Path(address.partition("#")[0]))
        )

    def _first_address(self, address: str) -> str:
        """Return the address with which a run was requested first.

        It has no epoch if the journal was empty then.
        """
        if address not in self._shown:
            for known, (shown, _) in self._shown.items():
                if address == shown.address:
                    return known
        return address

    def _is_being_read(self, known: str) -> bool:
        """Whether a run is being read; not if its removed or shortened journal is there again."""
        if known not in self._shown:
            return False
        shown, _ = self._shown[known]
        if not shown.reading.must_be_reread:
            return True
        self._folders.pop(shown.place, None)  # another run may lie there
        return False

    def _open(self, address: str) -> Log | None:
        if address == self._first and self._given:  # it is open already
            log, self._given = self._given, None
            return log
        runs = self.all()
        found = [run for run in runs if run.address == address]
        # the journal of the run was empty when the run was first requested
        found += [run for run in runs if str(run.path) == address]
        try:
            return open_log(found[0].path, found[0].epoch) if found else None
        except UnusableLog:
            return None

    def _all_places(self) -> list[Path]:
        """Return the folders with runs, and the file given as LOG.

        If several links lead to a folder, the last one determines its place in the order.
        """
        journals = default_journals()
        beside: list[Path] = []
        if self.follows or self._own.parent == journals.resolve():
            with suppress(UnusableLog):
                folders = [path for path in by_number(listed(journals)) if path.is_dir()]
                beside = [path.resolve() for path in folders if segments_in(path)]
        last_first = dict.fromkeys([*reversed(beside), *reversed(self._places)])
        return list(reversed(last_first))

    def _folder(self, place: Path) -> Folder:
        """Return a scanned folder, or a new one if its files were added, removed or replaced."""
        stat = place.stat()
        now = stat.st_ino, stat.st_mtime_ns
        if place not in self._folders or self._folders[place][0] != now:
            self._folders[place] = now, Folder(place)
        return self._folders[place][1]

    def _in(self, place: Path, name: str) -> Iterator[ListedRun]:
        try:
            epochs = [] if place.is_file() else self._folder(place).epochs()
        except (UnusableLog, OSError):
            return
        if not epochs:
            yield ListedRun(_address(place, None), name, place, None, None)
        for number, opened in enumerate(epochs, 1):
            one = name if len(epochs) == 1 else f"{name}#{number}"
            yield ListedRun(_address(place, opened.epoch), one, place, opened.epoch, opened.began)

    def _remove_unused(self) -> list[ShownRun]:
        """Remove runs without a recent request, except the last few. Return them to be stopped."""
        since, shown = monotonic() - _UNREQUESTED, list(self._shown.items())[:-_KEPT]
        unused = [address for address, (_, requested) in shown if requested < since]
        return [self._shown.pop(address)[0] for address in unused]


def _distinct_names(places: list[Path]) -> dict[Path, str]:
    """Return a name for each place. Equal names get more of their paths, until they differ."""
    names = {place: title_of(place) for place in places}
    while len(count := Counter(names.values())) < len(names):
        for place, name in names.items():
            if count[name] > 1:
                names[place] = "/".join(place.parts[-2 - name.count("/") :])
    return names


def _address(place: Path, epoch: str | None) -> str:
    return f"{place}#{epoch}" if epoch else str(place)
