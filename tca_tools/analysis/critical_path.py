"""The critical path: what a task waited for last, and what that waited for last, back to who started it all. Pure.

The path has no gaps, so its steps add up to the time from its first to its last: making any of them shorter is the
only way to end sooner, and it helps until another path is the longest.
"""

from dataclasses import dataclass, field
from math import inf, nextafter

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.given_up import still_handled_in_words
from tca_tools.analysis.long_waits import handler_wait_in_words
from tca_tools.analysis.releases import ended_at, in_words, released
from tca_tools.analysis.standing import at_last
from tca_tools.analysis.steps import Doing, Step
from tca_tools.analysis.summary import is_over, mattering
from tca_tools.run.at_time import RunAt
from tca_tools.run.records import Message, Queueing, Task
from tca_tools.run.whole_run import UNKNOWN, Run
from tca_tools.why.wait_words import told, wait_for
from tca_tools.why.waits import waits_now, waits_of
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration, run_time
from tca_wire.text.waits_in_words import in_words as clause
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.waits import WaitKind


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
    found = at_last(run, task)
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
        still = still_handled_in_words(run, step.resumed.awaited, step.start)
        return f"its {who} waited {handler_wait_in_words(run, step.resumed)}{still}"
    if message is None:
        return ""
    if queueing := queueing_before(run, step):
        return _in_queue(queueing, step.start) + still_handled_in_words(run, message.id, step.start)
    if message.received == step.start and message.role:
        return _made_for(run, message)
    return _released(run, message, step) if isinstance(message, Task) else ""


def _released(run: Run, message: Task, step: Step) -> str:
    """What it waited for until the step began."""
    waits = ended_at(run, message, step.start)
    return f"it waited {in_words(run, waits, step.start)}{released(run, message, step.start)}" if waits else ""


def _in_queue(queueing: Queueing, until: float) -> str:
    waited = duration(until - queueing.start)
    if not queueing.module:
        return f"{waited} without a module that handles it"
    return f"{waited} in the queue for {place(queueing.module, queueing.resource)}"


def _made_for(run: Run, message: Message) -> str:
    """What central made a message for; and if that could not go on before, why."""
    about, text = run.tasks.get(message.about), f"{message.role} for {run.describe(message.about)}"
    if about is None or about.received >= message.received:
        return text
    waits = ended_at(run, about, message.received)
    held = f", which waited {in_words(run, waits[:1], message.received)}" if waits else ""
    return text + held + released(run, about, message.received) * bool(held)


def _why_delayed(run: Run, message: Message, step: Step) -> str:
    """Which delay it was; of one that is not over, until when it lasts."""
    delays = (one for one in waits_of(run, message.id) if one.kind is WaitKind.DELAY)
    delay = next((one for one in delays if min(one.end, run.time) == step.end), None)
    if delay is None:
        return ""
    told = wait_for(RunAt(run, step.start), delay)
    is_open, due = delay.end == inf, told.seconds or 0.0
    since = "from now" if run.is_live else "after the journal ends"
    later = f", {duration(due - run.time)} {since}" if is_open and due > run.time else ""
    return f"it wait{'s' if is_open else 'ed'} {clause(told)}{later}"


def _why_suspended(_run: Run, message: Message, step: Step) -> str:
    suspensions = message.suspensions if isinstance(message, Task) else []
    for one in suspensions:
        if one.start <= step.start and (one.end is None or one.end >= step.end):
            text = by_whom(one.by) + f" at {run_time(one.start)}" * (one.start < step.start)
            return f"suspended{text}" if text else ""
    return ""


def _why_standing(run: Run, message: Message, step: Step) -> str:
    """What it waits for when the journal ends, or the step."""
    at = RunAt(run, nextafter(step.end, 0.0))
    words = several_in_words(told(at, waits_now(at, message.id)))
    return f"it waits {words}{still_handled_in_words(run, message.id, step.end)}" if words else ""


_WHY = {
    Doing.DELAY: _why_delayed,
    Doing.SUSPENDED: _why_suspended,
    Doing.QUEUED: _why_standing,
    Doing.HELD: _why_standing,
    Doing.LOCKED: _why_standing,
}
"""What there is to say of steps in which nothing was done."""


def _end_of(task: Task) -> float:
    end = task.reached.get(Moment.END_ACHIEVING)
    return end if end is not None else (task.states[-1][0] if task.states else task.received)
