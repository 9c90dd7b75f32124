"""Track whether the run continued after each failure. Pure; journal/fates.py decides."""

from collections.abc import Iterable, Iterator

from tca_tools.journal.fates import run_continued, still_deciding
from tca_tools.journal.records import Message
from tca_tools.journal.whole_run import Run


class Verdicts:
    """The failures by their numbers.

    A verdict is computed again only when a record changes that can change it.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._failures: dict[int, tuple[Message, float]] = {}
        """The failures without a final verdict: the failed message, and the time."""
        self._good: set[int] = set()
        """The failures among them after which the run continued, by the last verdict."""
        self._on_change: dict[int, dict[int, None]] = {}
        """The failures whose verdict depends on a record, by the record's identity."""
        self._new: dict[int, None] = {}

    def follow(self, number: int, failed: Message, time: float) -> None:
        """Track a new failure. Its first verdict is that the run did not continue."""
        self._failures[number] = failed, time
        self._new[number] = None

    def changed(self, news: Iterable[object]) -> Iterator[tuple[int, bool]]:
        """Yield the failures whose verdict differs after a change of the given records."""
        affected, self._new = self._new, {}
        for record in news:
            if id(record) in self._on_change:
                affected |= self._on_change.pop(id(record))
        for number in affected:
            if number in self._failures:
                yield from self._update(number, *self._failures[number])

    def _update(self, number: int, failed: Message, time: float) -> Iterator[tuple[int, bool]]:
        is_good = run_continued(self._run, failed, time)
        if is_good != (number in self._good):
            yield number, is_good
        (self._good.add if is_good else self._good.discard)(number)
        undecided = still_deciding(self._run, failed, time)
        for record in undecided:
            self._on_change.setdefault(id(record), {})[number] = None
        if not undecided:
            del self._failures[number]
            self._good.discard(number)
