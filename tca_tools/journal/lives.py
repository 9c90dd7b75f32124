"""The life of a task as its clients, its server and observers see it, after its table of states.
Pure.

The journal tells of a transition only where no other fact does: a handler gets a task and thereby
accepts it, a task begins anew, a task ends.
"""

from bisect import bisect_right
from collections.abc import Iterator
from functools import cache
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.journal.records import DONE, Task, going_on
from tca_tools.journal.whole_run import Run
from tca_wire.errors import BadFormat
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, read_life_cycle
from tca_wire.points import Moment

_TIME = attrgetter("time")


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
    return next(
        (one.effect for one in sorted(rows, key=lambda one: one.target != state)), Effect.NONE
    )


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
    """Whether it is a state in which not every task is: neither the first one, nor running, nor an
    end.
    """


def life_at(run: Run, task: Task, moment: float = inf) -> Life:
    """How it stood at a moment."""
    cycle, told = cycle_of(run, task), task.life[: bisect_right(task.life, moment, key=_TIME)]
    state, serial, since = cycle.initial, 0, (-inf, _IS_TOLD)
    if told:
        state, serial, since = told[-1].state, told[-1].serial, (told[-1].time, _IS_TOLD)
    until = min(moment, run.time)
    for time, step in sorted(
        one for one in _implied_steps(run, task) if one > since and one[0] <= until
    ):
        following = _after(cycle, task, state, step, time)
        state, serial = following, serial + (following != state)
    newest = next((one for one in reversed(told) if one.effect is Effect.RESULT), None)
    is_old = newest is None or any(
        newest.time < again.start <= moment for again in task.handlings[1:]
    )
    is_open = cycle.grant(state) is not None
    asked = (
        (one.body for one in reversed(told) if one.effect is Effect.NEW_GOAL)
        if is_open
        else iter(())
    )
    usual = cycle.initial, cycle.accepted.target, cycle.done, cycle.cancelled
    return Life(
        state,
        serial,
        b"" if is_old or not newest else newest.body,
        next(asked, b""),
        state not in usual,
    )


_IS_TOLD, _BEGINS_ANEW, _BEGINS, _ENDS = range(4)
"""Steps of a life, in their order at one time."""


def _implied_steps(run: Run, task: Task) -> Iterator[tuple[float, int]]:
    """What else changes its state, and when."""
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
    if (
        task.message_class.is_monitor
    ):  # it watches without a handler, and begins anew soon after a retry
        begun = task.time_of(Moment.START_HANDLING)
        again = [
            retry.time if retry.asker is None else retry.asker.until
            for retry in task.retries
            if retry.time > begun
        ]
        yield from ((time, _BEGINS_ANEW) for time in again)
        yield from ((time, _BEGINS) for time in (begun, *again) if task.was("killed", time) is None)
    if task.has_ended:
        yield task.time_of(Moment.END_ACHIEVING), _ENDS


def _after(cycle: LifeCycle, task: Task, state: str, step: int, time: float) -> str:
    """The state after a step."""
    if cycle.is_over(state):
        return state
    if step == _BEGINS:
        return cycle.accepted.target if state == cycle.initial else state
    if step == _BEGINS_ANEW:
        return cycle.initial if task.was("killed", time) is None else state
    return cycle.done if task.state_at(time) in DONE else cycle.cancelled
