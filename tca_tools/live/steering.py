"""Find, kill, cancel, suspend, resume or retry a living task from outside.

Each function returns the result in one sentence, and raises ToolError if the task has ended.
"""

from collections.abc import Callable, Sequence

import click

from tca_module.client import Client
from tca_module.errors import Refused
from tca_module.sending.task_ref import TaskRef
from tca_tools.errors import ToolError
from tca_tools.live.shared import talking
from tca_wire.life_cycles import read_life_cycle
from tca_wire.points import ROOT
from tca_wire.text.measures import listed
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Scope

_IS_ENDING = "ends when its running handlers have returned"
_SHOWN = 10
"""Tasks that an error lists."""


def kill(task: TaskRef, why: str = "", delay: float = 0.0, scope: Scope = Scope.TASK) -> str:
    """Kill a task with everything under it, or only the part that `scope` names."""
    if not task.kill(why, delay=delay, scope=scope):
        raise too_late(task, "killed")
    killed = {Scope.DESCENDANTS: f"all under {task}", Scope.SIBLINGS: f"the siblings of {task}"}
    is_final = scope is not Scope.TASK or delay or task.info() is None
    result = f"to be killed in {delay:g} s" if delay else "killed"
    return f"{killed.get(scope, task)}: {result if is_final else _IS_ENDING}"


def cancel(client: Client, task: TaskRef, why: str = "") -> str:
    """Request the cancellation of a task, which its handler may refuse."""
    known = {one.name: one for one in client.messages()}.get(task.message)
    cycle, state = read_life_cycle(known.life_cycle if known else ""), task.state
    row = cycle.cancel(state)
    if row is None:
        raise ToolError(
            f"{task} is '{state}', and {cycle} has no cancel from there:"
            f" 'tca kill {task.id}' ends it"
        )
    changes = task.changes()
    if not task.take(row.name, why=why):
        raise too_late(task, "cancelled")
    last = changes.arrived()[-1]
    info = None if last.is_over else task.info()
    if info is None:
        return f"{task}: cancelled"
    if info.killed:
        return f"{task}: {_IS_ENDING}"
    if last.state != row.target:
        raise ToolError(f"{task} continues: {last.text or last.transition}")
    return f"{task}: {last.state}; its handler decides"


def suspend(task: TaskRef) -> str:
    """Start nothing more of a task until it is resumed."""
    info = task.info()
    if not task.suspend():
        raise too_late(task, "suspended")
    return f"{task}: suspended" + " already" * (info is not None and info.suspended)


def resume(task: TaskRef) -> str:
    """Resume a suspended task."""
    info = task.info()
    if not task.resume():
        raise too_late(task, "resumed")
    return f"{task}: " + ("resumed" if info is None or info.suspended else "not suspended")


def retry(task: TaskRef) -> str:
    """Handle a task again after everything under it has been killed."""
    info = task.info()
    if not task.retry():
        raise too_late(task, "handled again")
    module = info.module if info is not None else ""
    when = f" when its handler in {module} has returned" if module else ""
    return f"{task}: to be handled again{when}"


_REQUESTS: dict[str, Callable[[Client, TaskRef, str], str]] = {
    "cancel": cancel,
    "kill": lambda _, task, why: kill(task, why),
    "suspend": lambda _, task, _why: suspend(task),
    "resume": lambda _, task, _why: resume(task),
    "retry": lambda _, task, _why: retry(task),
}


def steer(central: str | None, epoch: str, what: str, task: int, why: str = "") -> str:
    """Do something to a task of the run that a program shows.

    Args:
        central: the address of central; None: the default.
        epoch: the epoch of the run that is shown.
        what: cancel, kill, suspend, resume or retry.
        task: the number of the task.
        why: the reason.

    Returns:
        The result in one sentence.

    Raises:
        ToolError: it can't be done, or central runs another epoch.
    """
    if (request := _REQUESTS.get(what)) is None:
        known = listed(list(_REQUESTS), named=len(_REQUESTS))
        raise ToolError(f"'{what}' can't be done to a task: choose one of {known}")
    with talking("view", central) as client:
        if client.status()["epoch"] != epoch:
            raise ToolError(
                f"central at {client.address} has another run than the one shown:"
                " give its address as --central"
            )
        return request(client, find_task(client, str(task)), why)


def too_late(task: TaskRef, what: str) -> ToolError:
    """Return the error for a request that arrived after its task had ended or was killed."""
    has_ended = task.info() is None
    state = "has just ended" if has_ended else "was killed, and ends when its handler has returned"
    return ToolError(f"{task} {state}: it can't be {what} any more")


def find_task(client: Client, named: str) -> TaskRef:
    """Return the living task with a number or a message name.

    Raises ToolError if no task or several tasks match.
    """
    if named.isdecimal() and named.isascii():
        return _task_of_number(client, int(named))
    if not named or not named.isprintable():
        raise click.UsageError(
            f"'{printable(named)}' is not a task: give the number of a task, or its message's name"
        )
    found = client.tasks(named)
    if not found:
        living = client.tasks()
        found = [task for task in living if task.message == named]  # sent between the two questions
    if not found:
        raise ToolError(f"no living task is called '{named}': {_listed(client, living)}")
    if len(found) > 1:
        numbers = listed([str(task.id) for task in found], named=_SHOWN)
        raise ToolError(
            f"{len(found)} living tasks are called '{named}': give the number of one, {numbers}"
        )
    return found[0]


def _listed(client: Client, tasks: Sequence[TaskRef]) -> str:
    """List the living tasks. If there are none, name central: the user may mean another one."""
    if not tasks:
        return f"central at {client.address} has no living tasks"
    return f"living tasks are {listed([printable(str(task)) for task in tasks], named=_SHOWN)}"


def _task_of_number(client: Client, number: int) -> TaskRef:
    if number == ROOT:
        raise ToolError(
            "task {0} is the root, which never ends: give the number of a task; "
            + _listed(client, client.tasks())
        )
    try:
        task = client.task(number)
    except Refused as refused:
        raise ToolError(f"{refused.text}: {_listed(client, client.tasks())}") from None
    info = task.info() if task is not None else None
    if task is None or info is None or info.outcome:
        raise ToolError(
            f"task {{{number}}} has ended: 'tca tree' shows how,"
            f" given the journal of {client.address} as LOG"
        )
    return task
