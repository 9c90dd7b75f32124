"""A journal that was read to its end: its entries, all records, and where in it what is. Pure; knows no terminal."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from math import inf

from tca_tools.log.__main__ import BAD_NEWS
from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import went_on
from tca_tools.run.fold import History
from tca_tools.run.whole_run import Run
from tca_wire.journal import facts
from tca_wire.journal.facts import kind_of
from tca_wire.points import ROOT, Moment
from tca_wire.text.facts_in_words import Wording


class Recording:
    """A run as it was written. A *place* is the number of an event, from 0 on."""

    def __init__(self, entries: Iterable[facts.Entry]) -> None:
        self.events: list[list[facts.Entry]] = []
        """The entries of each event: one, or several of the same number."""
        self.failures: list[int] = []
        """The places at which something failed."""
        self._failed: list[tuple[int, int]] = []
        """The same with what failed: a message or delivery."""
        self.run: Run = History.until(self._kept(entries))
        self.wording = Wording(self.run.name)
        self.bad = {place for place, number in self._failed if not self._has_coped(place, number)}
        """Those of them after which the run did not go on, as far as the journal tells."""
        self.depths = _depths(self.run)
        self.sizes = _sizes(self.run)

    def _kept(self, entries: Iterable[facts.Entry]) -> Iterator[facts.Entry]:
        number = None
        for entry in entries:
            if entry.number != number or not self.events:
                self.events.append([])
                number = entry.number
            self.events[-1].append(entry)
            for fact in entry.facts:
                if isinstance(fact, facts.Failed):
                    self._note_failure(len(self.events) - 1, fact.id)
            yield entry

    def _note_failure(self, place: int, number: int) -> None:
        self._failed.append((place, number))
        if self.failures[-1:] != [place]:
            self.failures.append(place)

    def _has_coped(self, place: int, number: int, known: float = inf) -> bool:
        failed = self.run.delivered(number)
        return failed is not None and went_on(self.run, failed, self.run.times[place], known)

    def is_bad_news(self, place: int, fact: facts.Fact, now: int) -> bool | None:
        """Whether a fact is bad news; None: it was, and the run had gone on by the place that is looked at *now*; of
        what comes later, as far as the journal tells.
        """
        if isinstance(fact, facts.Failed):
            return None if self._has_coped(place, fact.id, self.run.times[now] if place <= now else inf) else True
        return kind_of(fact) in BAD_NEWS

    @property
    def last(self) -> int:
        """The last place."""
        return max(len(self.events) - 1, 0)

    def time(self, place: int) -> float:
        """What the clock showed."""
        return self.run.clock[place] if self.run.clock else 0.0

    def at(self, place: int) -> RunAt:
        """What was known at a place."""
        if not self.run.times:
            return RunAt(self.run)
        return RunAt(self.run, self.run.times[place], self.run.clock[place])

    def place_of(self, time: float) -> int:
        """The last place at which the clock showed no more than *time*."""
        return max(bisect_right(self.run.clock, time) - 1, 0)

    def place_of_record(self, time: float) -> int:
        """The place of a time that a record tells."""
        return min(bisect_left(self.run.times, time), self.last)

    def facts(self, place: int) -> Iterator[facts.Fact]:
        """What happened there."""
        for entry in self.events[place]:
            yield from entry.facts

    def next_failure(self, place: int, step: int) -> int | None:
        """The next place at which something failed, or (step -1) the one before."""
        if step > 0:
            found = self.failures[bisect_right(self.failures, place) :][:1]
        else:
            found = self.failures[: bisect_left(self.failures, place)][-1:]
        return found[0] if found else None

    def search(self, text: str, place: int, step: int) -> int | None:
        """The next task (or, step -1, the one before) that is sent after a place and has *text* in its name, or is of
        that number.
        """
        wanted, numbers = text.casefold(), list(self.run.tasks)
        if wanted.strip("{}").isdecimal() and int(wanted.strip("{}")) in self.run.tasks:
            return int(wanted.strip("{}"))
        now = self.run.times[place] if self.run.times else 0.0
        here = bisect_right(self.run.births, now) if step > 0 else bisect_left(self.run.births, now)
        order = numbers[here:] if step > 0 else reversed(numbers[:here])
        return next((number for number in order if wanted in self.run.tasks[number].name.casefold()), None)


def _depths(run: Run) -> dict[int, int]:
    """How deep each task is: parents have smaller numbers, and come first where numbers are in order."""
    depths = {int(ROOT): -1}
    for number in sorted(run.tasks):
        depths[number] = depths[run.tasks[number].parent] + 1
    return depths


def _sizes(run: Run) -> dict[int, int]:
    """How many tasks each subtree has in the end."""
    sizes = dict.fromkeys(run.tasks, 1)
    for number in sorted(run.tasks, reverse=True):
        if (parent := run.tasks[number].parent) != ROOT:
            sizes[parent] += sizes[number]
    return sizes


class Living:
    """The tasks that had been sent and not ended, by what they are under. Moving costs what changes in between."""

    def __init__(self, run: Run) -> None:
        self._births = [(task.received, number, task.parent) for number, task in run.tasks.items()]
        ends = [(task.reached[Moment.END_ACHIEVING], number, task.parent)
                for number, task in run.tasks.items() if Moment.END_ACHIEVING in task.reached]  # fmt: skip
        self._ends = sorted(ends)
        self._born = self._ended = 0
        self.below: dict[int, dict[int, None]] = {}

    def move(self, time: float) -> None:
        """Be at *time*."""
        while self._born < len(self._births) and self._births[self._born][0] <= time:
            self._add(self._births[self._born])
            self._born += 1
        while self._ended < len(self._ends) and self._ends[self._ended][0] <= time:
            self._remove(self._ends[self._ended])
            self._ended += 1
        while self._ended and self._ends[self._ended - 1][0] > time:
            self._ended -= 1
            self._add(self._ends[self._ended])
        while self._born and self._births[self._born - 1][0] > time:
            self._born -= 1
            self._remove(self._births[self._born])

    @property
    def number(self) -> int:
        """How many there are."""
        return self._born - self._ended

    def _add(self, one: tuple[float, int, int]) -> None:
        self.below.setdefault(one[2], {})[one[1]] = None

    def _remove(self, one: tuple[float, int, int]) -> None:
        children = self.below.get(one[2], {})
        children.pop(one[1], None)
        if not children:
            self.below.pop(one[2], None)
