"""For how long a cause has been one: shorter, often, than what it keeps waiting has waited. As stories cut their waits.

Looks backwards from a moment over the turns of a wait, to where something else was the cause; that is near, as a rule.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from itertools import takewhile
from math import inf, nextafter
from operator import itemgetter
from typing import NamedTuple

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import Queueing, State
from tca_tools.why.stretches import NO_TIME
from tca_tools.why.turns import Span
from tca_tools.why.waiting import Reason, Until, awaited_children, awaits_children, of_handler, reasons_of, waits_since
from tca_tools.why.whereabouts import kept_busy
from tca_wire.points import TaskId

_LOOKS = 200
"""Moments that are looked at."""
_ENTRIES, _MORE = 64, 16
"""Entries of the journal whose turns are looked for first, and how many times as many with the next ones."""

_HANDLED = (State.HANDLING, State.PLANNING)
"""States that tell what the handler of a task waits for."""
_GO_ON = (State.HELD, State.PLANNED, State.PLANNING, State.ACHIEVING)
"""States in which a task waits that no handler has, before a suspension and after it."""


class Age(NamedTuple):
    """Since when something is so."""

    since: float | None
    """Since when its cause is the cause; None: for longer than was looked back."""
    begun: float
    """Since when it waits in all, for whatever reason; a suspension in between is a part of that."""


def age(at: RunAt, task: TaskAt, reason: str = "", *, with_children: bool = True) -> Age:
    """Since when a task waits for all that ``why_waiting`` tells, or for one *reason* of that, whatever else it waited
    for meanwhile; of what is suspended, since when it is; of a monitor, which waits for nothing, since when its
    condition is as it is.
    """
    begun = _begun(at, task)
    if task.state is State.SUSPENDED:
        return Age(begun, begun)
    if task.watches:
        since = _since_test(at, task, begun)
        return Age(since, since)
    queueing = task.queueing if task.state is State.QUEUED else None
    if queueing:  # it stays there, though it recovers from something or is suspended meanwhile
        return Age(_since_kept(at, task, queueing) if queueing.module else begun, begun)
    record, in_handler = at.run.tasks[task.id], bool(task.handling) and task.state in _HANDLED

    def reasons(at: RunAt) -> list[Reason]:
        if in_handler:
            return list(of_handler(at, at.tasks[task.id]))
        return reasons_of(at, TaskId(task.id), with_children=False)

    said, children = reasons(at), awaited_children(at, task) if with_children else None
    if reason:
        said = [one for one in said if str(one) == reason]
        children = None if said else children
    all_there = max(at.run.tasks[child].received for child in children.tasks) if children else begun

    def is_same(at: RunAt) -> bool:
        """Whether it waited for all of this. What is under it may have come one after the other."""
        awaits = not children or (at.moment >= all_there and awaits_children(at.tasks[task.id]))
        return awaits and all(map(_is_among(reasons(at)), said))

    return Age(_since(at, _stops(at, begun, lambda span: span.turns_of_task(record)), is_same), begun)


def _begun(at: RunAt, task: TaskAt) -> float:
    """Since when it waits. It goes on with a wait after a suspension."""
    begun = waits_since(task)
    if task.handling or task.state not in _GO_ON:
        return begun
    states = at.run.tasks[task.id].states
    place = bisect_right(states, at.moment, key=itemgetter(0)) - 1
    while place > 1 and [state for _, state in states[place - 2 : place]] == [task.state, State.SUSPENDED]:
        place -= 2
    return states[place][0]


def _is_among(earlier: list[Reason]) -> Callable[[Reason], bool]:
    return lambda one: one in earlier or (isinstance(one, Until) and any(map(one.is_part_of, earlier)))


def _since_kept(at: RunAt, task: TaskAt, queueing: Queueing) -> float | None:
    """Since when the same keeps a resource from a task that is queued."""
    module, resource = queueing.module, queueing.resource
    said = kept_busy(at, module, resource, task)
    stops = _stops(at, queueing.start, lambda span: span.turns_of_place(module, resource))
    return _since(at, stops, lambda at: kept_busy(at, module, resource, task) == said)


def _since(at: RunAt, stops: Iterator[float], is_same: Callable[[RunAt], bool]) -> float | None:
    """The first of the stops from which on it was the same; None if that are too many."""
    since = at.moment
    for looks, stop in enumerate(stops):
        if looks > _LOOKS:
            return None
        if looks and not is_same(_look(at, stop)):  # since the last one nothing has changed
            break
        since = stop
    return since


def _stops(at: RunAt, begun: float, turns_of: Callable[[Span], list[float]]) -> Iterator[float]:
    """When a cause may have begun that lasted, the last one first, back to when the wait began."""
    after = inf
    for span in _spans(at, begun):
        for turn in takewhile(lambda turn: turn > begun, reversed(turns_of(span))):
            if after - turn >= NO_TIME:
                yield turn
            after = turn
    if after - begun >= NO_TIME:
        yield begun


def _spans(at: RunAt, begun: float) -> Iterator[Span]:
    """Spans further and further back, each before the one before it: what is near is found without all that is not."""
    times, number, until = at.run.times, _ENTRIES, nextafter(at.moment, inf)
    last = bisect_right(times, at.moment)
    while last > number and times[last - number] > begun:
        first = times[last - number]
        yield Span(at.run, nextafter(first, -inf), until, at.memo)
        number, until = number * _MORE, first
    # Where it ends all that began later ends, too: many share what was looked for.
    yield Span(at.run, nextafter(times[last - number], -inf) if last > number else -inf, until, at.memo)


def _look(at: RunAt, moment: float) -> RunAt:
    """As it was earlier: many that wait for one thing look at the same moments."""
    found: RunAt | None = at.memo.get((age, moment))
    if found is None:
        found = at.memo[age, moment] = RunAt(at.run, moment)
    return found


def _since_test(at: RunAt, monitor: TaskAt, begun: float) -> float:
    """Since when its condition holds, or does not: the first of the tests in a row that found it so."""
    tests = at.run.tests.get(monitor.id, [])
    place = bisect_right(tests, at.moment, key=itemgetter(0))
    while place > 1 and tests[place - 2][1] == tests[place - 1][1]:
        place -= 1
    return tests[place - 1][0] if place > 1 else begun  # before the first one nothing else was known
