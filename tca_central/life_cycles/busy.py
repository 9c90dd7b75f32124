"""Applies a handler's wishes for tasks that find it busy: queue, reject or pre-empt."""

from tca_central.failing.failures import fail_task, kill
from tca_central.life_cycles.changes import apply_client_request
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import ModuleResource
from tca_central.model.tasks import Task, Verdict
from tca_central.state import State
from tca_wire.messages.failures import REJECTED
from tca_wire.vocabulary import Busy


def on_handler_busy(central: State, task: Task) -> None:
    """A task has to wait for a handler, which may have a wish for that case."""
    handlers = task.message.handlers
    if (
        not task.queues
        or not handlers
        or handlers[-1].busy is Busy.QUEUE
        or central.dispatcher.are_tasks_paused
    ):
        return
    if any(not resource.capacity for resource in task.queues):
        return  # a handler without slots is absent, not busy
    if handlers[-1].busy is Busy.REJECT:
        reject(central, task, f"{_named(task.queues[0])} is busy")
        return
    for resource in task.queues:
        _pre_empt(central, resource, task)


def _named(resource: ModuleResource) -> str:
    return (
        resource.module
        if resource.module == resource.name
        else f"{resource.name} of {resource.module}"
    )


def reject(central: State, task: Task, why: str) -> None:
    """Fail a waiting task: its handler has no time for it."""
    central.dispatcher.withdraw(task)
    central.agenda.mark_started(task)
    fail_task(central, task, RaisedFailure(REJECTED, why))


def _pre_empt(central: State, resource: ModuleResource, newest: Task) -> None:
    """Make room for the newest task: cancel running tasks, reject waiting ones of its message."""
    why = f"pre-empted by {newest}"
    for other in [one for one in resource.queued() if isinstance(one, Task) and one is not newest]:
        if other.message is newest.message:
            reject(central, other, why)
    for slot in list(resource.slots):
        for running in [one for one in slot.handling if isinstance(one, Task) and not one.killed]:
            _cancel(central, running, newest, why)


def _cancel(central: State, running: Task, newest: Task, why: str) -> None:
    if running.above(newest.id) is not None or newest.above(running.id) is not None:
        return  # one is a subtask of the other
    by = newest.sender.module.name if newest.sender is not None else "central"
    cycle = running.message.life_cycle
    if cycle.ends_on_request(running.state):
        return
    step = cycle.cancel(running.state)
    if step is None:
        kill(central, running, Verdict(why, by))
    else:
        apply_client_request(central, running, step, by, why)
