"""A journal that was read to its end, with its events by place, and searches in them."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from math import inf
from typing import NamedTuple

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import run_continued
from tca_tools.journal.fold import History
from tca_tools.journal.whole_run import Run
from tca_tools.log.fact_rows import BAD_NEWS
from tca_wire.journal.facts import Entry, Fact, Failed, kind_of
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import Wording, subject_of


class SearchHit(NamedTuple):
    """A place that a search found, and its task; 0 for none."""

    place: int
    task: int


class Recording:
    """A run as it was written. A *place* is the number of an event, starting with 0."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        self.events: list[list[Fact]] = []
        """The facts of each event: of an entry, or of several entries of the same number."""
        self.run: Run = History.until(self._collect(entries))
        self.wording = Wording(self.run.name)
        self.failures: dict[int, bool] = {}
        """By place of a failure, in order: whether the run did not continue after it."""
        for place, event in enumerate(self.events):
            if failed := [fact for fact in event if isinstance(fact, Failed)]:
                continued = [self._run_continued(place, one) for one in failed]
                self.failures[place] = not all(continued)
        tasks = self.run.tasks.values()
        self._ends = sorted(task.time_of(Moment.END_ACHIEVING) for task in tasks)

    def _collect(self, entries: Iterable[Entry]) -> Iterator[Entry]:
        number = None
        for entry in entries:
            if entry.number != number or not self.events:
                self.events.append([])
                number = entry.number
            self.events[-1] += entry.facts
            yield entry

    def _run_continued(self, place: int, fact: Failed, known: float = inf) -> bool:
        failed = self.run.delivered(fact.id)
        time = self.run.times[place]
        return failed is not None and run_continued(self.run, failed, time, known)

    def badness(self, place: int, fact: Fact, now: int) -> bool | None:
        """Return True for bad news, None for a failure that the run survived, else False.

        A failure up to the place *now* is judged by what was known there, a later one by the whole
        journal.
        """
        if not isinstance(fact, Failed):
            return kind_of(fact) in BAD_NEWS
        known = self.run.times[now] if place <= now else inf
        return None if self._run_continued(place, fact, known) else True

    @property
    def last(self) -> int:
        """The last place."""
        return max(len(self.events) - 1, 0)

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time on the clock."""
        return self.time(0), self.time(self.last)

    def time(self, place: int) -> float:
        """Return the time on the clock at a place."""
        return self.run.clock[place] if self.run.clock else 0.0

    def at(self, place: int) -> RunAt:
        """Return the run as it was known at a place."""
        if not self.run.times:
            return RunAt(self.run)
        return RunAt(self.run, self.run.times[place], self.run.clock[place])

    def count_open_tasks(self, at: RunAt) -> int:
        """Return the number of tasks that were sent and had not ended."""
        return len(at.tasks) - bisect_right(self._ends, at.instant)

    def place_of(self, time: float) -> int:
        """Return the last place at or before *time* on the clock."""
        return max(bisect_right(self.run.clock, time) - 1, 0)

    def place_of_record(self, time: float) -> int:
        """Return the place of a time in a record."""
        return min(bisect_left(self.run.times, time), self.last)

    def next_failure(self, place: int, step: int) -> int | None:
        """Return the place of the next failure; with *step* -1, of the previous one."""
        return next(self._failures_from(place, step), None)

    def _failures_from(self, place: int, step: int) -> Iterator[int]:
        places = self.failures if step > 0 else reversed(self.failures)
        return (failure for failure in places if (failure - place) * step > 0)

    def task_of(self, fact: Fact) -> int:
        """Return the task that a fact is about, or whose handler sent the fact's message; or 0."""
        named = [subject_of(fact), getattr(fact, "origin", 0)]
        if isinstance(fact, Failed):
            message = self.run.delivered(subject_of(fact))
            if message and message.by:
                named.insert(1, message.by.message_id)
        return next((number for number in named if number in self.run.tasks), 0)

    def search(self, text: str, place: int, step: int) -> SearchHit | None:
        """Search for a task or failure from a place on.

        Args:
            text: A task's number, or a part of a task's name or of a failure's text.
            place: The place where the search starts; -1 is before the first event.
            step: 1 to search forwards, -1 to search backwards.

        Returns:
            The task with that number, at *place* or where it is sent; else the nearest place where
            a matching task is sent or a matching failure occurs; None if nothing matches.
        """
        wanted, tasks = text.casefold(), self.run.tasks
        if (number := text.strip("{}")).isdecimal() and int(number) in tasks:
            sent_at = self.place_of_record(tasks[int(number)].received)
            return SearchHit(max(place, sent_at), int(number))
        searches = self._tasks_named(wanted, place, step), self._failures_with(wanted, place, step)
        nearest = filter(None, (next(search, None) for search in searches))
        return min(nearest, key=lambda hit: hit.place * step, default=None)

    def _time_at(self, place: int) -> float:
        """Return the time in records at a place, which may lie before or after the run."""
        if place < 0:
            return -inf
        return self.run.times[place] if place <= self.last else inf

    def _tasks_named(self, wanted: str, place: int, step: int) -> Iterator[SearchHit]:
        """Yield the matching tasks that are sent after a place, or before it."""
        numbers, births = list(self.run.tasks), self.run.births
        now = self._time_at(place)
        order = numbers[bisect_right(births, now) :]
        if step < 0:
            order = numbers[: bisect_left(births, now)][::-1]
        for number in order:
            if wanted in self.run.tasks[number].name.casefold():
                sent_at = self.place_of_record(self.run.tasks[number].received)
                yield SearchHit(sent_at, number)

    def _failures_with(self, wanted: str, place: int, step: int) -> Iterator[SearchHit]:
        """Yield the matching failures after a place, or before it."""
        for here in self._failures_from(place, step):
            for fact in self.events[here]:
                if isinstance(fact, Failed) and wanted in f"{fact.failure}: {fact.text}".casefold():
                    yield SearchHit(here, self.task_of(fact))
