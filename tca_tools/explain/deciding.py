"""Exception handlers: those called for a failure, and the tasks they retried or killed. Pure."""

from bisect import bisect_left
from collections.abc import Iterator
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.explain.overlapping import called_within
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import Handling, Retry, Task, TaskState
from tca_tools.journal.selection import lineage
from tca_tools.journal.whole_run import Run
from tca_wire.points import TaskId
from tca_wire.text.facts_in_words import by_whom
from tca_wire.text.measures import times
from tca_wire.text.printable import first_line
from tca_wire.vocabulary import Role

_TIME = attrgetter("time")


class Call(NamedTuple):
    """An exception handler was called, passed the failure on, or had no calls left."""

    time: float
    place: int
    """The order: twice the number of the call, plus one if the failure was passed on."""
    text: str


def calls(at: RunAt, task: Task, start: float = -inf, end: float = inf) -> Iterator[Call]:
    """Yield the calls of exception handlers for a task's failures from *start* to *end*."""
    found = _calls(at, task, start, end)
    return (call for call in found if start <= call.time < end)


def _calls(at: RunAt, task: Task, start: float, end: float) -> Iterator[Call]:
    run = at.run
    for number in called_within(run, task, start, end):
        place = bisect_left(task.caught_by, number)
        if (handler := at.tasks.get(number)) is not None:
            record = run.tasks[number]
            text = f"{handler} was called"
            begun = [handling for handling in record.handlings if handling.start <= at.instant]
            if begun:
                text += f" in {begun[-1].module}"
            if handler.state not in (TaskState.HANDLING, TaskState.ACHIEVED):
                why = first_line(handler.failure)
                text += f": {handler.state}" + (f" ({why})" if why else "")
            yield Call(record.received, 2 * place, text)
        for time, how in passed_on(run, number):
            yield Call(time, 2 * place + 1, f"{run.describe(number)} {how}")
    exhausted = run.exhausted.get(task.id, [])
    first, last = (bisect_left(exhausted, time, key=_TIME) for time in (start, end))
    for one in exhausted[first:last]:
        place = bisect_left(task.caught_by, one.time, key=run.sent_at)
        text = f"{one.handler} had been called {times(one.calls)}, its maximum"
        yield Call(one.time, 2 * place, text)


def passed_on(run: Run, handler: int, failure: str = "the failure") -> Iterator[tuple[float, str]]:
    """Yield when and how an exception handler passed *failure* on up the tree, if it did."""
    if handler in run.reissued:
        yield run.reissued[handler], f"passed {failure} on"
    if handler in run.left_open:
        yield run.left_open[handler], f"returned without dealing with {failure}"


def called_for(run: Run, handler: Task) -> Task:
    """Return the failed task for which an exception handler was called.

    If that task is an exception handler, too, the task for which it was called is returned.
    """
    while handler.role is Role.EXCEPTION and handler.about in run.tasks:
        handler = run.tasks[handler.about]
    return handler


def decider(run: Run, asker: Handling | None) -> Task | None:
    """Return the exception handler that requested a kill or retry; None if *asker* is not one."""
    task = run.tasks.get(asker.message_id) if asker is not None else None
    return task if task is not None and task.role is Role.EXCEPTION else None


def retry_in_words(run: Run, task: Task, retry: Retry) -> str:
    """Return ``retried with other data by safety``.

    The request may come from an exception handler that was called for another task. Then the text
    also names the handler, that task, and its failure.
    """
    handler, why = decider(run, retry.asker), by_whom(retry.by)
    if handler is not None and (failed := called_for(run, handler)) is not task:
        failure = first_line(failed.value_at("failure", handler.received))
        why += f": {handler}, called for {failed}, which had failed: {failure}"
    if retry.failed:
        failed = run.tasks.get(retry.failed, task)
        why = f", because {failed} failed" if failed is not task else ""
        if retry.fallback:
            return f"replaced by {retry.fallback} of its retry policy{why}"
        return f"retried by its policy, attempt {retry.handlings + 1}{why}"
    with_data = " with other data" if retry.has_other_data else ""
    return f"retried{with_data}{why}"


def decisions(run: Run, handler: Task) -> Iterator[tuple[float, str]]:
    """Yield an exception handler's decisions on the failed task and its ancestors, with times."""
    if handler.role is not Role.EXCEPTION:
        return
    above = [run.tasks[number] for number in lineage(run, TaskId(called_for(run, handler).id))]
    retried: set[float] = set()
    killed: dict[float, Task] = {}
    for task in above:
        for retry in task.retries:
            if decider(run, retry.asker) is handler:
                retried.add(retry.time)
                how = ", with other data" if retry.has_other_data else ""
                yield retry.time, f"retries {task}{how}"
        if decider(run, task.killer) is handler:
            # The highest task comes last and replaces its descendants, killed at the same time
            killed[task.written_at("killed")] = task
    for time, task in killed.items():
        if time not in retried:
            yield time, f"kills {task}"
