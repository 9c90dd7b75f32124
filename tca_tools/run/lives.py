"""The life of a task as its clients, its server and observers see it, after its table of states. Pure.

The journal tells of a transition only where no other fact does: a handler gets a task and thereby accepts it, a task
begins anew, a task ends.
"""

from collections.abc import Iterator
from functools import cache
from math import inf
from typing import NamedTuple

from tca_tools.run.records import LifeChange, Task, TaskState, going_on
from tca_tools.run.whole_run import Run
from tca_wire.errors import BadFormat
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, read_life_cycle
from tca_wire.points import Moment
from tca_wire.vocabulary import Party


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


def life_of(run: Run, task: Task, moment: float = inf) -> Iterator[LifeChange]:
    """All its transitions until a moment, oldest first."""
    cycle, state, serial = cycle_of(run, task), "", 0
    state = cycle.initial
    for time, _, what in sorted(_steps(run, task), key=lambda step: step[:2]):
        if time > min(moment, run.time):
            return
        change = what if isinstance(what, LifeChange) else _implied(cycle, task, state, what, time)
        if change is not None:
            serial = change.serial if change is what else serial + 1
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
    cycle = cycle_of(run, task)
    usual = cycle.initial, cycle.accepted.target, cycle.done, cycle.cancelled
    life = Life(cycle.initial, 0, b"", b"")
    for one in life_of(run, task, moment):
        progress = one.body if one.effect is Effect.RESULT else b"" if one.transition == _RESTARTED else life.progress
        asked = life.asked if one.effect is Effect.RESULT else one.body if one.effect is Effect.NEW_GOAL else b""
        life = Life(one.state, one.serial, progress, asked, one.state not in usual)
    return life


_RESTARTED = "restarted"
_BEGINS_ANEW, _BEGINS, _ENDS = range(1, 4)


def _steps(run: Run, task: Task) -> Iterator[tuple[float, int, LifeChange | int]]:
    """What changes its state; at one time what was told comes first, then in the order of a life."""
    yield from ((one.time, 0, one) for one in task.life if one.effect is not Effect.STOP)  # it ends when it has stopped
    first = task.handlings[0] if task.handlings else None
    for one in (*task.queueings, *task.handlings):
        if first is not None and one.start > first.start:
            yield one.start, _BEGINS_ANEW, _BEGINS_ANEW
    for handling in task.handlings:
        if handling.outcome is None and handling.end is not None:  # its module is gone
            yield handling.end, _BEGINS_ANEW, _BEGINS_ANEW
        offers = [one for one in run.offers.get(task.name, ()) if one.module == handling.module]
        offer = going_on(offers, handling.start)
        if offer is None or not offer.accepts:
            yield handling.start, _BEGINS, _BEGINS
    if task.message_class.is_monitor:  # it watches without a handler, and begins anew soon after a retry
        begun = task.time_of(Moment.START_HANDLING)
        again = [
            retry.time if retry.asker is None else retry.asker.until for retry in task.retries if retry.time > begun
        ]
        yield from ((time, _BEGINS_ANEW, _BEGINS_ANEW) for time in again)
        yield from ((time, _BEGINS, _BEGINS) for time in (begun, *again))
    if task.has_ended:
        yield task.time_of(Moment.END_ACHIEVING), _ENDS, _ENDS


def _implied(cycle: LifeCycle, task: Task, state: str, what: int, time: float) -> LifeChange | None:
    """The transition that another fact implies in a state; None if it does not."""
    if cycle.is_over(state):
        return None
    if what == _BEGINS_ANEW:
        goes_on = state != cycle.initial and task.was("killed", time) is None
        return LifeChange(time, _RESTARTED, cycle.initial, 0, Party.CENTRAL) if goes_on else None
    if what == _BEGINS:
        runs = [one.module for one in task.handlings if one.start == time]
        if state != cycle.initial or not (runs or task.was("killed", time) is None):
            return None
        return LifeChange(time, cycle.accepted.name, cycle.accepted.target, 0, Party.SERVER, runs[0] if runs else "")
    is_done = task.state_at(time) is TaskState.ACHIEVED
    has_failed = not is_done and bool(task.was("failure", time))
    end = cycle.done if is_done else cycle.cancelled
    by = Party.SERVER if is_done or has_failed else Party.CENTRAL
    return LifeChange(time, cycle.ending(state, end, failed=has_failed), end, 0, by)
