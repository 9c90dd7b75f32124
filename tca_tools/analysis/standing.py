"""What keeps a task that has not ended when the journal ends: what runs under it, or else what it stands on. Pure.

Where nothing under a task goes on, its constraints, and its handlers that wait, lead to tasks elsewhere: what goes on
or stands there keeps it. A walk visits a message once, so it costs what it passes through.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from tca_tools.analysis.causes import Doing, Step, delay_of
from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import Claim, HandlerWait, Handling, Hold, Message, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.story import awaited
from tca_tools.why.waiting import blockers, of_blocker
from tca_wire.points import Moment


@dataclass(slots=True)
class GoingOn:
    """What a task waits for at the journal's end."""

    time: float
    """Until when something went on: the journal's end, or when it came to stand."""
    message_id: int
    handling: Handling | None = None
    """The handler that went on until then."""
    standing: Step | None = None
    """If nothing does: what stands since then."""
    found_at: int = 0
    """The message by which it was found."""
    because: list[str] = field(default_factory=list)
    """If it is not under the task: the waits that lead there, in words."""


def going_on(run: Run, task: Task) -> GoingOn:
    """What an open task waits for."""
    end = RunAt(run)
    own: list[Message] = list(run.under(task))
    if found := _running(run, own) or _longest(own, end, _stopped):
        return found
    way = _Way(end, own)
    if found := _running(run, way.further) or _longest(way.further, end, _stopped):
        found.because = way.to(found.found_at)
        return found
    everywhere = [*own, *way.further]
    return _longest(everywhere, end, _watching) or _longest(everywhere, end, _held) or _unknown(run, task, own)


def _running(run: Run, messages: Iterable[Message]) -> GoingOn | None:
    """The first handler that waits for nothing; replies that are waited for are followed."""
    for one in messages:
        last = _awaited_last(run, one)
        if (handling := _run_of(last)) and not _wait_of(last):
            return GoingOn(run.time, last.id, handling, found_at=one.id)
    return None


class _Standing(NamedTuple):
    """What stands until the journal's end."""

    step: Step
    cause: int
    """The message at whose event it came to that."""
    handling: Handling | None = None
    """The handler that did it, if it was one."""


def _longest(
    messages: Iterable[Message], end: RunAt, standing: Callable[[Message, RunAt], Iterator[_Standing]]
) -> GoingOn | None:
    """What has stood longest; it may have come to stand just when the journal ends."""
    all_found = [(found, one.id) for one in messages for found in standing(one, end)]
    if not all_found:
        return None
    found, found_at = min(all_found, key=lambda one: one[0].step.start)
    step = found.step if found.step.seconds > 0 else None
    return GoingOn(found.step.start, found.cause, found.handling, step, found_at)


def _stopped(message: Message, end: RunAt) -> Iterator[_Standing]:
    """It is suspended, in a queue, handled by nobody, delayed, or its handler waits for what somebody has locked."""
    run = end.run
    if isinstance(message, Task):
        suspension = message.suspension
        if suspension and suspension.cause == message.id and (since := suspension.standstill) is not None:
            yield _Standing(Step(since, run.time, Doing.SUSPENDED, message.id, ""), message.id)
        for hold in _holds(message, end):
            before = hold.constraint.before
            if hold.constraint.delay and end.has_reached(before):
                start, cause = delay_of(run, message, before.task, before.moment, hold.added)
                yield _Standing(Step(start, run.time, Doing.DELAY, message.id, ""), cause)
    last = _awaited_last(run, message)
    queueings = [*last.queueings[-1:], *run.copies.get(last.id, ())]
    if (queueing := next((one for one in queueings if one.end is None), None)) is not None:
        doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
        yield _Standing(Step(queueing.start, run.time, doing, last.id, queueing.module, queueing.resource), last.id)
    wait = _wait_of(last)
    if wait and (holder := _holder(end, wait)) and holder.by is None:
        since = max(wait.start, holder.granted or wait.start)
        handling = _run_of(last) if since == wait.start else None
        yield _Standing(Step(since, run.time, Doing.LOCKED, last.id, holder.sender), last.id, handling)


def _watching(message: Message, end: RunAt) -> Iterator[_Standing]:
    """A monitor watches for something."""
    if isinstance(message, Task) and message.message_class.is_monitor and Moment.END_HANDLING not in message.reached:
        since = message.reached.get(Moment.START_HANDLING)
        if since is not None:
            yield _Standing(Step(since, end.run.time, Doing.WATCHING, message.id, ""), message.id)


def _held(message: Message, end: RunAt) -> Iterator[_Standing]:
    """Constraints hold it back, and what they wait for is not known to go on."""
    if isinstance(message, Task) and message.states and any(_holds(message, end)):
        yield _Standing(Step(message.states[-1][0], end.run.time, Doing.HELD, message.id, ""), message.id)


