"""The promises of central for every run, checked from the facts that it records and nothing else.

No moment before those that constraints and wiretaps put before it, or sooner than a delay allows; no child's start
before its parent's, no parent's end before its children's; nothing suspended or killed is started, and nothing where
others have locked or reserved the resource; no task is handled twice at once, or ends before its handler does; no
failure counts as dealt with that an exception handler only observed.
"""

from tca_tools.explore.observed.messages import Situation, TrackedMessage
from tca_wire.journal.facts import Delivered
from tca_wire.points import Moment, Point, TaskId
from tca_wire.rules import CHILDREN_FIRST, PARENT_FIRST

_ROUNDING = 1e-9  # seconds


def reached(now: Situation, task: TrackedMessage, moments: int) -> str:
    """The error in moments that a task has just reached; "" if there is none."""
    too_early = []
    if not task.is_killed:
        too_early += _not_met(now, task, moments)
        parent = now.parent(task)
        if parent is not None and moments & PARENT_FIRST & ~parent.reached and not task.role:
            too_early.append(f"the start of {parent}")
    for end in (one for one in Moment if one & CHILDREN_FIRST):
        if moments & end and task.message_class.is_goal:
            too_early += [f"the end of {child}" for child in now.children(task) if not child.reached & end]
    if task.is_over and task.is_handled:
        too_early.append("the end of its handler")
    if not too_early:
        return ""
    words = ", ".join(_words(Point(TaskId(task.id), moment)) for moment in Moment if moment & moments)
    return f"{words} ('{task.message}') came before {', '.join(too_early)}"


def delivered(now: Situation, message: TrackedMessage, fact: Delivered) -> str:
    """The error in giving a message to a handler now; "" if there is none."""
    if held := kept_out(now, message, fact.module, fact.resource):
        return held
    if message.is_handled and message.module not in now.slots_lost:
        return f"{message} was given to a handler while one has it"
    if message.is_suspended or message.is_killed:
        return f"{message} was given to a handler though it is {'suspended' if message.is_suspended else 'killed'}"
    too_early = _not_met(now, message, int(Moment.START_HANDLING))  # of a retried task, too
    return f"{message} was given to a handler before {', '.join(too_early)}" if too_early else ""


def kept_out(now: Situation, message: TrackedMessage, module: str, resource: str) -> str:
    """The error in letting a message in where others have locked or reserved the resource; "" if there is none."""
    held_by = now.held_by.get((module, resource))
    if held_by is None or (held_by.is_reserved and message.sent_by in (held_by.sender, module, "")):
        return ""
    how = "reserved" if held_by.is_reserved else "locked"
    return f"{message} was given to '{resource}' while {held_by.sender} has it {how}"


def returned(message: TrackedMessage | None, key: int) -> str:
    """The error in the end of a message's handler; "" if there is none."""
    return "" if message is not None and message.is_handled else f"a handler of {message or key} ended, and none had it"


def recovered(failing: TrackedMessage, handler: TrackedMessage | None) -> str:
    """The error in taking a failure for dealt with; "" if there is none."""
    is_resolved = handler is not None and handler.has_resolved
    return "" if is_resolved else f"{failing} was taken for recovered, and {handler} only observed its failure"


def _not_met(now: Situation, task: TrackedMessage, moments: int) -> list[str]:
    """The constraints on those moments of a task that are not met."""
    points = [_words(point) for moment, point in task.after if moments & moment and not now.is_past(point)]
    delays = [_words(point) for moment, point, _ in task.delayed if moments & moment]
    times = [time for moment, time in task.not_before if moments & moment and now.now < time - _ROUNDING]
    return [*points, *delays, *(f"{time - now.now:g} s were over" for time in times)]


def _words(point: Point) -> str:
    """A point with the number of its task."""
    return str(Point(TaskId(int(point.task)), point.moment))
