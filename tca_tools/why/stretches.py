"""A wait told in stretches, one for each cause: causes change, and each has a time of its own."""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from itertools import pairwise
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Claim, HandlerWait, Message, Queueing, State, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.turns import Span
from tca_tools.why.waiting import Reason, Until, reasons_of
from tca_tools.why.whereabouts import claim_and_why, kept_busy
from tca_wire.points import TaskId

NO_TIME = 1e-6
"""Seconds: of what lasts no longer nothing is told."""
_MOST = 10
"""Causes that are told at each end of a wait; of what is between them only that there were others."""
_FEW = 3
"""The same where people read them."""
_LOOKS = 200
"""Moments at each end that are looked at."""
OTHERS = "for other causes, one after the other"
"""Said of those that are not told one by one."""
_OTHERS: list[Reason] = [OTHERS]
Why = Callable[[RunAt], list[Reason]]


class Stretch(NamedTuple):
    """As long as a cause was the same. Of many tasks that were waited for together, of which some were done, too: as it
    was in the beginning, until there were so few that all are named.
    """

    start: float
    end: float | None
    why: str
    tasks: frozenset[int] = frozenset()
    """All that were waited for together, though not all are named."""


def in_state(run: Run, task: Task, number: int, moment: float = inf) -> list[Stretch]:
    """What a task waited for in the state that is the *number*-th of its own; "" for nothing, or where its handler and
    its tests tell of it.
    """
    (start, state), end = task.states[number], task.states[number + 1][0] if number + 1 < len(task.states) else None
    if state is State.PLANNING:
        return [Stretch(start, end, "")]

    def why(at: RunAt) -> list[Reason]:
        return [] if at.tasks[task.id].watches else reasons_of(at, TaskId(task.id))

    span = Span(run, start, end)
    return _stretches(span, span.turns_of_task(task), why, moment)


def still_open(run: Run, task: Task, part: Stretch, moment: float) -> int:
    """How many of the tasks of a stretch were still waited for at a moment of it."""
    return len(part.tasks & _tasks(reasons_of(RunAt(run, moment), TaskId(task.id))))


def in_queue(run: Run, queueing: Queueing, message: Message, moment: float = inf) -> list[Stretch]:
    """What kept a resource from a message; "" if the journal does not tell."""
    module, resource = queueing.module, queueing.resource
    span = Span(run, queueing.start, queueing.end)
    turns = span.turns_of_place(module, resource)
    return _stretches(span, turns, lambda at: [kept_busy(at, module, resource, message)], moment)


def in_queue_briefly(run: Run, queueing: Queueing, message: Message, moment: float) -> list[Stretch]:
    """The same for people to read: of many like causes some are named, and how many more there were."""
    return _briefly(in_queue(run, queueing, message, moment), moment, lambda parts: _others(run, queueing, parts))


def _others(run: Run, queueing: Queueing, parts: list[Stretch]) -> str:
    """How many messages were handled one after the other, if nothing else kept a resource from one that was queued."""
    module, resource, start, end = queueing.module, queueing.resource, parts[0].start, parts[-1].end or inf
    claims = [one for one in run.asked_for(module, resource) if one.start < end and (one.end or inf) > start]
    if claims or not all(part.why == OTHERS or part.why.startswith("busy with ") for part in parts):
        return OTHERS
    runs = run.runs.get((module, resource), [])
    begun, known = (bisect_left(runs, time, key=attrgetter("start")) for time in (start, end))
    return f"busy with {known - begun} others, one after the other"


def for_claim(run: Run, wait: HandlerWait, claim: Claim, moment: float = inf) -> list[Stretch]:
    """The claim for which a handler waited, with what kept it from it."""
    span = Span(run, wait.start, wait.end)
    return _stretches(span, span.turns_of_claim(claim), lambda at: [claim_and_why(at, claim)], moment)


def for_claim_briefly(run: Run, wait: HandlerWait, claim: Claim, moment: float) -> list[Stretch]:
    """The same for people to read."""
    return _briefly(for_claim(run, wait, claim, moment), moment, lambda _: OTHERS)


def _stretches(span: Span, turns: list[float], why: Why, moment: float) -> list[Stretch]:
    """The causes of a wait as *why* tells them; *turns* are when they may have changed.

    Of very many only the first and last ones until *moment* are told one by one, and of those after it likewise: what
    is told of a moment stays the same when time goes on.
    """
    stops = _lasting(span, turns)
    known = bisect_right(stops, moment)
    looks = _Looks(span.run, why)
    told = [*looks.at(stops[:known]), *looks.at(stops[known:])]
    told[0] = (span.start, told[0][1])
    changed = [told[0], *(after for before, after in pairwise(told) if _is_news(before[1], after[1]))]
    ends = [*(start for start, _ in changed[1:]), None if span.end == inf else span.end]
    return [
        Stretch(start, end, " and ".join(map(str, reasons)), _tasks(reasons))
        for (start, reasons), end in zip(changed, ends, strict=True)
    ]


def _briefly(parts: list[Stretch], moment: float, said: Callable[[list[Stretch]], str]) -> list[Stretch]:
    """The first and the last ones that had begun at a moment, and of those after it likewise; those between as one."""
    known, found = bisect_right(parts, moment, key=attrgetter("start")), list[Stretch]()
    for some in (parts[:known], parts[known:]):
        middle = some[_FEW:-_FEW]
        if len(middle) > 1:
            some[_FEW:-_FEW] = [Stretch(middle[0].start, middle[-1].end, said(middle))]
        found += some
    return found


def _tasks(reasons: list[Reason]) -> frozenset[int]:
    return frozenset(task for one in reasons if isinstance(one, Until) for task in one.tasks)


def _is_news(before: list[Reason], after: list[Reason]) -> bool:
    """Whether there is more to tell than that some of many are done."""
    return len(before) != len(after) or not all(
        one == other or (isinstance(one, Until) and one.goes_on_in(other))
        for one, other in zip(before, after, strict=True)
    )


def _lasting(span: Span, turns: list[float]) -> list[float]:
    """When a cause may have begun that lasted."""
    stops = [span.start, *turns]
    return [start for start, end in pairwise([*stops, span.end]) if end - start >= NO_TIME] or [span.start]


class _Looks:
    """Looks at some moments of many."""

    def __init__(self, run: Run, why: Why) -> None:
        self._run = run
        self._why = why

    def at(self, stops: list[float]) -> list[tuple[float, list[Reason]]]:
        """What was told at each; of very many at the first and the last ones, and that there were others."""
        first = list(self._some(stops))
        rest = stops[len(first) :]
        if not rest:
            return first
        last = list(self._some(rest[::-1], is_back=True))[::-1]
        is_cut = len(rest) > len(last) and _is_news(first[-1][1], last[0][1])
        return [*first, *([(rest[0], _OTHERS)] if is_cut else []), *last]

    def _some(self, stops: list[float], *, is_back: bool = False) -> Iterator[tuple[float, list[Reason]]]:
        changes, before = 0, _OTHERS
        for stop in stops[:_LOOKS]:
            reasons = self._why(RunAt(self._run, stop))
            changes += _is_news(reasons, before) if is_back else _is_news(before, reasons)
            if changes > _MOST:
                return
            before = reasons
            yield stop, reasons
