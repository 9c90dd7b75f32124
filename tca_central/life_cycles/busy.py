"""Queues, rejects or pre-empts a task whose handler is busy, as the handler has declared."""

from tca_central.failing.failures import fail_task, kill
from tca_central.life_cycles.changes import apply_client_request
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import ModuleResource
from tca_central.model.tasks import Task, Verdict
from tca_central.state import State
from tca_wire.messages.failures import REJECTED
from tca_wire.vocabulary import Busy


def on_handler_busy(central: State, task: Task) -> None:
    """Apply what the newest handler has declared for a task that has to wait for this handler."""
    handlers = task.message.handlers
    if not task.queues or not handlers or central.dispatcher.are_tasks_paused:
        return
    wish = handlers[-1].busy
    # A handler without slots is absent, not busy.
    if wish is Busy.QUEUE or any(not resource.capacity for resource in task.queues):
        return
    if wish is Busy.REJECT:
        module, name = task.queues[0].module, task.queues[0].name
        where = module if module == name else f"{name} of {module}"
        reject(central, task, f"{where} is busy")
        return
    for resource in task.queues:
        _pre_empt(central, resource, task)


def reject(central: State, task: Task, why: str) -> None:
    """Fail a waiting task with ``REJECTED``, since its handler has no time for the task."""
    central.dispatcher.withdraw(task)
    central.agenda.mark_started(task)
    fail_task(central, task, RaisedFailure(REJECTED, why))


def _pre_empt(central: State, resource: ModuleResource, newest: Task) -> None:
    """Make room for *newest*: cancel running tasks, and reject waiting tasks of its message."""
    why = f"pre-empted by {newest}"
    for other in [one for one in resource.queued() if isinstance(one, Task) and one is not newest]:
        if other.message is newest.message:
            reject(central, other, why)
    for slot in list(resource.slots):
        for running in [one for one in slot.handling if isinstance(one, Task) and not one.killed]:
            _cancel(central, running, newest, why)


def _cancel(central: State, running: Task, newest: Task, why: str) -> None:
    """Cancel a running task as its life cycle says. If the life cycle has no cancel, kill it."""
    if running.find_above(newest.id) is not None or newest.find_above(running.id) is not None:
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
