"""What is done to a living task from outside: it is found, killed, suspended, resumed or handled
again. Each of these says in a sentence what became of it, and raises ToolError if it came too late.
"""

from collections.abc import Callable

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

_TOLD_TO_END = "told to end; it does when the handlers that run have returned"
_SHOWN = 10  # tasks that one name may mean


def kill(task: TaskRef, why: str = "", delay: float = 0.0, scope: Scope = Scope.TASK) -> str:
    """End a task and everything under it, or only a part of that."""
    if not task.kill(why, delay=delay, scope=scope):
        raise too_late(task, "killed")
    whom = {Scope.DESCENDANTS: f"all under {task}", Scope.SIBLINGS: f"the siblings of {task}"}
    is_over = scope is not Scope.TASK or delay or task.info() is None
    how = f"to be killed in {delay:g} s" if delay else "killed"
    how = how if is_over else _TOLD_TO_END
    return f"{whom.get(scope, task)}: {how}"


def cancel(client: Client, task: TaskRef, why: str = "") -> str:
    """Ask for the end of a task, which its handler may refuse."""
    known = {one.name: one for one in client.messages()}.get(task.message)
    cycle, state = read_life_cycle(known.life_cycle if known else ""), task.state
    row = cycle.cancel(state)
    if row is None:
        raise ToolError(
            f"{task} is '{state}', and {cycle} has no cancel from there: 'tca kill {task.id}' ends it"
        )
    changes = task.changes()
    if not task.take(row.name, why=why):
        raise too_late(task, "cancelled")
    last = changes.arrived()[-1]
    info = None if last.is_over else task.info()
    if info is None:
        return f"{task}: cancelled"
    if info.killed:
        return f"{task}: {_TOLD_TO_END}"
    if last.state != row.target:
        raise ToolError(f"{task} goes on: {last.text or last.transition}")
    return f"{task}: {last.state}; its handler decides"


def suspend(task: TaskRef) -> str:
    """Start nothing more of a task until it is resumed."""
    info = task.info()
    if not task.suspend():
        raise too_late(task, "suspended")
    return f"{task}: suspended" + " already" * (info is not None and info.suspended)


def resume(task: TaskRef) -> str:
    """Let a suspended task go on."""
    info = task.info()
    if not task.resume():
        raise too_late(task, "resumed")
    return f"{task}: " + ("resumed" if info is None or info.suspended else "not suspended")


def retry(task: TaskRef) -> str:
    """Handle a task again, when all under it has been killed."""
    info = task.info()
    if not task.retry():
        raise too_late(task, "handled again")
    module = info.module if info is not None else ""
    return f"{task}: to be handled again" + f" when its handler in {module} has returned" * bool(
        module
    )


_STEERS: dict[str, Callable[[Client, TaskRef, str], str]] = {
    "cancel": cancel,
    "kill": lambda _, task, why: kill(task, why),
    "suspend": lambda _, task, _why: suspend(task),
    "resume": lambda _, task, _why: resume(task),
    "retry": lambda _, task, _why: retry(task),
}


def steer(central: str | None, epoch: str, what: str, task: int, why: str = "") -> str:
    """For a program that shows the run of that epoch: do something to one of its tasks; what became
    of it.

    Raises ToolError if it can't be done.
    """
    if (steers := _STEERS.get(what)) is None:
        raise ToolError(
            f"'{what}' can't be done to a task: {listed(list(_STEERS), named=len(_STEERS))} can"
        )
    with talking("view", central) as client:
        if client.status()["epoch"] != epoch:
            raise ToolError(
                f"central at {client.address} runs another run than the one shown: give its address as --central"
            )
        return steers(client, find_task(client, str(task)), why)


def too_late(task: TaskRef, what: str) -> ToolError:
    """Central has done nothing: between the question and the request the task has ended."""
    is_over = task.info() is None
    state = (
        "has ended meanwhile" if is_over else "was killed, and ends when its handler has returned"
    )
    return ToolError(f"{task} {state}: it can't be {what} any more")


def find_task(client: Client, named: str) -> TaskRef:
    """The living task that a number, or a message's name, means. Raises ToolError if it means none,
    or many.
    """
    if named.isdecimal() and named.isascii():
        return _numbered(client, int(named))
    if not named or not named.isprintable():
        raise click.UsageError(
            f"'{printable(named)}' is no task: give the number of a task, or its message's name"
        )
    found = client.tasks(named)
    if not found:
        raise ToolError(f"no living task is called '{named}': {_living(client)}")
    if len(found) > 1:
        numbers = listed([str(handle.id) for handle in found], named=_SHOWN)
        raise ToolError(
            f"{len(found)} living tasks are called '{named}': give the number of one, {numbers}"
        )
    return found[0]


def _living(client: Client) -> str:
    """Which tasks there are now, in the central that was asked: the newest journal may be another
    one's.
    """
    tasks = client.tasks()
    if not tasks:
        return f"no task lives in central at {client.address}"
    return f"living tasks are {listed([printable(str(task)) for task in tasks], named=_SHOWN)}"


def _numbered(client: Client, number: int) -> TaskRef:
    if number == ROOT:
        raise ToolError(
            f"task 0 is the root, which never ends: give the number of a task; {_living(client)}"
        )
    try:
        handle = client.task(number)
    except Refused as refused:
        raise ToolError(f"{refused.text}: {_living(client)}") from None
    info = handle.info() if handle is not None else None
    if handle is None or info is None or info.outcome:
        raise ToolError(
            f"task {number} has ended: 'tca tree' shows how, given the journal of {client.address} as LOG"
        )
    return handle
