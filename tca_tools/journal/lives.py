"""The life cycle of a task as its clients, its server and observers see it. Pure.

The journal has a fact for a transition only if no other fact implies it. Three transitions are
implied: the call of a handler accepts the task, a task starts again, and a task ends.
"""

from bisect import bisect_right
from collections.abc import Iterator
from functools import cache
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.journal.records import DONE, Task, TaskState
from tca_tools.journal.sequences import active_at
from tca_tools.journal.whole_run import Run
from tca_wire.errors import BadFormat
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, read_life_cycle
from tca_wire.points import Moment
from tca_wire.vocabulary import Outcome

_TIME = attrgetter("time")


def cycle_of(run: Run, task: Task) -> LifeCycle:
    """Return the life cycle that a task was declared with."""
    known = run.formats.get(task.name)
    return _read(known.life_cycle) if known else GENERAL


@cache
def _read(text: str) -> LifeCycle:
    try:
        return read_life_cycle(text)
    except BadFormat:  # central refuses a bad table: it did not write this journal
        return GENERAL


def effect_of(run: Run, task: Task, transition: str, state: str) -> Effect:
    """Return the effect of a transition. Of several with its name, the one to *state* counts."""
    rows = [one for one in cycle_of(run, task).transitions if one.name == transition]
    return next(
        (one.effect for one in sorted(rows, key=lambda one: one.target != state)), Effect.NONE
    )


class Life(NamedTuple):
    """The place of a task in its life cycle."""

    state: str
    serial: int
    """The number of changes so far."""
    progress: bytes
    """The newest intermediate result since its handler started; empty if there was none."""
    asked: bytes
    """The newest requested goal, while the server has not decided on it."""
    is_notable: bool = False
    """Whether the state is neither initial, running, nor a usual end, so it is worth showing."""


def life_at(run: Run, task: Task, instant: float = inf) -> Life:
    """Return the place of a task in its life cycle at an instant."""
    cycle, changes = cycle_of(run, task), task.life[: bisect_right(task.life, instant, key=_TIME)]
    # Start at the last recorded step: its serial number counts the implied steps before it, too
    state, serial, since = cycle.initial, 0, (-inf, _RECORDED)
    if changes:
        last = changes[-1]
        state, serial, since = last.state, last.serial, (last.time, _RECORDED)
    until = min(instant, run.time)
    steps = (one for one in _implied_steps(run, task) if one > since and one[0] <= until)
    for time, step in sorted(steps):
        following = _after(cycle, task, state, step, time)
        state, serial = following, serial + (following != state)
    newest = next((one for one in reversed(changes) if one.effect is Effect.RESULT), None)
    later = task.handlings[1:]
    is_old = newest is None or any(newest.time < one.start <= instant for one in later)
    is_open = cycle.grant(state) is not None
    asked = (one.body for one in reversed(changes) if is_open and one.effect is Effect.NEW_GOAL)
    is_usual = state in (cycle.initial, cycle.accepted.target, cycle.done, cycle.cancelled)
    return Life(
        state,
        serial,
        b"" if is_old or not newest else newest.body,
        next(asked, b""),
        not is_usual,
    )


_RECORDED, _RESTARTS, _STARTS, _ENDS = range(4)
"""Steps of a life cycle, in their order at one time; the first has a fact of its own."""


def _implied_steps(run: Run, task: Task) -> Iterator[tuple[float, int]]:
    """Yield the implied steps with their times."""
    first = task.handlings[0] if task.handlings else None
    for one in (*task.queueings, *task.handlings):
        if first is not None and one.start > first.start:
            yield one.start, _RESTARTS
    for handling in task.handlings:
        if handling.outcome is None and handling.end is not None:  # its module left
            yield handling.end, _RESTARTS
        offers = [one for one in run.offers.get(task.name, ()) if one.module == handling.module]
        offer = active_at(offers, handling.start)
        if offer is None or not offer.accepts:
            yield handling.start, _STARTS
    # A monitor watches without a handler, and starts again once the retry's asker has returned
    if task.message_class.is_monitor:
        begun = task.time_of(Moment.START_HANDLING)
        restarts = [
            retry.time if retry.asker is None else retry.asker.until
            for retry in task.retries
            if retry.time > begun
        ]
        yield from ((time, _RESTARTS) for time in restarts)
        yield from (
            (time, _STARTS) for time in (begun, *restarts) if task.value_at("killed", time) is None
        )
    if task.has_ended:
        yield task.time_of(Moment.END_ACHIEVING), _ENDS


def _after(cycle: LifeCycle, task: Task, state: str, step: int, time: float) -> str:
    """Return the state after a step."""
    if cycle.is_over(state):
        return state
    if step == _STARTS:
        return cycle.accepted.target if state == cycle.initial else state
    if step == _RESTARTS:
        return cycle.initial if task.value_at("killed", time) is None else state
    end, chosen = task.state_at(time), task.failure.name
    if end in DONE:
        outcome = Outcome.RESOLVED if end is TaskState.RESOLVED else Outcome.DONE
        chosen = task.handlings[-1].transition if task.handlings else ""
    else:
        is_failed = bool(task.failure) and not task.is_dealt_with
        outcome = Outcome.FAILED if is_failed else Outcome.KILLED
    return cycle.end(state, outcome, chosen).target
