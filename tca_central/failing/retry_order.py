"""Refuses a retry that would wait for a task that waits for the retried task."""

from tca_central.errors import RequestError
from tca_central.model.tasks import Task
from tca_central.order.cycles import Place, find_path
from tca_central.state import State
from tca_wire.points import END_ACHIEVING, END_HANDLING, END_PLANNING
from tca_wire.vocabulary import Refusal


def check_order(central: State, task: Task, asking: Task | None) -> None:
    """Raise RequestError if a retry would wait for a task that waits for the retried task.

    A retry waits for the exception handler that asks, and for tasks that survive kills.
    """
    # Foreign monitors survive the retry, and may watch until the task returns.
    foreign_monitors = [
        monitor
        for monitor in (task.background_monitors or {}).values()
        if monitor.is_foreign_monitor
    ]
    next_ends = _next_ends(task, END_HANDLING, END_PLANNING)
    for monitor in foreign_monitors:
        next_ends += _next_ends(monitor, END_HANDLING, END_ACHIEVING)
    awaited = {
        child
        for child in (task.children or {}).values()
        if child.role.survives and not child.is_foreign_monitor
    }
    if asking is not None:
        awaited.add(asking)
    for awaited_task in sorted(awaited, key=lambda child: child.id):
        for end in next_ends:
            if path := find_path(central.tree, end, Place(awaited_task, END_ACHIEVING)):
                waits = next(place.task for place in path if place.task is not end.task)
                text = (
                    f"{task} can't be retried: {waits} under it must end before, "
                    f"and waits for {end.task}"
                )
                raise RequestError(Refusal.CYCLE, text)


def _next_ends(task: Task, *moments: int) -> list[Place]:
    """Return the first of *moments* that a task has not reached, as a point; [] if all are past."""
    return [Place(task, moment) for moment in moments if not task.reached & moment][:1]
