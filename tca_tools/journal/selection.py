"""Select tasks and messages of a run: by number or name, subtree, module, and time. Pure."""

from bisect import bisect_left
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import islice
from math import inf
from operator import attrgetter
from typing import Protocol

from tca_tools.errors import NotInLog
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.records import HandlerWait, Message, Queueing, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.text.nearest import did_you_mean

_GRANTED, _START = attrgetter("granted"), attrgetter("start")
_NAMED = 5
"""The number of tasks of one name that an error lists."""


class Forest(Protocol):
    """Tasks at an instant, oldest first, each under its parent."""

    @property
    def tasks(self) -> Mapping[int, TaskAt]:
        """The tasks by number."""

    @property
    def time(self) -> float:
        """The time on the clock of the entries."""

    def children(self, task: int) -> Sequence[TaskId]:
        """Return the children of *task*, oldest first."""


class Excerpt:
    """Some tasks of a run at an instant. Tasks whose parents are left out are at the top."""

    def __init__(self, at: RunAt, chosen: Collection[int]) -> None:
        self.tasks = {number: at.tasks[number] for number in at.tasks if number in chosen}
        self.time = at.time
        self._top = [
            TaskId(number) for number, task in self.tasks.items() if task.parent not in chosen
        ]

    def children(self, task: int) -> Sequence[TaskId]:
        """Return the children of *task*, oldest first."""
        if task == ROOT:
            return self._top
        return [child for child in self.tasks[task].children if child in self.tasks]


def tasks_called(run: Run, text: str) -> list[TaskId]:
    """Return the task with the number *text*, or all tasks with that name.

    Raises:
        NotInLog: There is no such task.
    """
    wanted = text.strip().strip("{}")
    found = [TaskId(int(wanted))] if wanted.isdecimal() and int(wanted) in run.tasks else []
    found = found or [TaskId(task.id) for task in run.tasks.values() if task.name == text]
    if not found:
        if wanted.isdecimal() and (message := run.messages.get(int(wanted))):
            advice = f"'tca tree --story {message.id}' tells its story"
            raise NotInLog(f"{message} is a {message.message_class}, not a task: {advice}")
        raise no_task(text, {task.name for task in run.tasks.values()}, _in_journal(run))
    return found


def no_task(text: str, names: Collection[str], where: str = "in this journal") -> NotInLog:
    """Return the error for an unknown task, with the nearest of the known *names*."""
    return NotInLog(f"no task '{text}' {where}{did_you_mean(text, names, ': ')}")


def one_task(run: Run, text: str) -> TaskId:
    """Return the only task with the number or name *text*.

    Raises:
        NotInLog: There is no such task, or there are several; the message lists their numbers.
    """
    return TaskId(_only(tasks_called(run, text), text, "tasks"))


def one_message(run: Run, text: str) -> int:
    """Return the only message with the number or name *text*; a task is preferred."""
    wanted = text.strip().strip("{}")
    if wanted.isdecimal() and int(wanted) in run.messages:
        return int(wanted)
    if any(task.name == text for task in run.tasks.values()):
        return one_task(run, text)
    found = [message.id for message in run.messages.values() if message.name == text]
    return _only(found, text, "messages") if found else one_task(run, text)


def _only(found: Sequence[int], text: str, kind: str) -> int:
    if len(found) > 1:
        numbers = ", ".join(map(str, found[:_NAMED])) + (" ..." if len(found) > _NAMED else "")
        raise NotInLog(
            f"{len(found)} {kind} are called '{text}': name one by its number: {numbers}"
        )
    return found[0]


def check_modules(run: Run, names: Iterable[str]) -> None:
    """Raise NotInLog if the journal does not contain a module."""
    for name in names:
        if name not in run.modules:
            raise NotInLog(
                f"no module '{name}' {_in_journal(run)}{did_you_mean(name, run.modules, ': ')}"
            )


