"""A journal that was read to its end: its entries, all records, and where in it what is. Pure;
knows no terminal.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from math import inf
from typing import NamedTuple

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import went_on
from tca_tools.journal.fold import History
from tca_tools.journal.whole_run import Run
from tca_tools.log.fact_rows import BAD_NEWS
from tca_wire.journal.facts import Entry, Fact, Failed, kind_of
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import Wording, subject_of


class SearchHit(NamedTuple):
    """Something that was looked for: its place, and its task (0: none)."""

    place: int
    task: int


class Recording:
    """A run as it was written. A *place* is the number of an event, from 0 on."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        self.events: list[list[Fact]] = []
        """The facts of each event, of one entry or of several of the same number."""
        self.run: Run = History.until(self._kept(entries))
        self.wording = Wording(self.run.name)
        self.failures: dict[int, bool] = {}
        """The places at which something failed, in order; and whether the run did not go on after
        that, as far as the journal tells.
        """
        for place, event in enumerate(self.events):
            if failed := [fact for fact in event if isinstance(fact, Failed)]:
                coped = [self._has_coped(place, fact) for fact in failed]
                self.failures[place] = not all(coped)
        tasks = self.run.tasks.values()
        self._ends = sorted(task.time_of(Moment.END_ACHIEVING) for task in tasks)

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
        time = self.run.times[place]
        return failed is not None and went_on(self.run, failed, time, known)

    def is_bad_news(self, place: int, fact: Fact, now: int) -> bool | None:
        """Whether a fact is bad news; None: it was, and the run had gone on by the place that is
        looked at *now*; of what comes later, as far as the journal tells.
        """
        if not isinstance(fact, Failed):
            return kind_of(fact) in BAD_NEWS
        known = self.run.times[now] if place <= now else inf
        return None if self._has_coped(place, fact, known) else True

    @property
    def last(self) -> int:
        """The last place."""
        return max(len(self.events) - 1, 0)

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time on the clock."""
        return self.time(0), self.time(self.last)

    def time(self, place: int) -> float:
        """The time on the clock."""
        return self.run.clock[place] if self.run.clock else 0.0

    def at(self, place: int) -> RunAt:
        """The run as known at a place."""
        if not self.run.times:
            return RunAt(self.run)
        return RunAt(self.run, self.run.times[place], self.run.clock[place])

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
        return next(self._failures_from(place, step), None)

    def _failures_from(self, place: int, step: int) -> Iterator[int]:
        places = self.failures if step > 0 else reversed(self.failures)
        return (one for one in places if (one - place) * step > 0)

    def about(self, fact: Fact) -> int:
        """The task that a fact is about, or whose question is; 0 if none is."""
        named = [subject_of(fact), getattr(fact, "origin", 0)]
        if isinstance(fact, Failed):
            message = self.run.delivered(subject_of(fact))
            if message and message.by:
                named.insert(1, message.by.message_id)
        return next((number for number in named if number in self.run.tasks), 0)

    def search(self, text: str, place: int, step: int) -> SearchHit | None:
        """The task of that number, now or when it is sent. Else the nearest after a place (or, step
        -1, before it) of the tasks with *text* in their names, when they are sent, and of the
        failures with it. Place -1 is before all.
        """
        wanted, tasks = text.casefold(), self.run.tasks
        if (number := text.strip("{}")).isdecimal() and int(number) in tasks:
            born = self.place_of_record(tasks[int(number)].received)
            return SearchHit(max(place, born), int(number))
        found = self._born(wanted, place, step), self._failed(wanted, place, step)
        nearest = filter(None, (next(one, None) for one in found))
        return min(nearest, key=lambda one: one.place * step, default=None)

    def _born(self, wanted: str, place: int, step: int) -> Iterator[SearchHit]:
        """The tasks that are sent after a place, or before it."""
        numbers, births = list(self.run.tasks), self.run.births
        now = -inf if place < 0 else inf if place > self.last else self.run.times[place]
        order = numbers[bisect_right(births, now) :]
        if step < 0:
            order = numbers[: bisect_left(births, now)][::-1]
        for number in order:
            if wanted in self.run.tasks[number].name.casefold():
                born = self.place_of_record(self.run.tasks[number].received)
                yield SearchHit(born, number)

    def _failed(self, wanted: str, place: int, step: int) -> Iterator[SearchHit]:
        """The failures after a place, or before it."""
        for here in self._failures_from(place, step):
            for fact in self.events[here]:
                if isinstance(fact, Failed) and wanted in f"{fact.failure}: {fact.text}".casefold():
                    yield SearchHit(here, self.about(fact))
