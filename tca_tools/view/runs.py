"""Which runs a page can show, and their readings. Without a LOG those in central's folder of
journals; of a LOG those that lie in it, and those beside it if it lies in that folder.

A run has an *address*, by which pages ask for it: folder and epoch, the same whatever comes to lie
beside it. People see its *name*, which tells it from the others there are now: of a folder with one
run "FOLDER", else "FOLDER#2".
"""

import threading
from collections import Counter, OrderedDict
from collections.abc import Iterator
from pathlib import Path
from secrets import token_hex
from time import monotonic
from typing import NamedTuple

from tca_tools.errors import UnusableLog
from tca_tools.journal.journals import Log, called, newest_journal, open_log
from tca_tools.journal.segments import Folder, listed, segments_in
from tca_tools.view.reading import Reading
from tca_wire.endpoint import by_number, default_journals

_KEPT = 4
"""Runs that stay read, though nobody has asked for them for a while."""
_UNASKED = 60.0
"""Seconds."""
_KNOWN = 1.0
"""Seconds until it is looked again which runs there are."""


class RunName(NamedTuple):
    """How a run is asked for, and what people call it."""

    address: str
    """As LOG names it: "FOLDER#EPOCH" with the whole path; while its journal is empty, and of a
    file, the path.
    """
    name: str


class ListedRun(NamedTuple):
    """One run that can be shown."""

    address: str
    name: str
    path: Path
    """Of the folder, or the file, itself: links to it come and go."""
    epoch: str | None
    began: float | None
    """Wall-clock time, if its journal tells."""


class Shown(NamedTuple):
    """A run that is being read."""

    place: Path
    reading: Reading
    token: str
    """Another one for each reading: what a page has of one does not go on in another."""

    @property
    def address(self) -> str:
        """The address now; a journal that was empty had none with an epoch."""
        return _address(self.place, self.reading.log.run)


