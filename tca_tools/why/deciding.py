"""What exception handlers decided: whom they had handled again, or killed. Facts name the module that asked for that;
told is only what is sure: that module was handling no other exception handler then. Pure.
"""

from collections.abc import Iterator
from math import inf

from tca_tools.run.records import Task
from tca_tools.run.selection import lineage
from tca_tools.run.whole_run import Run
from tca_wire.points import TaskId
from tca_wire.text.printable import first_line
from tca_wire.vocabulary import Role


def at_work(run: Run, module: str, time: float) -> Task | None:
    """The exception handler that a module was handling when it asked for something, if it was the only one."""
    found = [
        handler
        for (name, _), runs in run.runs.items()
        if name == module
        for handling in runs
        if handling.start < time <= (inf if handling.end is None else handling.end)
        and (handler := run.tasks.get(handling.message_id)) is not None
        and handler.role is Role.EXCEPTION
    ]
    return found[0] if len(found) == 1 else None


def called_for(run: Run, handler: Task) -> Task:
    """For whose failure it was called; where that is an exception handler's that failed, for whose that was."""
    while handler.role is Role.EXCEPTION and handler.about in run.tasks:
        handler = run.tasks[handler.about]
    return handler


def decider(run: Run, task: Task, by: str, time: float) -> Task | None:
    """The exception handler that had a task retried or killed, called for its failure or that of one under it."""
    handler = at_work(run, by, time)
    is_its = handler is not None and task.id in lineage(run, TaskId(called_for(run, handler).id))
    return handler if is_its else None


def is_planned(run: Run, task: Task) -> bool:
    """Whether who had a task killed had planned a kill in its tree before: it may be that one."""
    killed = task.written("killed")
    return any(
        one.moment is None and one.by == task.killed_by and one.set_at < killed
        for number, planned in run.ahead.items()
        if run.tasks[number].top == task.top
        for one in planned
    )


def retried_for(run: Run, task: Task, time: float, by: str) -> str:
    """``redo {16}, called for move {9}, which had failed: jam``: which exception handler had a task retried for the
    failure of one under it. "" if that is not sure; of its own failure that tells itself.
    """
    handler = decider(run, task, by, time)
    if handler is None or (failed := called_for(run, handler)) is task:
        return ""
    return (
        f"{handler}, called for {failed}, which had failed: {first_line(failed.was('failure', handler.received) or '')}"
    )


def decisions(run: Run, handler: Task) -> Iterator[tuple[float, str]]:
    """What an exception handler decided about what had failed and the tasks above it, and when."""
    if handler.role is not Role.EXCEPTION:
        return
    above = [run.tasks[number] for number in lineage(run, TaskId(called_for(run, handler).id))]
    for handling in handler.handlings:
        end = inf if handling.end is None else handling.end
        killed: dict[float, Task] = {}
        for task in above:
            for time, by, is_other in task.retries:
                if by == handling.module and handling.start < time <= end and at_work(run, by, time) is handler:
                    killed.pop(time, None)  # those under it are, with that
                    yield time, f"has {task} handled again{', with other data' * is_other}"
            if task.killed is not None and task.killed_by == handling.module and not is_planned(run, task):
                time = task.written("killed")
                if handling.start < time <= end and at_work(run, handling.module, time) is handler:
                    killed[time] = task  # and with it those under it
        yield from ((time, f"kills {task}") for time, task in killed.items())
