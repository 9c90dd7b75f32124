"""A journal that is read in the background while pages already look at what has been read, and
followed at its end.
"""

import gc
import threading
from bisect import bisect_right
from contextlib import suppress
from itertools import groupby
from operator import attrgetter
from time import monotonic
from typing import Any, Self

from tca_tools.errors import ToolError, UnusableLog
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.journals import EntryPlace, Log
from tca_tools.view.feed import Feed
from tca_wire.errors import JournalDamaged
from tca_wire.journal.facts import Closed, Entry
from tca_wire.journal.records import JournalReader

_AT_ONCE = 2000
"""Entries that are taken in while nobody can look."""
_POLL_SECONDS = 0.1
_WHILE_READING = 1.0
"""Seconds between two looks at a long journal that is being read."""
_WHO_WRITES = 1.0
"""Seconds between two looks whether central still has the journal open."""


class _Stopped(Exception):
    """Nobody wants to know more."""


class Reading:
    """The part of a journal that has been read. Look at it only inside of ``with reading:``."""

    def __init__(self, log: Log) -> None:
        self.log = log
        self.remark = "; ".join(log.remarks)
        """Remarks on the folder or file: other journals in it, and missing parts."""
        self.feed = Feed()
        self.caught_up = False
        """Whether all has been read that there is; more may come."""
        self.closed = False
        """Whether central ended of its own will: nothing more comes."""
        self.problem = ""
        """Why nothing more can be read."""
        self._lost: EntryPlace | None = None
        """The place where a removed or cut file ended the reading; nothing more can be read."""
        self.cut = ""
        """The remark on a last entry that is not whole."""
        self._worked_out: tuple[tuple[int, float], dict[object, Any]] | None = None
        """The number of entries until the moment that was looked at last, that moment, and results
        for it.
        """
        self._grown = threading.Condition()
        self._is_written = False
        """Whether a central had the journal open before what was read last."""
        self._wrote = False
        self._look_again = 0.0
        self._known = (0.0, 0.0)
        """A time of this machine's clock, and what the run's clock showed then."""
        self._places: list[EntryPlace] = []
        self._pending: list[tuple[Entry, EntryPlace]] = []
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._read, name="journal", daemon=True)

    def __enter__(self) -> Self:
        self._grown.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        self._grown.release()

    def start(self) -> None:
        """Begin to read, in a thread of its own."""
        self._thread.start()

    def stop(self) -> None:
        """Read no more, and let nobody wait for it."""
        self._stopped.set()
        with self:
            self._grown.notify_all()

    @property
    def entries(self) -> int:
        """How many entries have been read."""
        return len(self._places)

    @property
    def state(self) -> str:
        """How the run stands, in a word or two."""
        if self.problem:
            return "damaged"
        if not self.caught_up:
            return "reading"
        if self.closed:
            return "ended"
        return "live" if self._is_written else "not closed"

    @property
    def now(self) -> float | None:
        """The present on the run's clock, while it is live: never before the last entry."""
        if self.state != "live" or not self.entries:
            return None
        at, showed = self._known
        return showed + monotonic() - at

    @property
    def is_over(self) -> bool:
        """Whether nothing more will be read."""
        return bool(self.problem) or self._stopped.is_set()

    @property
    def is_back(self) -> bool:
        """Whether what was removed or cut short is there again: then all is to be read anew."""
        try:
            lost = self._lost
            return lost is not None and lost.segment.stat().st_size >= lost.offset
        except OSError:
            return False

    def wait_for_more(self, entries: int, seconds: float) -> None:
        """Wait, inside of ``with``, for more than so many entries, another state of the run, or the
        end of the time. While a long journal is being read, news are told together.
        """
        known = self.state, self.cut
        if not self.caught_up:
            seconds = min(seconds, _WHILE_READING)
            self._grown.wait_for(lambda: self.caught_up or self.is_over, seconds)
            return

        def has_news() -> bool:
            return self.entries > entries or self.is_over or (self.state, self.cut) != known

        self._grown.wait_for(has_news, seconds)

    def wait_until_read(self) -> None:
        """Wait until all has been read that there is. Not to be called inside of ``with``."""
        with self:
            self._grown.wait_for(lambda: self.caught_up or self.is_over)

    def at(self, moment: float) -> RunAt:
        """The run as it was at a moment, with what was worked out of it already. Only inside of
        ``with``.
        """
        history = self.feed.history
        at = RunAt(history, moment)
        key = bisect_right(history.times, at.moment), at.moment
        if self._worked_out is None or self._worked_out[0] != key:
            self._worked_out = key, {}
        _, at.memo = self._worked_out
        return at

    def entries_between(self, first: int, last: int) -> list[Entry]:
        """Entries by their numbers from the first on, read anew from the disk. Not to be called
        inside of ``with``.
        """
        with self:
            places = self._places[max(first, 0) : last]
        found: list[Entry] = []
        for segment, together in groupby(places, attrgetter("segment")):
            offsets = [place.offset for place in together]
            with segment.open("rb") as stream, suppress(JournalDamaged):  # behind the last of them
                for entry in JournalReader(stream, str(segment), offsets[0]):
                    if found and entry.number == found[-1].number:  # one event of so many facts
                        found[-1] = Entry(
                            entry.number, entry.time, [*found[-1].facts, *entry.facts]
                        )
                    elif offsets:
                        found.append(entry)
                        offsets.pop()
                    else:
                        break
        return found

    def _read(self) -> None:
        gc.disable()  # as in journal/fold.py, until all has been read that there is
        self._look_who_writes()
        try:
            for entry, place in self.log.follow_places(self._pause):
                self._pending.append((entry, place))
                if len(self._pending) >= _AT_ONCE:
                    self._take()
                if self._stopped.is_set():
                    raise _Stopped  # noqa: TRY301
            self._take()
            self.log.check()
            self._catch_up()
        except _Stopped:
            gc.enable()
        except ToolError as error:
            self._take()
            self._catch_up(error.message)

    def _pause(self) -> None:
        self._take()
        if (news := (self._wrote, self.log.cut)) != (self._is_written, self.cut):
            with self:
                self._is_written, self.cut = news
                self._grown.notify_all()
        if not self.caught_up:
            self._catch_up()
        self._look_who_writes()
        if self._stopped.wait(_POLL_SECONDS):
            raise _Stopped

    def _look_who_writes(self) -> None:
        """Counts only when what was written until now has been read: central's last word may be
        among it.
        """
        if monotonic() >= self._look_again:
            self._wrote = self.log.is_being_written
            self._look_again = monotonic() + _WHO_WRITES

    def _catch_up(self, problem: str = "") -> None:
        gc.freeze()
        gc.enable()
        if problem:
            self._lost = self.log.lost or (
                None if self.log.segment.exists() else EntryPlace(self.log.segment, 0)
            )
        with self:
            last = self.feed.history.time
            self._known = monotonic(), self.log.present(last) or last
            self.problem, self.caught_up = problem, True
            self._tell_remarks()
            self._grown.notify_all()

    def _tell_remarks(self) -> None:
        """Update the remarks, which each entry may change: damaged ones before it have been passed
        over.
        """
        with suppress(UnusableLog):  # its folder is gone: of that the problem tells
            self.remark = "; ".join(self.log.remarks)

    def _take(self) -> None:
        """Let those who look see what has been read."""
        if not self._pending:
            return
        with self:
            if self._worked_out and self._worked_out[0][0] == len(self.feed.history.times):
                self._worked_out = None  # more of the same entry may come
            for entry, place in self._pending:
                known = len(self.feed.history.times)
                self.feed.apply(entry)
                if (
                    len(self.feed.history.times) > known
                ):  # or it is another record of the same entry
                    self._places.append(place)
                self.closed = any(isinstance(fact, Closed) for fact in entry.facts)
            self._known = monotonic(), self.feed.history.time
            self._tell_remarks()
            self._pending.clear()
            self._grown.notify_all()
