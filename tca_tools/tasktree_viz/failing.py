"""The chain of a failure: where it began, who was called for it, and what became of it. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

from tca_tools.coping import ENDED_TASKS, UNDECIDED, Fate, fate, is_told
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
    waiting: list[tuple[Message, int, float]] = [(task, 0, moment)]
    seen = {task.id}
    killed = _killed(task)
    if not _raised(task) and killed <= moment:
        links.append(Link(killed, 0, f"{task} was killed: {task.why_killed}"))
        waiting = [(culprit, 1, killed) for culprit in _culprits(past, task)]
    while waiting and len(links) < _MOST_LINKS:
        message, depth, until = waiting.pop()
        if message.id in seen and depth:
            continue
        seen.add(message.id)
        links += [link for link in _links_of(past, message, depth, until) if link.time <= until]
        waiting += [(cause, depth + 1, time) for cause, time in reversed(_causes(past, message, until))]
    links = [link for link in links if link.time <= moment]
    return links if seen - {task.id} or _raised(task) else []


def _killed(task: Task) -> float:
    return inf if task.killed is None else task.written("killed")


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
            was_killed = message.was("killed", moment) is not None
            killed_or_over = message.written("killed", moment) if was_killed else _newest_state(message, moment)
            told.append(Link(killed_or_over, depth, end))
    yield from sorted(told, key=lambda link: link.time)


def _newest_state(task: Task, moment: float) -> float:
    return next((time for time, _ in reversed(task.states) if time <= moment), task.received)


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
    """What had become of it at *moment*, if it had failed."""
    then = Then(past, moment).tasks.get(task.id)
    if then is None or not (raised := [one for one in _raised(task) if one[0] <= moment]):
        return ""
    became, state = fate(past, task, raised[-1][0], moment), then.state
    if became is Fate.OPEN:
        return f"{task} is being recovered"
    if became not in ENDED_TASKS:
        return f"{task}: its failure was dealt with" if became is Fate.DEALT_WITH else f"{task}: {state} after all"
    end = (
        f"{task}: nobody dealt with its failure" if then.why_killed is None else f"{task} was killed: {then.why_killed}"
    )
    return end + (f"; {past.describe(task.top)} was achieved without it" if became is Fate.REPLACED else "")


def _causes(past: Past, message: Message, moment: float) -> list[tuple[Message, float]]:
    """What its handler had sent and waited for when that failed, with when its wait was over, newest first; then the
    exception handlers that failed before it was decided. As it was known at *moment*: what failed later is no cause.
    """
    failed = [run for run in message.handlings if run.outcome is Outcome.FAILED and (run.end or 0.0) <= moment]
    found: list[tuple[Message, float]] = []
    for wait, end in [(wait, run.end) for run in failed for wait in run.waits][-1:]:
        until = min(moment if one is None else one for one in (wait.end, end))
        awaited = past.messages.get(wait.awaited)
        if awaited is not None and _is_named(past, awaited, until, message):
            found.append((awaited, until))
    if isinstance(message, Task):
        handlers = [past.tasks[number] for number in message.caught_by if number in past.tasks]
        calls = [(one, min(moment, _decided(message, one.received))) for one in handlers]
        found += [(one, until) for one, until in calls if any(time <= until for time, _ in _raised(one))]
    return found


def _decided(task: Task, failed: float) -> float:
    """When it was decided what became of a task that had failed."""
    states = (time for time, state in task.states if time > failed and state not in UNDECIDED)
    return min(next(states, inf), _killed(task), task.reached.get(Moment.END_ACHIEVING, inf))


def _is_named(past: Past, cause: Message, until: float, failed: Message) -> bool:
    """Whether the failure of one, of which its asker was told by then, is that of the other."""
    told = [one for one in _raised(cause) if one[0] <= until]
    told = [one for one in told if isinstance(cause, Task) or is_told(past, cause, one[0])]
    names = {text.partition(":")[0] for _, text in told}
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