class Runs:
    """All runs there are, as they come. May be asked by several threads, also by one that looks at
    a reading: who has the lock waits for no reading. A signal may stop it in the midst of anything.
    """

    def __init__(self, log: Log, *, follows: bool) -> None:
        self.follows = follows
        """Whether the newest one is shown, whichever that is."""
        self._own = log.path.resolve()
        self._shown: OrderedDict[str, tuple[Shown, float]] = OrderedDict()
        self._folders: dict[Path, tuple[tuple[int, int], Folder]] = {}
        """What is known of folders, as long as no file comes to them or goes."""
        self._places = {self._own: None}
        """Where runs lie that are to be found though no link leads there (any more)."""
        self._lock = threading.RLock()
        self._is_stopped = False
        self._given: Log | None = log
        self._names: dict[str, str] = {}
        """Of all runs that there were, by address."""
        self._first = self._newest = _address(self._own, log.run)
        self._look_again = 0.0
        self.all()
        self.newest_at_start = self._newest
        """By address: what a page that shows the run of a LOG need not be told of."""

    def all(self) -> list[ListedRun]:
        """Those there are now, oldest first; what they are called is known from now on, and which
        is the newest.
        """
        newest = self._own
        with self._lock:
            if self.follows:
                try:
                    newest = newest_journal().resolve()
                except UnusableLog:  # its folder is gone
                    newest = Path()
                else:
                    self._places.setdefault(newest)
            places = _told_apart(self._all_places())
            found = [run for place, name in places.items() for run in self._in(place, name)]
            self._names.update((run.address, run.name) for run in found)
            self._newest = next(
                (run.address for run in reversed(found) if run.path == newest), self._newest
            )
            self._look_again = monotonic() + _KNOWN
        return found

    @property
    def first(self) -> RunName:
        """The one to begin with."""
        return self.newest if self.follows else self._named(self._first)

    @property
    def newest(self) -> RunName:
        """The one that began last; of a LOG the last that lies in it. Known for a while."""
        with self._lock:
            if monotonic() >= self._look_again:
                self.all()
        return self._named(self._newest)

    def names(self, shown: Shown) -> tuple[RunName, RunName]:
        """Of a run that is being read, and of the newest one, at one time."""
        newest, address = self.newest, shown.address
        if newest.address.startswith(
            f"{address}#"
        ):  # it was empty until now: its reading will learn it
            return newest, newest
        return self._named(address), newest

    def show(self, address: str | None) -> Shown | None:
        """A run by its address (None: the one to begin with); None if there is none."""
        address = address or self.first.address
        with self._lock:
            kept = self._being_read(address)
            if (
                not self._is_read(kept)
                and not self._is_stopped
                and (log := self._open(kept)) is not None
            ):
                reading = Reading(log)
                reading.start()
                shown = Shown(log.path.resolve(), reading, token_hex(8))
                self._shown[kept] = shown, 0.0
            if kept not in self._shown:
                return None
            shown, _ = self._shown.pop(kept)
            # the last one that was asked for is the last in it
            self._shown[kept] = shown, monotonic()
            forgotten = self._forget()
        for one in forgotten:
            one.reading.stop()
        return shown

    def stop(self) -> None:
        """Read no more, and let nobody wait for it."""
        with self._lock:
            self._is_stopped = True
            readings = [shown.reading for shown, _ in self._shown.values()]
        for reading in readings:
            reading.stop()

    def _named(self, address: str) -> RunName:
        return RunName(address, self._names.get(address) or called(Path(address.partition("#")[0])))

    def _being_read(self, address: str) -> str:
        """By which address it was asked for first: a journal that was empty then had no epoch."""
        if address not in self._shown:
            for kept, (shown, _) in self._shown.items():
                if address == shown.address:
                    return kept
        return address

    def _is_read(self, kept: str) -> bool:
        """Whether it is being read; not if its journal was removed or cut short, and is there
        again.
        """
        if kept not in self._shown:
            return False
        shown, _ = self._shown[kept]
        if not shown.reading.is_back:
            return True
        self._folders.pop(shown.place, None)  # another run may lie there
        return False

    def _open(self, address: str) -> Log | None:
        if address == self._first and self._given:  # it is open
            log, self._given = self._given, None
            return log
        runs = self.all()
        found = next((run for run in runs if run.address == address), None)
        found = found or next(
            (run for run in runs if str(run.path) == address), None
        )  # it was empty
        try:
            return open_log(found.path, found.epoch) if found else None
        except UnusableLog:
            return None

    def _all_places(self) -> list[Path]:
        """Folders with a run, and the file that was named as LOG; of links to one folder the last
        counts.
        """
        journals = default_journals()
        beside: list[Path] = []
        if self.follows or self._own.parent == journals.resolve():
            try:
                folders = [path for path in by_number(listed(journals)) if path.is_dir()]
                beside = [path.resolve() for path in folders if segments_in(path)]
            except UnusableLog:
                beside = []
        last_first = dict.fromkeys([*reversed(beside), *reversed(self._places)])
        return list(reversed(last_first))

    def _folder(self, place: Path) -> Folder:
        """One that knows nothing yet if files came, went or were replaced."""
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

    def _forget(self) -> list[Shown]:
        """Those that nobody looks at any more, but the last few: they are to be stopped."""
        since, shown = monotonic() - _UNASKED, list(self._shown.items())[:-_KEPT]
        unasked = [address for address, (_, asked) in shown if asked < since]
        return [self._shown.pop(address)[0] for address in unasked]


def _told_apart(places: list[Path]) -> dict[Path, str]:
    """A name for each place, as in titles; if several have the same, with as much of the path as
    they differ in.
    """
    names = {place: called(place) for place in places}
    while len(count := Counter(names.values())) < len(names):
        for place, name in names.items():
            if count[name] > 1:
                names[place] = "/".join(place.parts[-2 - name.count("/") :])
    return names


def _address(place: Path, epoch: str | None) -> str:
    return f"{place}#{epoch}" if epoch else str(place)
