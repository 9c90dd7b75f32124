"""Why a task does not go on, in plain words. Asks a history; changes nothing."""

from collections.abc import Iterator

from tca_tools.history import History
from tca_tools.records import State, Task
from tca_wire.constraints import Constraint
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.wording import place

_CLAUSES = {
    Moment.START_HANDLING: "is being handled",
    Moment.END_HANDLING: "has been handled",
    Moment.START_PLANNING: "is being planned",
    Moment.END_PLANNING: "is planned",
    Moment.START_ACHIEVING: "is being achieved",
    Moment.END_ACHIEVING: "is achieved",
}
_OF_FAMILY = (Moment.START_PLANNING, Moment.START_ACHIEVING)
"""The moments that a task reaches only after its parent has."""
_NAMED = 3
"""How many subtasks a reason names."""


def why_waiting(history: History, task_id: TaskId) -> list[str]:
    """What keeps a task waiting: ``["until take steps {2} is achieved"]``; nothing if it is over or unknown."""
    task = history.tasks.get(task_id)
    reasons = _REASONS.get(task.state) if task else None
    return list(dict.fromkeys(reasons(history, task))) if task and reasons else []


def _of_held(history: History, task: Task) -> Iterator[str]:
    first = Moment.START_PLANNING if task.message_class.is_goal else Moment.START_ACHIEVING
    return _held_back(history, task, [Moment.START_HANDLING, first])


def _of_planned(history: History, task: Task) -> Iterator[str]:
    return _held_back(history, task, [Moment.START_ACHIEVING])


def _of_queued(history: History, task: Task) -> Iterator[str]:
    queueing = task.queueing
    if not queueing or not queueing.module:
        yield f"for a module that handles {task.name}"
        return
    where = place(queueing.module, queueing.resource)
    held_by = history.held_by.get((queueing.module, queueing.resource))
    if held_by and not (held_by.is_reserved and held_by.sender == task.sender):
        yield f"for {where}, which {held_by.sender} has {'reserved' if held_by.is_reserved else 'locked'}"
        return
    busy = [history.describe(handling.message_id) for handling in history.running(queueing.module, queueing.resource)]
    yield f"for {where}" + (f", busy with {_listed(busy)}" if busy else "")


def _of_handled(history: History, task: Task) -> Iterator[str]:
    """A handler that runs may block."""
    for wait in task.handling.waits[-1:] if task.handling else []:
        if wait.end is None and wait.moment:
            yield _until(history, Point(TaskId(wait.awaited), wait.moment))
        elif wait.end is None and wait.awaited in history.claims:
            yield f"for the {history.describe(wait.awaited)}"
        elif wait.end is None:
            yield f"for the reply to {history.describe(wait.awaited)}"


def _of_planning(history: History, task: Task) -> Iterator[str]:
    if task.handling:
        return _of_handled(history, task)
    return _of_children(history, task, Moment.END_PLANNING)


def _of_achieving(history: History, task: Task) -> Iterator[str]:
    yield from _held_back(history, task, [Moment.END_PLANNING, Moment.END_ACHIEVING])
    yield from _of_children(history, task, Moment.END_ACHIEVING)


def _of_children(history: History, task: Task, moment: Moment) -> Iterator[str]:
    open_ones = [str(history.tasks[child]) for child in task.children if moment not in history.tasks[child].reached]
    if open_ones:
        yield f"until {_listed(open_ones)} {'are' if len(open_ones) > 1 else 'is'} {_CLAUSES[moment][3:]}"


def _held_back(history: History, task: Task, moments: list[Moment]) -> Iterator[str]:
    """What must happen before the task can reach these moments; a wait for one of its own leads on to that one's."""
    for moment in moments:  # grows while it is walked
        for constraint in task.constraints:
            before = constraint.before
            if constraint.after.moment != moment or _is_met(history, task, constraint):
                continue
            if before.task == ROOT:
                yield f"until {constraint.delay:g} s"
            elif constraint.delay and history.has_reached(before):
                yield f"until {constraint.delay:g} s after {history.describe(before.task)} {_CLAUSES[before.moment]}"
            elif before.task != task.id:
                yield _until(history, before)
            elif before.moment not in moments:
                moments.append(before.moment)
        if moment in _OF_FAMILY and not history.has_reached(Point(task.parent, moment)):
            yield f"until its parent {history.describe(task.parent)} {_CLAUSES[moment]}"


def _is_met(history: History, task: Task, constraint: Constraint) -> bool:
    return constraint in task.timed_out if constraint.delay else history.has_reached(constraint.before)


def _until(history: History, point: Point) -> str:
    return f"until {history.describe(point.task)} {_CLAUSES[point.moment]}"


def _listed(names: list[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _of_suspended(_: History, task: Task) -> Iterator[str]:
    yield f"until {task} is resumed"


def _of_recovering(history: History, task: Task) -> Iterator[str]:
    handlers = [str(history.tasks[handler]) for handler in task.caught_by[-1:] if handler in history.tasks]
    yield f"until {_listed(handlers)} has dealt with its failure"


_REASONS = {
    State.HELD: _of_held,
    State.SUSPENDED: _of_suspended,
    State.RECOVERING: _of_recovering,
    State.QUEUED: _of_queued,
    State.PLANNING: _of_planning,
    State.PLANNED: _of_planned,
    State.HANDLING: _of_handled,
    State.ACHIEVING: _of_achieving,
}