def part_of(
    at: RunAt,
    *,
    roots: Iterable[TaskId] | None = None,
    modules: Iterable[str] = (),
    start: float | None = None,
    end: float | None = None,
) -> Excerpt:
    """Return the tasks that meet all conditions, and their ancestors up to the roots.

    Args:
        at: The run at an instant.
        roots: The tasks must be at or under these; None for all.
        modules: One of the modules must have handled or queued the task; all by default.
        start: The tasks must not have ended before this time on the entries' clock.
        end: The tasks must have been sent by this time on the entries' clock.
    """
    run = at.run
    under = None if roots is None else subtree(run, roots)
    wanted = set(modules)
    begin, until = _time_at(run, start, -inf), _time_at(run, end, inf)
    chosen = {
        number
        for number in at.tasks
        if (under is None or number in under)
        and (not wanted or _is_handled_by(run.tasks[number], wanted))
        and run.tasks[number].received <= until
        and run.tasks[number].time_of(Moment.END_ACHIEVING) >= begin
    }
    for number in sorted(chosen, reverse=True):  # parents have smaller ids than their children
        parent = run.tasks[number].parent
        while parent != ROOT and parent not in chosen and (under is None or parent in under):
            chosen.add(parent)
            parent = run.tasks[parent].parent
    return Excerpt(at, chosen)


def subtree(run: Run, roots: Iterable[TaskId]) -> set[int]:
    """Return *roots* and their descendants."""
    found: set[int] = set()
    for root in sorted(roots):  # ancestors have smaller ids
        if root not in found:
            found.update(task.id for task in run.under(run.tasks[root]))
    return found


def messages_of(run: Run, tasks: Iterable[int]) -> set[int]:
    """Return *tasks*, and the other messages that their handlers sent, directly or indirectly."""
    found = set(tasks)
    for number, message in run.messages.items():  # a sender is older than its messages
        if (
            not isinstance(message, Task)
            and run.message_of.get(message.origin, message.origin) in found
        ):
            found.add(number)
    return found


def waited_for(run: Run, task: TaskId, own: set[int]) -> set[int]:
    """Return the messages outside of a task's subtree for which messages in the subtree waited.

    A message was awaited itself, or it held a resource that was awaited.

    Args:
        run: The run.
        task: The root of the subtree.
        own: The messages in the subtree.
    """
    found: set[int] = set()
    for number in own:
        message = run.messages[number]
        for wait in (wait for handling in message.handlings for wait in handling.waits):
            found.add(wait.awaited)
            if claim := run.claims.get(wait.awaited):
                found |= _holders(run, claim.module, claim.resource, wait)
        for queueing in message.queueings:
            found |= _holders(run, queueing.module, queueing.resource, queueing)
        if isinstance(message, Task):
            found.update(hold.constraint.before.task for hold in message.holds)
    above = set(lineage(run, task))
    found |= subtree(
        run, (TaskId(number) for number in found if number in run.tasks and number not in above)
    )
    return {number for number in found if number not in own and number in run.messages}


def lineage(run: Run, task: TaskId) -> list[TaskId]:
    """Return a task and its ancestors, up to the top-level task."""
    found = [task]
    while (parent := run.tasks[found[-1]].parent) != ROOT:
        found.append(parent)
    return found


def _holders(run: Run, module: str, resource: str, wait: Queueing | HandlerWait) -> set[int]:
    """Return the messages that held a resource during a wait: handled there, or with a lock."""
    grants, runs = run.granted(module, resource), run.by_resource.get((module, resource), [])
    granted = islice(grants, bisect_left(grants, wait.until, key=_GRANTED))
    begun = islice(runs, bisect_left(runs, wait.until, key=_START))
    return {one.message_id for one in begun if one.until > wait.start} | {
        run.message_of.get(one.origin, one.origin) for one in granted if one.until > wait.start
    }


def _is_handled_by(message: Message, modules: set[str]) -> bool:
    handled = any(handling.module in modules for handling in message.handlings)
    return handled or any(queueing.module in modules for queueing in message.queueings)


def _time_at(run: Run, clock: float | None, default: float) -> float:
    """Return the time of the last entry until *clock*, or *clock* if that is later."""
    if clock is None:
        return default
    place = run.entries_until(clock)
    return max(run.times[place - 1], clock) if place else clock


def _in_journal(run: Run) -> str:
    return "in this journal" + ("" if run.until_time is None else f" until {run.until_time:g} s")
