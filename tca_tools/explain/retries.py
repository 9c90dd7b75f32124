"""The waits of a task that is to be handled again: for all under it to end, and for whoever asked."""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter

from tca_tools.explain.overlapping import children_within
from tca_tools.explain.wait import Node, Wait
from tca_tools.journal.records import Retry, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import END_ACHIEVING, ENDS, START_HANDLING, TaskId
from tca_wire.vocabulary import Role
from tca_wire.waits import WaitKind

_Under = Callable[[Run, Sequence[TaskId], int, float | None], list[Task]]
_START = attrgetter("start")


def of_retry(run: Run, task: Task, retry: Retry, killed: float, under: _Under) -> Iterator[Wait]:
    """The waits of a task that is to be handled again, unless it is killed, for all tasks under it to end: then it is
    queued, or handled. *under* has what these wait for instead of a killed monitor.
    """
    if task.time_of(START_HANDLING) >= retry.time:
        return
    begun = _begun(task, retry)
    is_over = min(begun, killed)
    asker = run.tasks.get(TaskId(retry.asker.message_id)) if retry.asker else None
    decider = asker if asker is not None and asker.role is Role.EXCEPTION else None
    if decider is not None:
        end, on = min(decider.time_of(END_ACHIEVING), is_over), Node(decider.id, END_ACHIEVING)
        yield Wait(retry.time, end, WaitKind.RECOVERY, on, ENDS)
    still = children_within(run, task, END_ACHIEVING, retry.time, begun)
    children = [run.tasks[number] for number in still]
    if task.message_class.is_monitor:
        children = _before_it_begins(task, retry, children, decider)
    awaited = [TaskId(child.id) for child in children if not child.outlives_retry]
    for child in under(run, awaited, END_ACHIEVING, retry.time):
        if child is not decider:
            start, on = max(retry.time, child.received), Node(child.id, END_ACHIEVING)
            end = min(child.time_of(END_ACHIEVING), is_over)
            yield Wait(start, end, WaitKind.SUBTASK, on, ENDS)


def _begun(task: Task, retry: Retry) -> float:
    """When a retried task was queued or handled, or else ended."""
    queued = bisect_left(task.queueings, retry.time, key=_START)
    starts = [one.start for one in task.handlings[retry.runs : retry.runs + 1]]
    starts += [one.start for one in task.queueings[queued : queued + 1]]
    return min(starts, default=task.time_of(END_ACHIEVING))


def _before_it_begins(monitor: Task, retry: Retry, children: list[Task], decider: Task | None) -> list[Task]:
    """The tasks under a retried monitor until it begins anew. That is in no journal: it begins when nothing is under it
    any more, whoever asked has ended, and it is not suspended.
    """
    begins, found = retry.time, list[Task]()
    if decider is not None:
        begins = max(begins, decider.time_of(END_ACHIEVING))
    for child in children:
        for suspension in monitor.suspensions:
            if suspension.start <= begins:
                begins = max(begins, suspension.until)
        if child.received >= begins and bisect_left(monitor.children, child.id) >= retry.sent:
            break
        if not child.outlives_retry:
            begins = max(begins, child.time_of(END_ACHIEVING))
        found.append(child)
    return found
