"""The critical path: what a task waited for last, and what that waited for last, back to who started it all. Pure.

The path has no gaps, so its steps add up to the time from its first to its last: making any of them shorter is the
only way to end sooner, and it helps until another path is the longest.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import nextafter
from operator import attrgetter

from tca_tools.analysis.causes import Causes, Doing, Step
from tca_tools.analysis.summary import is_over
from tca_tools.analysis.words import moment, seconds
from tca_tools.past import Past
from tca_tools.records import Handling, Message, Queueing, Suspension, Task
from tca_tools.story import awaited
from tca_tools.then import Then
from tca_tools.waiting import why_waiting
from tca_wire.points import Moment, TaskId
from tca_wire.wording import by_whom, place


@dataclass(slots=True)
class CriticalPath:
    """The critical path of one task."""

    task: Task
    is_open: bool
    """Whether the task had not ended: then it leads to what went on last."""
    steps: list[Step]
    """Oldest first; each begins when the one before ends."""

    @property
    def start(self) -> float:
        """When it begins."""
        return self.steps[0].start if self.steps else self.end

    @property
    def end(self) -> float:
        """When its task ended."""
        return self.steps[-1].end if self.steps else 0.0

    @property
    def seconds(self) -> float:
        """How long it is."""
        return self.end - self.start


@dataclass(slots=True)
class Share:
    """All steps of a path that have the same message, place and kind."""

    doing: Doing
    name: str
    """The message."""
    where: str
    steps: int
    seconds: float
    share: float
    """Of the whole path (0 to 1)."""


def last_task(past: Past) -> Task | None:
    """The top-level task that ended last; one that goes on, if there is one: the oldest."""
    top = [past.tasks[task] for task in past.top]
    living = next((task for task in top if not is_over(task)), None)
    return living or max(top, key=_end_of, default=None)


def longest_task(past: Past) -> Task | None:
    """The top-level task that took longest."""
    top = (past.tasks[task] for task in past.top)
    return max(top, key=lambda task: (_end_of(task) if is_over(task) else past.time) - task.received, default=None)


def critical_path(past: Past, causes: Causes, task: Task) -> CriticalPath:
    """What led to the end of *task*; if it has not ended, to what goes on in it."""
    if is_over(task):
        steps = list(causes.back_from(_end_of(task), task.id))
        return CriticalPath(task, False, steps[::-1])
    running = _running_under(past, task)
    if running:
        steps = list(causes.back_from(past.time, running.message_id, running))
        return CriticalPath(task, True, steps[::-1])
    if standing := _standing_under(past, task):
        steps = [standing, *causes.back_from(standing.start, standing.message_id)]
        return CriticalPath(task, True, steps[::-1])
    last = _last_change_under(past, task)
    steps = [Step(last, past.time, Doing.UNKNOWN, task.id, "")] if past.time > last else []
    return CriticalPath(task, True, [*steps, *causes.back_from(last, task.id)][::-1])


def shares(past: Past, path: CriticalPath) -> list[Share]:
    """Where the path's time went, by message and place: the longest first."""
    found: dict[tuple[Doing, str, str], Share] = {}
    for step in path.steps:
        name, where = past.name(step.message_id), where_of(step)
        if step.doing is Doing.OUTSIDE:
            name = ""
        share = found.setdefault((step.doing, name, where), Share(step.doing, name, where, 0, 0.0, 0.0))
        share.steps += 1
        share.seconds += step.seconds
    for share in found.values():
        share.share = share.seconds / path.seconds if path.seconds > 0 else 0.0
    return sorted(found.values(), key=lambda share: -share.seconds)


def where_of(step: Step) -> str:
    """The resource, or the module, of a step."""
    return place(step.module, step.resource) if step.module else ""


def queueing_before(past: Past, step: Step) -> Queueing | None:
    """The wait in a queue that ended when a step began."""
    message = past.messages.get(step.message_id)
    if message is None or step.resumed or step.doing is not Doing.WORK:
        return None
    return next((one for one in reversed(message.queueings) if one.end == step.start and one.start < step.start), None)


def why_then(past: Past, step: Step) -> str:
    """Why a step did not begin sooner, in words; "" if nothing is known that held it back."""
    if step.resumed:
        return (
            f"its sender waited {awaited(past, step.resumed)}"
            if step.doing is Doing.OUTSIDE
            else (f"its handler waited {awaited(past, step.resumed)}")
        )
    if queueing := queueing_before(past, step):
        return f"{seconds(step.start - queueing.start)} in the queue for {place(queueing.module, queueing.resource)}"
    message = past.messages.get(step.message_id)
    if message is None or message.received == step.start:
        return f"{message.role} for {past.describe(message.about)}" if message and message.role else ""
    if isinstance(message, Task):
        if step.doing is Doing.SUSPENDED:
            return next((_suspended(one, step) for one in message.suspensions if _covers(one, step)), "")
        reasons = why_waiting(Then(past, nextafter(step.start, 0.0)), TaskId(message.id))
        return f"it waited {' and '.join(reasons)}" if reasons else ""
    return ""


def _covers(suspension: Suspension, step: Step) -> bool:
    """Whether a step is a suspension, or the later part of one."""
    return suspension.start <= step.start and (suspension.end is None or suspension.end >= step.end)


def _suspended(suspension: Suspension, step: Step) -> str:
    """Who suspended it, and when if that was before the step."""
    text = by_whom(suspension.by) + f" at {moment(suspension.start)}" * (suspension.start < step.start)
    return f"suspended{text}" if text else ""


def _end_of(task: Task) -> float:
    end = task.reached.get(Moment.END_ACHIEVING)
    return end if end is not None else (task.states[-1][0] if task.states else task.received)


def _running_under(past: Past, task: Task) -> Handling | None:
    """The handler under a task that has run longest and waits for nothing; replies that are waited for are followed."""
    for one in past.under(task):
        last = _awaited_last(past, one)
        if last.handling and not _blocks(last.handling):
            return last.handling
    return None


def _standing_under(past: Past, task: Task) -> Step | None:
    """What has stood longest under a task of which nothing runs: it is suspended, in a queue, or nobody handles it."""
    found = [step for one in past.under(task) for step in _standing(past, one) if step.seconds > 0]
    return min(found, key=attrgetter("start"), default=None)


def _standing(past: Past, task: Task) -> Iterator[Step]:
    suspension = task.suspension
    if suspension and suspension.cause == task.id and (since := suspension.standstill) is not None:
        yield Step(since, past.time, Doing.SUSPENDED, task.id, "")
    last = _awaited_last(past, task)
    if last.is_queued:
        queueing = last.queueings[-1]
        doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
        yield Step(queueing.start, past.time, doing, last.id, queueing.module, queueing.resource)


def _awaited_last(past: Past, task: Task) -> Message:
    """What the handler of a task waits for; if the handler of that waits, what that waits for; and so on."""
    message: Message = task
    while message.handling and _blocks(message.handling):
        awaited = past.messages.get(message.handling.waits[-1].awaited)
        if awaited is None or awaited.id <= message.id:
            break
        message = awaited
    return message


def _blocks(handling: Handling) -> bool:
    return bool(handling.waits) and handling.waits[-1].end is None


def _last_change_under(past: Past, task: Task) -> float:
    """When something last happened under a task."""
    return max((one.states[-1][0] for one in past.under(task) if one.states), default=task.received)
