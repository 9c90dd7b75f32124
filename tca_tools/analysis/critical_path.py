"""The critical path: what a task waited for last, and what that waited for last, back to who started it all. Pure.

The path has no gaps, so its steps add up to the time from its first to its last: making any of them shorter is the
only way to end sooner, and it helps until another path is the longest.
"""

from dataclasses import dataclass, field
from math import nextafter

from tca_tools.analysis.causes import Causes, Doing, Step
from tca_tools.analysis.given_up import still_handled
from tca_tools.analysis.releases import released, released_by
from tca_tools.analysis.standing import going_on
from tca_tools.analysis.summary import is_over, mattering
from tca_tools.analysis.words import moment, seconds
from tca_tools.run.at_time import RunAt
from tca_tools.run.records import HandlerWait, Message, Queueing, Suspension, Task
from tca_tools.run.whole_run import UNKNOWN, Run
from tca_tools.why.story import awaited
from tca_tools.why.waiting import of_blocker, why_waiting
from tca_tools.why.whereabouts import kept_busy, why_in_vain
from tca_wire.points import ROOT, Moment, TaskId
from tca_wire.text.facts_in_words import by_whom, place


@dataclass(slots=True)
class CriticalPath:
    """The critical path of one task."""

    task: Task
    is_open: bool
    """Whether the task had not ended: then it leads to what went on last."""
    steps: list[Step]
    """Oldest first; each begins when the one before ends."""
    because: list[str] = field(default_factory=list)
    """Of an open one that leads to something outside of its task: the waits that lead there, in words."""

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


def last_task(run: Run) -> Task | None:
    """The top-level task that ended last; one that goes on, if there is one: the oldest. Monitors that stand by do not
    count, but what they have sent does.
    """
    top = mattering(run)
    living = next((task for task in top if not is_over(task)), None)
    return living or max(top, key=_end_of, default=None)


def longest_task(run: Run) -> Task | None:
    """The one of these that took longest."""
    top = mattering(run)
    return max(top, key=lambda task: (_end_of(task) if is_over(task) else run.time) - task.received, default=None)


def critical_path(run: Run, causes: Causes, task: Task) -> CriticalPath:
    """What led to the end of *task*; if it has not ended, to what goes on in it."""
    if is_over(task):
        steps = list(causes.back_from(_end_of(task), task.id))
        return CriticalPath(task, False, steps[::-1])
    found = going_on(run, task)
    steps = [found.standing] if found.standing else []
    steps += causes.back_from(found.time, found.message_id, found.handling)
    return CriticalPath(task, True, steps[::-1], found.because)


def shares(run: Run, path: CriticalPath) -> list[Share]:
    """Where the path's time went, by message and place: the longest first."""
    found: dict[tuple[Doing, str, str], Share] = {}
    for step in path.steps:
        name, where = named(run, step.message_id), where_of(step)
        if step.doing is Doing.OUTSIDE:
            name = ""
        share = found.setdefault((step.doing, name, where), Share(step.doing, name, where, 0, 0.0, 0.0))
        share.steps += 1
        share.seconds += step.seconds
    for share in found.values():
        share.share = share.seconds / path.seconds if path.seconds > 0 else 0.0
    return sorted(found.values(), key=lambda share: -share.seconds)


def named(run: Run, number: int) -> str:
    """What a message, or a lock, is called, without its number."""
    if (claim := run.claims.get(number)) is not None:
        return f"{'reservation' if claim.is_reserved else 'lock'} of {place(claim.module, claim.resource)}"
    name = run.name(number)
    return "what was sent before the journal begins" if name == UNKNOWN else name


def where_of(step: Step) -> str:
    """The resource, or the module, of a step."""
    return place(step.module, step.resource) if step.module else ""


def queueing_before(run: Run, step: Step) -> Queueing | None:
    """The wait in a queue that ended when a step began."""
    message = run.messages.get(step.message_id)
    if message is None or step.resumed or step.doing is not Doing.WORK:
        return None
    return next((one for one in reversed(message.queueings) if one.end == step.start and one.start < step.start), None)


def why_then(run: Run, step: Step) -> str:
    """Why a step did not begin sooner, in words; of one that stands, why it does. "" if nothing is known."""
    message = run.messages.get(step.message_id)
    if message and step.doing in _WHY and (why := _WHY[step.doing](run, message, step)):
        return why
    if step.resumed:
        who = "sender" if step.doing is Doing.OUTSIDE else "handler"
        return f"its {who} waited {awaited(run, step.resumed)}{_in_vain(run, step.resumed)}"
    if queueing := queueing_before(run, step):
        still = still_handled(RunAt(run, nextafter(step.start, 0.0)), message.id, step.start) if message else ""
        return _in_queue(queueing, step.start) + (f"; {still}" if still else "")
    if message is None or message.received == step.start:
        return _made_for(run, message) if message and message.role else ""
    if isinstance(message, Task):
        reasons = why_waiting(RunAt(run, nextafter(step.start, 0.0)), TaskId(message.id))
        return f"it waited {' and '.join(reasons)}{released(run, message, step.start)}" if reasons else ""
    return ""


