"""The moments of a task that matter at a time: those that are past, what comes next, and what has to come before."""

from bisect import bisect_right
from math import inf
from operator import attrgetter

from tca_tools.journal.records import PLACES, Task, TaskState, going_on
from tca_wire.points import END_ACHIEVING, END_HANDLING, END_PLANNING, ENDS, START_ACHIEVING, START_HANDLING
from tca_wire.rules import rules_of

NO_LATER = {is_goal: {0: 0, **rules_of(is_goal).no_later} for is_goal in (True, False)}
"""As bits all that comes no later than a moment, and the moment: of a goal (True), and of what only acts."""
_NEXT = {
    TaskState.HELD: START_HANDLING,
    TaskState.QUEUED: END_HANDLING,  # once more
    TaskState.PLANNING: END_PLANNING,
    TaskState.PLANNED: START_ACHIEVING,
    TaskState.HANDLING: END_HANDLING,
    TaskState.ACHIEVING: END_ACHIEVING,
    TaskState.RECOVERING: END_HANDLING,
    TaskState.SUSPENDED: 0,
    TaskState.ENDING: END_ACHIEVING,
}
"""The moment that a task in a state comes to next (0: it is to be resumed)."""
_START = attrgetter("start")


def killed_at(task: Task) -> float:
    """When a task was killed; inf if it was not."""
    return inf if task.killed is None else task.written("killed")


def past(task: Task, time: float) -> int:
    """The moments that a task had reached, as bits."""
    past = 0
    for moment, place in PLACES.items():
        past |= moment if task.times[place] <= time else 0
    return past


def next_moment(task: Task, state: TaskState, time: float) -> int:
    """The next moment of a task in a state; a task handled once more comes to the same one again."""
    if state is TaskState.QUEUED and task.time_of(START_HANDLING) > time:
        return START_HANDLING
    moment = _NEXT.get(state, END_ACHIEVING)
    is_past = moment == END_HANDLING and task.time_of(END_HANDLING) <= time
    return END_ACHIEVING if is_past else moment


def moments_before(task: Task, moment: int, time: float) -> int:
    """The moments that a task has to reach before that one, and that one, unless it has. A constraint between two of
    its own moments adds what comes before the first.
    """
    if task.time_of(moment) <= time:
        is_again = moment == END_HANDLING and (going_on(task.handlings, time) or task.was_retried(time))
        return END_HANDLING if is_again else 0  # it is handled again, or to be
    if killed_at(task) <= time:  # it reaches none before its handler has returned
        return END_HANDLING | (moment & ENDS)
    before = NO_LATER[task.message_class.is_goal]
    left = ~past(task, time)
    found = before[moment] & left
    known = (one.constraint for one in task.holds if one.added <= time)
    own = [one for one in known if one.before.task == task.id]
    for one in own * len(own):  # each may add what the next one needs
        found |= before[one.before.moment] & left if one.after.moment & found else 0
    return found


def is_to_be_handled_again(task: Task, time: float) -> bool:
    """Whether it was retried and not handled since, or its last handler left before it returned."""
    begun = bisect_right(task.handlings, time, key=_START)
    if not begun:
        return True
    last = task.handlings[begun - 1]
    is_cut_off = last.outcome is None and last.end is not None and last.end <= time
    return is_cut_off or task.was_retried(time)
