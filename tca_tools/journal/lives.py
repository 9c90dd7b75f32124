"""The life of a task as its clients, its server and observers see it, after its table of states. Pure.

The journal tells of a transition only where no other fact does: a handler gets a task and thereby accepts it, a task
begins anew, a task ends.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from functools import cache
from math import inf
from operator import attrgetter, itemgetter
from typing import NamedTuple

from tca_tools.journal.records import DONE, LifeChange, Task, TaskState, going_on
from tca_tools.journal.whole_run import Run
from tca_wire.errors import BadFormat
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, read_life_cycle
from tca_wire.points import Moment
from tca_wire.vocabulary import Outcome, Party

_TIME, _START, _TIME_AND_ORDER = attrgetter("time"), attrgetter("start"), itemgetter(0, 1)


def cycle_of(run: Run, task: Task) -> LifeCycle:
    """The table of its states, as declared."""
    known = run.formats.get(task.name)
    return _read(known.life_cycle) if known else GENERAL


@cache
def _read(text: str) -> LifeCycle:
    try:
        return read_life_cycle(text)
    except BadFormat:  # central refuses such: the journal is another one's
        return GENERAL


def effect_of(run: Run, task: Task, transition: str, state: str) -> Effect:
    """What a transition to a state does beside that."""
    rows = [one for one in cycle_of(run, task).transitions if one.name == transition]
    return next((one.effect for one in sorted(rows, key=lambda one: one.target != state)), Effect.NONE)


def life_of(run: Run, task: Task, moment: float = inf, since: LifeChange | None = None) -> Iterator[LifeChange]:
    """All its transitions until a moment, oldest first; or those after one of which the journal tells."""
    cycle = cycle_of(run, task)
    state, serial, begin = (
        (since.state, since.serial, (since.time, _IS_TOLD)) if since else (cycle.initial, 0, (-inf, 0))
    )
    told = (one for one in task.life if one.effect is not Effect.STOP) if since is None else ()  # stopped, it ends
    steps: list[tuple[float, int, LifeChange | None]] = [(one.time, _IS_TOLD, one) for one in told]
    steps += [(time, order, None) for time, order in _implied_steps(run, task)]
    for time, order, what in sorted(steps, key=_TIME_AND_ORDER):
        if (time, order) <= begin:
            continue
        if time > min(moment, run.time):
            return
        change = what or _implied(cycle, task, state, order, time)
        if change is not None:
            serial = what.serial if what else serial + 1
            state = change.state
            yield change._replace(serial=serial)


class Life(NamedTuple):
    """How a task stood in its life cycle."""

    state: str
    serial: int
    """How many changes there had been."""
    progress: bytes
    """The newest intermediate result since it began, if there was one."""
    asked: bytes
    """The goal that a client asked for last, if that was not decided."""
    is_telling: bool = False
    """Whether it is a state in which not every task is: neither the first one, nor running, nor an end."""


def life_at(run: Run, task: Task, moment: float = inf) -> Life:
    """How it stood at a moment."""
    cycle, told = cycle_of(run, task), task.life[: bisect_right(task.life, moment, key=_TIME)]
    state, serial, since = (told[-1].state, told[-1].serial, told[-1]) if told else (cycle.initial, 0, None)
    for one in life_of(run, task, moment, since):
        state, serial = one.state, one.serial
    newest = next((one for one in reversed(told) if one.effect is Effect.RESULT), None)
    is_old = newest is None or any(newest.time < again.start <= moment for again in task.handlings[1:])
    is_open = cycle.grant(state) is not None
    asked = (one.body for one in reversed(told) if one.effect is Effect.NEW_GOAL) if is_open else iter(())
    usual = cycle.initial, cycle.accepted.target, cycle.done, cycle.cancelled
    return Life(state, serial, b"" if is_old or not newest else newest.body, next(asked, b""), state not in usual)


_RESTARTED = "restarted"
_IS_TOLD, _BEGINS_ANEW, _BEGINS, _ENDS = range(4)


def _implied_steps(run: Run, task: Task) -> Iterator[tuple[float, int]]:
    """What else changes its state, and when; at one time it does in the order of these numbers."""
    first = task.handlings[0] if task.handlings else None
    for one in (*task.queueings, *task.handlings):
        if first is not None and one.start > first.start:
            yield one.start, _BEGINS_ANEW
    for handling in task.handlings:
        if handling.outcome is None and handling.end is not None:  # its module is gone
            yield handling.end, _BEGINS_ANEW
        offers = [one for one in run.offers.get(task.name, ()) if one.module == handling.module]
        offer = going_on(offers, handling.start)
        if offer is None or not offer.accepts:
            yield handling.start, _BEGINS
    if task.message_class.is_monitor:  # it watches without a handler, and begins anew soon after a retry
        begun = task.time_of(Moment.START_HANDLING)
        again = [
            retry.time if retry.asker is None else retry.asker.until for retry in task.retries if retry.time > begun
        ]
        yield from ((time, _BEGINS_ANEW) for time in again)
        yield from ((time, _BEGINS) for time in (begun, *again))
    if task.has_ended:
        yield task.time_of(Moment.END_ACHIEVING), _ENDS


def _implied(cycle: LifeCycle, task: Task, state: str, what: int, time: float) -> LifeChange | None:
    """The transition that another fact implies in a state; None if it does not."""
    if cycle.is_over(state):
        return None
    if what == _BEGINS_ANEW:
        goes_on = state != cycle.initial and task.was("killed", time) is None
        return LifeChange(time, _RESTARTED, cycle.initial, 0, Party.CENTRAL) if goes_on else None
    if what == _BEGINS:
        place = bisect_left(task.handlings, time, key=_START)  # a task may be handled thousands of times
        runs = [one.module for one in task.handlings[place : place + 1] if one.start == time]
        if state != cycle.initial or not (runs or task.was("killed", time) is None):
            return None
        return LifeChange(time, cycle.accepted.name, cycle.accepted.target, 0, Party.SERVER, runs[0] if runs else "")
    state_then = task.state_at(time)
    is_done, has_failed = state_then in DONE, bool(task.was("failure", time))
    outcome = Outcome.FAILED if has_failed else Outcome.KILLED
    if is_done:
        outcome = Outcome.RESOLVED if state_then is TaskState.RESOLVED else Outcome.DONE
    end = cycle.done if is_done else cycle.cancelled
    by = Party.CENTRAL if outcome is Outcome.KILLED else Party.SERVER
    return LifeChange(time, cycle.ending(state, end, outcome), end, 0, by)
