"""A journal that was read to its end: its entries, all records, and where in it what is. Pure; knows no terminal."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from math import inf

from tca_tools.log.__main__ import BAD_NEWS
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import went_on
from tca_tools.run.fold import History
from tca_tools.run.whole_run import Run
from tca_wire.journal.facts import Entry, Fact, Failed, kind_of
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import Wording


class Recording:
    """A run as it was written. A *place* is the number of an event, from 0 on."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        self.events: list[list[Fact]] = []
        """The facts of each event, of one entry or of several of the same number."""
        self.run: Run = History.until(self._kept(entries))
        self.wording = Wording(self.run.name)
        failed = ((place, one) for place, event in enumerate(self.events) for one in event if isinstance(one, Failed))
        self.failures: dict[int, bool] = {}
        """The places at which something failed, in order; and whether the run did not go on after that, as far as the
        journal tells.
        """
        for place, fact in failed:
            self.failures[place] = self.failures.get(place, False) or not self._has_coped(place, fact)
        ends = (task.reached.get(Moment.END_ACHIEVING, inf) for task in self.run.tasks.values())
        self._ends = sorted(ends)

    def _kept(self, entries: Iterable[Entry]) -> Iterator[Entry]:
        number = None
        for entry in entries:
            if entry.number != number or not self.events:
                self.events.append([])
                number = entry.number
            self.events[-1] += entry.facts
            yield entry

    def _has_coped(self, place: int, fact: Failed, known: float = inf) -> bool:
        failed = self.run.delivered(fact.id)
        return failed is not None and went_on(self.run, failed, self.run.times[place], known)

    def is_bad_news(self, place: int, fact: Fact, now: int) -> bool | None:
        """Whether a fact is bad news; None: it was, and the run had gone on by the place that is looked at *now*; of
        what comes later, as far as the journal tells.
        """
        if isinstance(fact, Failed):
            return None if self._has_coped(place, fact, self.run.times[now] if place <= now else inf) else True
        return kind_of(fact) in BAD_NEWS

    @property
    def last(self) -> int:
        """The last place."""
        return max(len(self.events) - 1, 0)

    def time(self, place: int) -> float:
        """The time on the clock."""
        return self.run.clock[place] if self.run.clock else 0.0

    def at(self, place: int) -> RunAt:
        """The run as known at a place."""
        return RunAt(self.run, self.run.times[place], self.run.clock[place]) if self.run.times else RunAt(self.run)

    def under_way(self, at: RunAt) -> int:
        """How many tasks had been sent and not ended."""
        return len(at.tasks) - bisect_right(self._ends, at.moment)

    def place_of(self, time: float) -> int:
        """The last place at which the clock showed no more than *time*."""
        return max(bisect_right(self.run.clock, time) - 1, 0)

    def place_of_record(self, time: float) -> int:
        """The place of a time that a record tells."""
        return min(bisect_left(self.run.times, time), self.last)

    def next_failure(self, place: int, step: int) -> int | None:
        """The next place at which something failed, or (step -1) the one before."""
        places = self.failures if step > 0 else reversed(self.failures)
        return next((one for one in places if (one - place) * step > 0), None)

    def search(self, text: str, place: int, step: int) -> int | None:
        """The task of that number; else the next task (or, step -1, the one before) that is sent after a place and has
        *text* in its name.
        """
        wanted, numbers = text.casefold(), list(self.run.tasks)
        if (number := text.strip("{}")).isdecimal() and int(number) in self.run.tasks:
            return int(number)
        now = self.run.times[place] if self.run.times else 0.0
        here = bisect_right(self.run.births, now) if step > 0 else bisect_left(self.run.births, now)
        order = numbers[here:] if step > 0 else reversed(numbers[:here])
        return next((number for number in order if wanted in self.run.tasks[number].name.casefold()), None)
