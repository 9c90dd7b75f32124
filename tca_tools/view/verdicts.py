"""Whether the run went on after each failure, told anew whenever that changes. Pure;
journal/fates.py decides.
"""

from collections.abc import Iterable, Iterator

from tca_tools.journal.fates import Failing, run_continued, undecided_by
from tca_tools.journal.whole_run import Run


class Verdicts:
    """Failures by their numbers. Each is looked at again only when something changes on which its
    verdict undecided_by.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._failures: dict[int, tuple[Failing, float]] = {}
        """Those of which it is not settled: what failed, and when."""
        self._good: set[int] = set()
        """Those of them after which the run went on, as it was told last."""
        self._on_change: dict[int, dict[int, None]] = {}
        """Which failures hinge on a record, by its identity."""
        self._new: dict[int, None] = {}

    def follow(self, number: int, failed: Failing, time: float) -> None:
        """From now on, a failure that has just been raised; until told otherwise the run did not go
        on after it.
        """
        self._failures[number] = failed, time
        self._new[number] = None

    def changed(self, news: Iterable[object]) -> Iterator[tuple[int, bool]]:
        """The failures of which it is otherwise than it was, now that so many records have
        changed.
        """
        again, self._new = self._new, {}
        for record in news:
            if id(record) in self._on_change:
                again |= self._on_change.pop(id(record))
        for number in again:
            if number in self._failures:
                yield from self._look_at(number, *self._failures[number])

    def _look_at(self, number: int, failed: Failing, time: float) -> Iterator[tuple[int, bool]]:
        is_good = run_continued(self._run, failed, time)
        if is_good != (number in self._good):
            yield number, is_good
        (self._good.add if is_good else self._good.discard)(number)
        open_still = undecided_by(self._run, failed, time)
        for record in open_still:
            self._on_change.setdefault(id(record), {})[number] = None
        if not open_still:
            del self._failures[number]
            self._good.discard(number)