def _in_queue(queueing: Queueing, until: float) -> str:
    waited = seconds(until - queueing.start)
    if not queueing.module:
        return f"{waited} without a module that handles it"
    return f"{waited} in the queue for {place(queueing.module, queueing.resource)}"


def _made_for(run: Run, message: Message) -> str:
    """What central made a message for; and if that could not go on before, why."""
    about, text = run.tasks.get(message.about), f"{message.role} for {run.describe(message.about)}"
    if about is None or about.received >= message.received:
        return text
    at = RunAt(run, nextafter(message.received, 0.0))
    held = next((words for words, _ in released_by(at, about, message.received)), "")
    return f"{text}, which waited {held}{released(run, about, message.received)}" if held else text


def _in_vain(run: Run, wait: HandlerWait) -> str:
    """``, in vain``, with what is known of why; "" if what was waited for came."""
    end = run.time if wait.end is None else wait.end
    if why := run.deadlock(wait) or why_in_vain(run, wait):
        still = still_handled(RunAt(run, nextafter(end, 0.0)), wait.awaited, end)
        return f", in vain: {why}" + (f"; {still}" if still else "")
    claim, task = run.claims.get(wait.awaited), run.tasks.get(wait.awaited)
    came = claim.granted if claim else task.reached.get(wait.moment) if task and wait.moment else end
    return ", in vain" if came is None or came > end else ""


def _why_delayed(run: Run, message: Message, step: Step) -> str:
    """Which delay it was; of one that is not over, until when it lasts."""
    for hold in message.holds if isinstance(message, Task) else ():
        over = run.time if hold.over is None else hold.over
        if hold.constraint.delay and over == step.end:
            at = RunAt(run, step.start)
            words = of_blocker(at, at.tasks[message.id], hold)
            if hold.over is not None:
                return f"it waited {words}"
            is_absolute = hold.constraint.before.task == ROOT
            due = hold.constraint.delay + (0.0 if is_absolute else step.start)
            due_at = "" if is_absolute else f": that is at {moment(due)}"
            since = "from now" if run.is_live else "after the journal ends"
            later = f", {seconds(due - run.time)} {since}" if due > run.time else ""
            return f"it waits {words}{due_at}{later}"
    return ""


def _why_suspended(_run: Run, message: Message, step: Step) -> str:
    suspensions = message.suspensions if isinstance(message, Task) else []
    return next((_suspended(one, step) for one in suspensions if _covers(one, step)), "")


def _covers(suspension: Suspension, step: Step) -> bool:
    """Whether a step is a suspension, or the later part of one."""
    return suspension.start <= step.start and (suspension.end is None or suspension.end >= step.end)


def _suspended(suspension: Suspension, step: Step) -> str:
    """Who suspended it, and when if that was before the step."""
    text = by_whom(suspension.by) + f" at {moment(suspension.start)}" * (suspension.start < step.start)
    return f"suspended{text}" if text else ""


def _why_queued(run: Run, message: Message, step: Step) -> str:
    at = RunAt(run, nextafter(step.end, 0.0))
    why = kept_busy(at, step.module, step.resource, message)
    still = still_handled(at, message.id, step.end)
    where = place(step.module, step.resource)
    return f"for {where}, {why}" + (f"; {still}" if still else "") if why else ""


def _why_held(run: Run, message: Message, _step: Step) -> str:
    return f"it waits {' and '.join(why_waiting(RunAt(run), TaskId(message.id)))}"


def _why_locked(run: Run, message: Message, _step: Step) -> str:
    waits = message.handling.waits if message.handling else []
    return f"its handler waits {awaited(run, waits[-1])}" if waits else ""


_WHY = {
    Doing.DELAY: _why_delayed,
    Doing.SUSPENDED: _why_suspended,
    Doing.QUEUED: _why_queued,
    Doing.HELD: _why_held,
    Doing.LOCKED: _why_locked,
}
"""What there is to say of steps in which nothing was done."""


def _end_of(task: Task) -> float:
    end = task.reached.get(Moment.END_ACHIEVING)
    return end if end is not None else (task.states[-1][0] if task.states else task.received)