def _unknown(run: Run, task: Task, own: Iterable[Message]) -> GoingOn:
    """Nothing is known that it waits for: back from when something last happened under it."""
    changed = (one.states[-1][0] for one in own if isinstance(one, Task) and one.states)
    last = max(changed, default=task.received)
    step = Step(last, run.time, Doing.UNKNOWN, task.id, "") if run.time > last else None
    return GoingOn(last, task.id, standing=step)


class _Way:
    """From some tasks to all that they wait for elsewhere, and what that waits for."""

    def __init__(self, end: RunAt, own: list[Message]) -> None:
        self.further: list[Message] = []
        self._came: dict[int, tuple[int, str]] = {one.id: (0, "") for one in own}
        """From which message to which, and why."""
        self._end = end
        walked = [(one, False) for one in own]
        for one, with_children in walked:  # grows while it is walked
            for other, words, whole in self._leads(one, with_children=with_children):
                if other.id not in self._came:
                    self._came[other.id] = (one.id, words)
                    self.further.append(other)
                    walked.append((other, whole))

    def to(self, message_id: int) -> list[str]:
        """The waits that lead to a message, in words."""
        told = []
        while message_id:
            message_id, words = self._came[message_id]
            told.append(words)
        return [words for words in reversed(told) if words]

    def _leads(self, message: Message, *, with_children: bool) -> Iterator[tuple[Message, str, bool]]:
        """What a message waits for, in words, and whether it waits for all that is under it."""
        run = self._end.run
        if isinstance(message, Task):
            yield from self._leads_of_task(message)
            if with_children:
                yield from ((run.tasks[child], "", True) for child in message.children)
        last = _awaited_last(run, message)
        if not (wait := _wait_of(last)):
            return
        words, whole = f"the handler of {last} waits {awaited(run, wait)}", wait.moment is Moment.END_ACHIEVING
        for number in _keeping(self._end, wait):
            if (other := run.messages.get(number)) is not None:
                yield other, words, whole

    def _leads_of_task(self, task: Task) -> Iterator[tuple[Task, str, bool]]:
        tasks, at = self._end.run.tasks, self._then_of(task)
        if task.suspension and task.suspension.cause != task.id:
            cause = tasks[task.suspension.cause]
            yield cause, f"{task} waits until {cause} is resumed", False
        for blocker in blockers(self._end, at):
            words = f"{task} waits {of_blocker(self._end, at, blocker)}"
            if isinstance(blocker, Moment):
                yield tasks[task.parent], words, False
            elif (before := tasks.get(blocker.constraint.before.task)) is not None:
                ends = blocker.constraint.before.moment in (Moment.END_PLANNING, Moment.END_ACHIEVING)
                yield before, words, ends

    def _then_of(self, task: Task) -> TaskAt:
        return self._end.tasks[task.id]


def _holds(task: Task, end: RunAt) -> Iterator[Hold]:
    """The constraints that keep a task from what comes next."""
    return (one for one in blockers(end, end.tasks[task.id]) if isinstance(one, Hold))


def _awaited_last(run: Run, message: Message) -> Message:
    """What a handler waits for the reply of; if the handler of that waits, what that waits for; and so on."""
    while (wait := _wait_of(message)) and wait.moment is None:
        other = run.messages.get(wait.awaited)
        if other is None or other.id <= message.id:
            break
        message = other
    return message


def _run_of(message: Message) -> Handling | None:
    """The run of its handler that goes on; of several (it goes to many) one that waits for nothing."""
    runs = [run for run in message.handlings if run.end is None]
    return next((run for run in runs if not _waits(run)), runs[-1] if runs else None)


def _wait_of(message: Message) -> HandlerWait | None:
    """What the handler of a message waits for."""
    return _waits(run) if (run := _run_of(message)) else None


def _waits(run: Handling) -> HandlerWait | None:
    return run.waits[-1] if run.waits and run.waits[-1].end is None else None


def _keeping(end: RunAt, wait: HandlerWait) -> list[int]:
    """The messages that keep a handler waiting: what it awaits, or what those handle who have what it wants to lock."""
    claim, holder = end.run.claims.get(wait.awaited), _holder(end, wait)
    if claim is None:
        return [wait.awaited]
    if holder is not None:
        return [holder.by.message_id] if holder.by else []
    return [run.message_id for run in end.inside(claim.module, claim.resource)]


def _holder(end: RunAt, wait: HandlerWait) -> Claim | None:
    """Who has locked or reserved what a handler waits to lock or reserve."""
    claim = end.run.claims.get(wait.awaited)
    return end.held_by(claim.module, claim.resource) if claim else None
