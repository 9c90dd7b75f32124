"""Kills, deadlines and delays ahead of tasks: bounded in number, and forgotten when the task ends."""

from tca_central.errors import RequestError
from tca_central.model.task_tree import Task
from tca_central.state import State
from tca_wire.vocabulary import Refusal

MOST_PENDING = 1000
"""Kills, deadlines and delays that may lie ahead of one task."""


def check_pending(task: Task) -> None:
    """Raises RequestError if no more may lie ahead of a task."""
    if task.rare is not None and len(task.rare.pending) >= MOST_PENDING:
        raise RequestError(Refusal.OVERLOAD, f"{MOST_PENDING} kills, deadlines and delays lie ahead of {task} already")


def forget_pending(central: State, task: Task) -> None:
    """A task has ended: nothing that waited to happen to it will."""
    assert task.rare is not None
    for what, waits_for in task.rare.pending.items():
        if isinstance(waits_for, Task):
            central.agenda.stop_waiting(waits_for, what)
        else:
            central.clock.cancel(waits_for)
    task.rare.pending.clear()
