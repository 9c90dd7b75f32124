"""When what something waits for may have changed: the times of all that waiting.py looks at.

There may be too many of them: who asks looks what was so then.
"""

from collections.abc import Iterable, Iterator
from itertools import chain
from math import inf
from typing import Any

from tca_tools.run.records import Claim, HandlerWait, Handling, Message, Queueing, Task
from tca_tools.run.whole_run import Run
from tca_wire.points import ROOT, Moment
from tca_wire.text.facts_in_words import called

_OF_CHILDREN = (Moment.END_PLANNING, Moment.END_ACHIEVING)


class Span:
    """From when until when is asked."""

    def __init__(self, run: Run, start: float, end: float | None, memo: dict[object, Any] | None = None) -> None:
        self.run = run
        self.start = start
        self.end = inf if end is None else end
        self._memo = {} if memo is None else memo
        """What others that ask of the same span, too, need not look for again."""

    def turns_of_task(self, task: Task) -> list[float]:
        """When the reasons may have changed for which a task waits, in order."""
        return self._sorted(chain(self._own(task), self._of_family(task), self._of_runs(task), self._of_queues(task)))

    def turns_of_place(self, module: str, resource: str) -> list[float]:
        """When that may have changed what keeps a resource busy, in order."""
        return self._sorted(self._of_place(module, resource))

    def turns_of_claim(self, claim: Claim) -> list[float]:
        """The same of what keeps a resource from who wants it for himself: in all copies of its module."""
        places = (self._of_place(module, claim.resource) for module in self._copies(claim.module))
        return self._sorted(chain.from_iterable(places))

    def _copies(self, module: str) -> list[str]:
        return [one for one in self.run.modules if called(one) == called(module)]

    def _sorted(self, times: Iterable[float | None]) -> list[float]:
        return sorted({time for time in times if time is not None and self.start < time < self.end})

    def _meets(self, start: float, end: float | None) -> bool:
        return start < self.end and (end is None or end > self.start)

    def _own(self, task: Task) -> Iterator[float | None]:
        yield from (time for time, _, _ in task.changes)
        yield from (one.time for one in task.retries)
        yield from task.reached.values()
        tasks = self.run.tasks
        for hold in task.holds:
            yield from (hold.added, hold.over)
            before = hold.constraint.before
            if before.task in tasks:
                yield tasks[before.task].reached.get(before.moment)
        yield from (tasks[handler].received for handler in task.caught_by if handler in tasks)
        for suspension in task.suspensions:
            yield from (suspension.start, suspension.end)
            if self._meets(suspension.start, suspension.end):
                for run in suspension.still:
                    yield from (run.end, *_ends(run.waits))

    def _of_family(self, task: Task) -> Iterator[float | None]:
        """What is above it, and what is under it."""
        tasks = self.run.tasks
        if task.parent != ROOT and task.parent in tasks:
            yield from tasks[task.parent].reached.values()
        for number in task.children:
            child = tasks[number]
            yield child.received
            yield from (child.reached.get(moment) for moment in _OF_CHILDREN)

    def _of_runs(self, task: Task) -> Iterator[float | None]:
        """What its handler waited for or asked."""
        for run in task.handlings:
            yield from (run.start, run.end)
            if not self._meets(run.start, run.end):
                continue
            yield from self._of_waits(run)
            for query in run.asked or ():
                yield from (query.received, query.answered, *(time for time, _, _ in query.changes))
                if self._meets(query.received, query.answered):
                    yield from self._of_whereabouts(query)

    def _of_waits(self, run: Handling) -> Iterator[float | None]:
        for wait in run.waits:
            yield from (wait.start, wait.end)
            if not self._meets(wait.start, wait.end):
                continue
            if claim := self.run.claims.get(wait.awaited):
                for module in self._copies(claim.module):
                    yield from self._of_place(module, claim.resource)
            elif not wait.moment and (message := self.run.messages.get(wait.awaited)):
                yield from self._of_whereabouts(message)

    def _of_whereabouts(self, message: Message) -> Iterator[float | None]:
        yield from _ends(message.handlings)
        yield from self._of_queues(message)
        yield from self._of_queueings(self.run.copies.get(message.id, ()))
        yield message.answered

    def _of_queues(self, message: Message) -> Iterator[float | None]:
        yield from self._of_queueings(message.queueings)

    def _of_queueings(self, queueings: Iterable[Queueing]) -> Iterator[float | None]:
        for queueing in queueings:
            yield from (queueing.start, queueing.end)
            if queueing.module and self._meets(queueing.start, queueing.end):
                yield from self._of_place(queueing.module, queueing.resource)

    def _of_place(self, module: str, resource: str) -> list[float]:
        """What was handled there, and who had it, or wanted it, for himself."""
        key = (Span, self.start, self.end, module, resource)
        if (found := self._memo.get(key)) is None:
            found = self._memo[key] = self._sorted(self._there(module, resource))
        turns: list[float] = found
        return turns

    def _there(self, module: str, resource: str) -> Iterator[float | None]:
        for run in self.run.runs.get((module, resource), ()):
            if run.start >= self.end:
                break
            yield from (run.start, run.end)
        for claim in self.run.asked_for(module, resource):
            if self._meets(claim.start, None):
                yield from (claim.start, claim.granted, claim.end, claim.by.end if claim.by else None)
        if known := self.run.modules.get(module):
            yield from (time for time, _ in known.sizes.get(resource, ()))


def _ends(spans: Iterable[Handling | HandlerWait | Queueing | Claim]) -> Iterator[float | None]:
    for span in spans:
        yield from (span.start, span.end)
