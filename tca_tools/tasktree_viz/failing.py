"""The chain of a failure: where it began, who was called for it, and what became of it. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

from tca_tools.coping import ENDED_TASKS, Fate, fate
from tca_tools.past import Past
from tca_tools.records import Message, State, Task
from tca_tools.selection import lineage, subtree
from tca_tools.story import exhausted
from tca_tools.then import Then
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome

_MOST_LINKS = 30
"""A failure goes through so many tasks at most before nobody reads on."""


@dataclass(frozen=True, slots=True)
class Link:
    """One thing that happened on the way of a failure; *depth* says how far from the task that was asked about."""

    time: float
    depth: int
    text: str


def failure_chain(past: Past, number: TaskId, moment: float = inf) -> list[Link]:
    """What a task failed of or was killed for, followed to where it began, as it was known at *moment*; nothing if all
    went well.
    """
    task = past.tasks[number]
    links: list[Link] = []
    waiting: list[tuple[Message, int]] = [(task, 0)]
    seen = {task.id}
    if not _raised(task) and task.killed is not None:
        links.append(Link(task.written("killed"), 0, f"{task} was killed: {task.why_killed}"))
        waiting = [(culprit, 1) for culprit in _culprits(past, task)]
    while waiting and len(links) < _MOST_LINKS:
        message, depth = waiting.pop()
        if message.id in seen and depth:
            continue
        seen.add(message.id)
        links += _links_of(past, message, depth, moment)
        waiting += [(cause, depth + 1) for cause in reversed(_causes(past, message))]
    links = [link for link in links if link.time <= moment]
    return links if seen - {task.id} or _raised(task) else []


def _raised(message: Message) -> list[tuple[float, str]]:
    """The failures that were raised on it: when, and which."""
    found: list[tuple[float, str]] = []
    changes = [change for change in message.changes if change[1] == "failure"]
    for place, (time, _, _) in enumerate(changes):
        new = changes[place + 1][2] if place + 1 < len(changes) else message.failure
        if new:
            found.append((time, str(new)))
    return found


def _links_of(past: Past, message: Message, depth: int, moment: float) -> Iterator[Link]:
    told = [Link(time, depth, f"{message} failed: {text}") for time, text in _raised(message)]
    if isinstance(message, Task):
        told += _recoveries(Then(past, moment), message, depth)
        if end := _end(past, message, moment):
            killed_or_over = message.states[-1][0] if message.killed is None else message.written("killed")
            told.append(Link(killed_or_over, depth, end))
    yield from sorted(told, key=lambda link: link.time)


def _recoveries(then: Then, task: Task, depth: int) -> Iterator[Link]:
    past = then.past
    for number in task.caught_by:
        if (handler := then.tasks.get(number)) is not None:
            record = past.tasks[number]
            runs = [run for run in record.handlings if run.start <= then.moment]
            by = f", handled by {runs[-1].module}" if runs else ""
            how = f": {handler.state}" if handler.state is not State.ACHIEVED else ""
            yield Link(record.received, depth, f"exception handler {handler} was called{by}{how}")
        if number in past.reissued:
            yield Link(past.reissued[number], depth, f"{past.describe(number)} passed the failure on")
    for one in past.exhausted.get(task.id, ()):
        yield Link(one.time, depth, exhausted(one).replace(" has ", " had ", 1))


def _end(past: Past, task: Task, moment: float) -> str:
    """What became of it, if it failed; of what it is under only what was known at *moment*."""
    if not (raised := _raised(task)):
        return ""
    became = fate(past, task, raised[-1][0])
    if became is Fate.OPEN:
        return f"{task} is being recovered"
    if became not in ENDED_TASKS:
        return f"{task}: its failure was dealt with" if became is Fate.DEALT_WITH else f"{task}: {task.state} after all"
    end = f"{task}: nobody dealt with its failure" if task.killed is None else f"{task} was killed: {task.why_killed}"
    is_replaced = became is Fate.REPLACED and past.tasks[task.top].states[-1][0] <= moment
    return end + (f"; {past.describe(task.top)} was achieved without it" if is_replaced else "")


def _causes(past: Past, message: Message) -> list[Message]:
    """What its handler had sent and waited for when that failed, newest first."""
    waits = [wait for handling in message.handlings if handling.outcome is Outcome.FAILED for wait in handling.waits]
    awaited = [past.messages[wait.awaited] for wait in waits[-1:] if wait.awaited in past.messages]
    own = [one for one in awaited if _raised(one) and _is_named(one, message)]
    handlers = [past.tasks[number] for number in getattr(message, "caught_by", []) if number in past.tasks]
    return own + [handler for handler in handlers if _raised(handler)]


def _is_named(cause: Message, failed: Message) -> bool:
    """Whether the failure of one is that of the other."""
    names = {text.partition(":")[0] for _, text in _raised(cause)}
    return any(name in text for _, text in _raised(failed) for name in names)


def _culprits(past: Past, task: Task) -> list[Task]:
    """Whose failure, not dealt with, killed the tree that a task was in: who is named there, or the last one before."""
    top = lineage(past, TaskId(task.id))[-1]
    killed = task.written("killed")
    found = [
        (raised[-1][0], past.tasks[number])
        for number in subtree(past, [top])
        if number != task.id
        and (raised := [one for one in _raised(past.tasks[number]) if one[0] <= killed])
        and not past.tasks[number].is_dealt_with
        and past.tasks[number].reached.get(Moment.END_ACHIEVING, inf) >= killed
    ]
    why = task.killed or ""
    named = [one for one in found if f" of task {one[1].id} " in why]
    return [max(named or found, key=lambda one: (one[0], one[1].id))[1]] if found and "failure" in why else []
