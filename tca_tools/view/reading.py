"""Read a journal in the background, and follow it at its end, while pages show the part read."""

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
"""Entries that are applied without releasing the lock."""
_POLL_SECONDS = 0.1
_WHILE_READING = 1.0
"""Seconds between two answers to a page while a long journal is being read."""
_WRITER_CHECK = 1.0
"""Seconds between two checks whether central still has the journal open."""


class _Stopped(Exception):
    """The reading was stopped."""


class Reading:
    """The part of a journal that has been read. Access it only inside ``with reading:``."""

    def __init__(self, log: Log) -> None:
        self.log = log
        self.remark = "; ".join(log.remarks)
        """Remarks on the folder or file: other journals in it, and missing parts."""
        self.feed = Feed()
        self.caught_up = False
        """Whether the present end of the journal has been reached; it may still grow."""
        self.closed = False
        """Whether central has closed the run: the journal does not grow."""
        self.problem = ""
        """Why nothing more can be read."""
        self._lost: EntryPlace | None = None
        """The place where a removed or cut file ended the reading; nothing more can be read."""
        self.cut = ""
        """The remark on an incomplete last entry."""
        self._memo: tuple[tuple[int, float], dict[object, Any]] | None = None
        """The last requested instant, with the number of its entries, and cached results for it."""
        self._grown = threading.Condition()
        self._is_written = False
        """Whether a central had the journal open before the last read."""
        self._has_writer = False
        self._next_writer_check = 0.0
        self._clock_pair = (0.0, 0.0)
        """A time of this machine's clock, and the run's clock at that time."""
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
        """Start to read, in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop reading, and wake all waiting callers."""
        self._stopped.set()
        with self:
            self._grown.notify_all()

    @property
    def entries(self) -> int:
        """The number of entries read."""
        return len(self._places)

    @property
    def state(self) -> str:
        """The state of the run: damaged, reading, ended, live or not closed."""
        if self.problem:
            return "damaged"
        if not self.caught_up:
            return "reading"
        if self.closed:
            return "ended"
        return "live" if self._is_written else "not closed"

    @property
    def now(self) -> float | None:
        """The present time of the run's clock, never before the last entry; None if not live."""
        if self.state != "live" or not self.entries:
            return None
        at, run_time = self._clock_pair
        return run_time + monotonic() - at

    @property
    def is_over(self) -> bool:
        """Whether nothing more will be read."""
        return bool(self.problem) or self._stopped.is_set()

    @property
    def must_be_reread(self) -> bool:
        """Whether the journal must be read again: a removed or shortened file is there again."""
        try:
            lost = self._lost
            return lost is not None and lost.segment.stat().st_size >= lost.offset
        except OSError:
            return False

    def wait_for_more(self, entries: int, seconds: float) -> None:
        """Wait for more than *entries* entries, another state, or *seconds*. Call inside ``with``.

        While a long journal is being read, a page gets many entries at once.
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
        """Wait until the present end of the journal has been read. Do not call inside ``with``."""
        with self:
            self._grown.wait_for(lambda: self.caught_up or self.is_over)

    def at(self, instant: float) -> RunAt:
        """Return the run at an instant, with cached results. Call only inside ``with``."""
        history = self.feed.history
        at = RunAt(history, instant)
        key = bisect_right(history.times, at.instant), at.instant
        if self._memo is None or self._memo[0] != key:
            self._memo = key, {}
        _, at.memo = self._memo
        return at

    def entries_between(self, first: int, last: int) -> list[Entry]:
        """Read the entries *first* to *last* - 1 again from disk. Do not call inside ``with``."""
        with self:
            places = self._places[max(first, 0) : last]
        found: list[Entry] = []
        for segment, together in groupby(places, attrgetter("segment")):
            offsets = [place.offset for place in together]
            # There may be damage after the last of these entries
            with segment.open("rb") as stream, suppress(JournalDamaged):
                for entry in JournalReader(stream, str(segment), offsets[0]):
                    if found and entry.number == found[-1].number:
                        # a further record of the same event
                        facts = [*found[-1].facts, *entry.facts]
                        found[-1] = Entry(entry.number, entry.time, facts)
                    elif offsets:
                        found.append(entry)
                        offsets.pop()
                    else:
                        break
        return found

    def _read(self) -> None:
        gc.disable()  # as in journal/fold.py, until the journal has been read
        self._check_writer()
        try:
            for entry, place in self.log.follow_places(self._pause):
                self._pending.append((entry, place))
                if len(self._pending) >= _AT_ONCE:
                    self._apply_pending()
                if self._stopped.is_set():
                    raise _Stopped  # noqa: TRY301
            self._apply_pending()
            self.log.check()
            self._catch_up()
        except _Stopped:
            gc.enable()
        except ToolError as error:
            self._apply_pending()
            self._catch_up(error.message)

    def _pause(self) -> None:
        self._apply_pending()
        if (news := (self._has_writer, self.log.cut)) != (self._is_written, self.cut):
            with self:
                self._is_written, self.cut = news
                self._grown.notify_all()
        if not self.caught_up:
            self._catch_up()
        self._check_writer()
        if self._stopped.wait(_POLL_SECONDS):
            raise _Stopped

    def _check_writer(self) -> None:
        """Check whether central has the journal open.

        `_pause` uses the result only after the next read, which may find that central closed the
        run.
        """
        if monotonic() >= self._next_writer_check:
            self._has_writer = self.log.is_being_written
            self._next_writer_check = monotonic() + _WRITER_CHECK

    def _catch_up(self, problem: str = "") -> None:
        gc.freeze()
        gc.enable()
        if problem:
            self._lost = self.log.lost or (
                None if self.log.segment.exists() else EntryPlace(self.log.segment, 0)
            )
        with self:
            last = self.feed.history.time
            self._clock_pair = monotonic(), self.log.present(last) or last
            self.problem, self.caught_up = problem, True
            self._update_remark()
            self._grown.notify_all()

    def _update_remark(self) -> None:
        """Update the remark: the reader may have skipped damaged entries."""
        with suppress(UnusableLog):  # the folder was removed: `problem` says so
            self.remark = "; ".join(self.log.remarks)

    def _apply_pending(self) -> None:
        """Apply the entries read, so that pages can see them."""
        if not self._pending:
            return
        with self:
            if self._memo and self._memo[0][0] == len(self.feed.history.times):
                self._memo = None  # more records of the same entry may follow
            for entry, place in self._pending:
                known = len(self.feed.history.times)
                self.feed.apply(entry)
                # a further record of the same entry adds no place
                if len(self.feed.history.times) > known:
                    self._places.append(place)
                self.closed = any(isinstance(fact, Closed) for fact in entry.facts)
            self._clock_pair = monotonic(), self.feed.history.time
            self._update_remark()
            self._pending.clear()
            self._grown.notify_all()
