"""Which runs a page can show, and their readings. Without a LOG those in central's folder of journals; of a LOG those
that lie in it, and those beside it if it lies in that folder.
"""

import threading
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from secrets import token_hex
from time import monotonic
from typing import NamedTuple

from tca_tools.errors import UnusableLog
from tca_tools.logs import Log, newest_journal, open_log
from tca_tools.segments import Folder, listed, segments_in
from tca_tools.view.reading import Reading
from tca_wire.endpoint import default_journals

_KEPT = 4
"""Runs that stay read, though nobody has asked for them for a while."""
_UNASKED = 60.0
"""Seconds."""
_KNOWN = 1.0
"""Seconds until it is looked again which run is the newest."""


class Run(NamedTuple):
    """One run that can be shown."""

    name: str
    """Of its folder; with its epoch, if other runs in that folder began before."""
    path: Path
    epoch: str | None
    began: float | None
    """Wall-clock time, if its journal tells."""


class Shown(NamedTuple):
    """A run that is being read."""

    name: str
    reading: Reading
    token: str
    """Another one for each reading: what a page has of one does not go on in another."""


class Runs:
    """All runs there are, as they come. May be asked by several threads."""

    def __init__(self, log: Log, *, follows: bool) -> None:
        self.log = log
        """The one that was asked for, or was the newest then."""
        self.follows = follows
        """Whether the newest one is shown, whichever that is."""
        self._shown: OrderedDict[str, tuple[Shown, float]] = OrderedDict()
        self._folders: dict[Path, Folder] = {}
        self._lock = threading.Lock()
        self._is_stopped = False
        self._given: Log | None = log
        self._first = self._newest = self._last_in(log.path)
        self._look_again = 0.0

    def all(self) -> list[Run]:
        """Those there are now, oldest first."""
        with self._lock:
            return list(self._all())

    @property
    def newest(self) -> str:
        """The name of the one that began last; of a LOG the last that lies in it. Known for a while."""
        if monotonic() >= self._look_again:
            self._newest, self._look_again = self._look(), monotonic() + _KNOWN
        return self._newest

    def _look(self) -> str:
        try:
            return self._last_in(newest_journal() if self.follows else self.log.path)
        except UnusableLog:  # its folder is gone
            return self._first

    def show(self, name: str | None) -> Shown | None:
        """A run by its name (None: the one to begin with); None if there is none of that name."""
        name = name or (self.newest if self.follows else self._first)
        with self._lock:
            if name not in self._shown:
                if (log := self._open(name)) is None or self._is_stopped:
                    return None
                reading = Reading(log)
                reading.start()
                self._shown[name] = Shown(name, reading, token_hex(8)), 0.0
            shown, _ = self._shown.pop(name)
            self._shown[name] = shown, monotonic()  # the last one that was asked for is the last in it
            self._forget()
            return shown

    def stop(self) -> None:
        """Read no more, and let nobody wait for it."""
        with self._lock:
            self._is_stopped = True
            for shown, _ in self._shown.values():
                shown.reading.stop()

    def _open(self, name: str) -> Log | None:
        if name == self._first and self._given:  # it is open
            log, self._given = self._given, None
            return log
        found = next((run for run in self._all() if run.name == name), None)
        try:
            return open_log(found.path, found.epoch) if found else None
        except UnusableLog:
            return None

    def _all(self) -> Iterator[Run]:
        for path in self._paths():
            yield from self._in(path)

    def _paths(self) -> list[Path]:
        """Folders with a run; of links to one folder the first."""
        own, journals = self.log.path, default_journals()
        beside: list[Path] = []
        if self.follows or own.resolve().parent == journals.resolve():
            try:
                beside = [path for path in listed(journals) if path.is_dir() and segments_in(path)]
            except UnusableLog:
                beside = []
        by_place: dict[Path, Path] = {}
        for path in [*beside, own]:
            by_place.setdefault(path.resolve(), path)
        return list(by_place.values())

    def _in(self, path: Path) -> Iterator[Run]:
        if not path.is_dir():
            yield Run(path.name, path, None, None)
            return
        folder = self._folders.setdefault(path, Folder(path))
        try:
            epochs = folder.epochs()
        except UnusableLog:
            return
        name = path.name or path.resolve().name
        if not epochs:
            yield Run(name, path, None, None)
        for number, opened in enumerate(epochs):
            yield Run(f"{name}/{opened.epoch}" if number else name, path, opened.epoch, opened.began)

    def _last_in(self, path: Path) -> str:
        """The name of the last run that lies in a folder, or of a file."""
        place = path.resolve()
        with self._lock:
            names = [run.name for run in self._all() if run.path.resolve() == place]
        return names[-1] if names else path.name

    def _forget(self) -> None:
        """Those that nobody looks at any more, but the last few."""
        for name, (shown, asked) in list(self._shown.items())[:-_KEPT]:
            if monotonic() - asked > _UNASKED:
                shown.reading.stop()
                del self._shown[name]
