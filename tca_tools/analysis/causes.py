"""What led to what: backwards from any moment of a run through whatever was waited for last. Pure.

Theory. An entry holds all that one event brought about, and no two entries have the same time. So the cause of what
happened at a time is the event of that entry: a handler returned, a message was sent, a delay was over. A handler that
returned or sent had worked since it was given its message, or since it last resumed from a wait; whatever let it begin
or resume is the event of *that* entry; and so on, back to where somebody acted of his own will. Each step goes back in
time, so a walk costs what it passes through, and a run is walked through in time proportional to its journal.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from operator import attrgetter

from tca_tools.past import Past
from tca_tools.records import Handling, Message, Queueing, Suspension, Task, Wait
from tca_wire.points import ROOT, Moment
from tca_wire.vocabulary import Role


class Doing(StrEnum):
    """What went on during a step."""

    WORK = "work"  # a handler ran, and waited for nothing
    OUTSIDE = "outside"  # a module worked outside of any handler
    DELAY = "delay"  # a constraint with a delay
    NO_HANDLER = "no handler"  # nobody handled the message
    QUEUED = "queued"  # for a resource, and no handler is known that had it
    LOCKED = "locked"  # a resource was locked from outside of any handler
    SUSPENDED = "suspended"  # and nothing under it ran on any more
    KILLED = "killed"  # it went on until it was killed, or a failure was raised on it, from outside
    HELD = "held"  # by a constraint, or its parent
    WATCHING = "watching"  # a monitor, until it looked again or its condition held
    UNKNOWN = "unknown"  # the journal does not say what was waited for


@dataclass(slots=True)
class Step:
    """A span of time, and what had to pass in it before what follows could happen."""

    start: float
    end: float
    doing: Doing
    message_id: int
    """The message that was handled or waited (0: none)."""
    module: str
    """Whose handler ran, or who worked outside of one; "" if nobody did."""
    resource: str = ""
    handling: Handling | None = None
    """The run of the handler, if it was one."""
    resumed: Wait | None = None
    """The wait whose end let it go on; None if it began then."""

    @property
    def seconds(self) -> float:
        """How long it took."""
        return self.end - self.start


@dataclass(slots=True)
class _At:
    """Where a walk stands: before *time*, in the run of a handler; or (None) at what happened to a message then."""

    time: float
    message_id: int
    handling: Handling | None = None


class Causes:
    """The causes of a run's events."""

    def __init__(self, past: Past) -> None:
        self._past = past
        self._ended: dict[float, Handling] = {}
        self._deliveries: dict[int, Handling] = {}
        for handling in past.handlings:
            if handling.delivery:
                self._deliveries[handling.delivery] = handling
                if handling.end is not None:
                    self._ended[handling.end] = handling
        self._sent = {message.received: message for message in past.messages.values() if not message.role}
        self._claims_ended = {claim.end: claim for claim in past.claims.values() if claim.end is not None}
        self._resumed = {one.end: one for one in past.suspensions() if one.is_resumed}
        self._waits = {name: _by_end(module.waits) for name, module in past.modules.items()}

    def back_from(self, time: float, message_id: int = 0, handling: Handling | None = None) -> Iterator[Step]:
        """The steps that led to what happened at *time* to a message, or that a handler did then; the newest first."""
        return self._back(_At(time, message_id, handling), lambda _: None)

    def back_before(self, step: Step, since: Callable[[Step], float | None]) -> Iterator[Step]:
        """The steps before *step*, newest first, as if there had been no waits before those for which *since* says from
        when on they waited: from there the walk goes on with who waited, not with what he waited for.
        """
        start = since(step)
        return self._back(_before(step, step.start if start is None else start), since)

    def _back(self, first: _At, since: Callable[[Step], float | None]) -> Iterator[Step]:
        at: _At | None = first
        seen = set()
        while at is not None and (place := (at.time, at.message_id, id(at.handling))) not in seen:
            seen.add(place)
            step, at = self._in_handler(at, at.handling) if at.handling else self._at_event(at)
            if step is not None and step.end > step.start:
                yield step
                if (start := since(step)) is not None:
                    at = _before(step, start)

    def handling_of(self, delivery: int, time: float) -> Handling | None:
        """The run of a handler that a delivery stands for, if it went on at *time*."""
        found = self._deliveries.get(delivery)
        return found if found and found.start < time and (found.end is None or found.end >= time) else None

    def _in_handler(self, at: _At, handling: Handling) -> tuple[Step, _At]:
        """Back to where the handler last resumed, or else began."""
        wait = _last_over(handling.waits, at.time)
        start = handling.start if wait is None else _end_of(wait)
        message = handling.message_id
        step = Step(start, at.time, Doing.WORK, message, handling.module, handling.resource, handling, wait)
        return step, _At(start, message if wait is None else wait.awaited)

    def _at_event(self, at: _At) -> tuple[Step | None, _At | None]:
        """What the event at a time was, and who brought it about."""
        if (ended := self._ended.get(at.time)) is not None and ended.start < at.time:
            return None, _At(at.time, at.message_id, ended)
        if (resumed := self._resumed.get(at.time)) is not None and (stood := _stood(resumed, at.time)):
            return stood, _At(stood.start, resumed.task)
        if (sent := self._sent.get(at.time)) is not None:
            return self._sent_by(sent, at.time)
        claim = self._claims_ended.get(at.time)
        if claim is not None and claim.granted is not None:
            if holder := self.handling_of(claim.origin, at.time):
                return None, _At(at.time, at.message_id, holder)
            step = Step(claim.granted, at.time, Doing.LOCKED, at.message_id, claim.sender)
            return step, _At(claim.granted, at.message_id)
        message = self._past.messages.get(at.message_id)
        return (None, None) if message is None else self._without_event(message, at.time)

    def _sent_by(self, sent: Message, time: float) -> tuple[Step | None, _At | None]:
        """Back into the handler that sent a message; or to where the sender last waited, outside of any handler."""
        if origin := self.handling_of(sent.origin, time):
            return None, _At(time, sent.id, origin)
        waits = self._waits.get(sent.sender, [])
        place = bisect_right(waits, time, key=_end_of)
        if sent.origin or not place:
            return None, None
        wait = waits[place - 1]
        start = _end_of(wait)
        return Step(start, time, Doing.OUTSIDE, sent.id, sent.sender, resumed=wait), _At(start, wait.awaited)

    def _without_event(self, message: Message, time: float) -> tuple[Step | None, _At | None]:
        """Nobody did anything just then: a time was due, or something happened that the journal does not tell."""
        if message.role in (Role.CONDITION, Role.ACTION) and message.received == time:
            return self._monitored(message, time)
        queueing = next((one for one in message.queueings if one.end == time), None)
        if queueing is not None and queueing.start < time:
            doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
            return _waited(queueing.start, time, doing, message.id, queueing)
        if isinstance(message, Task) and (held := self._held(message, time)):
            return held
        if message.received == time:
            return None, (_At(time, message.about) if message.about in self._past.messages else None)
        was_ended = any(when == time and name in ("killed", "failure") for when, name, _ in message.changes)
        if was_ended and isinstance(message, Task) and (stood := self._stood_until(message, time)):
            return None, _At(time, stood.id)
        ends = (run.end for run in reversed(message.handlings) if run.end is not None and run.end < time)
        since = max(next(ends, message.received), message.received)
        went_on = None if was_ended else _went_on(message, time)
        return went_on or _waited(since, time, Doing.KILLED if was_ended else Doing.UNKNOWN, message.id)

    def _held(self, task: Task, time: float) -> tuple[Step | None, _At] | None:
        """A delay of a task was over then, or a suspension, or one began."""
        for hold in task.holds:
            if hold.over == time:
                before = hold.constraint.before
                return self._delayed(task, before.task, before.moment, hold.added, time)
        for suspension in task.suspensions:
            if suspension.end == time and (stood := _stood(suspension, time)):
                return stood, _At(stood.start, suspension.cause)
            if suspension.start == time and suspension.cause == task.id:
                return self._before_suspension(task, time)
        return None

    def _stood_until(self, task: Task, time: float) -> Task | None:
        """What nobody handled under a task, or was suspended, until all was ended."""
        for one in self._past.under(task):
            unhandled = any(queueing.end == time and not queueing.module for queueing in one.queueings)
            if one is not task and (unhandled or any(end.end == time for end in one.suspensions)):
                return one
        return None

    def _before_suspension(self, task: Task, time: float) -> tuple[Step | None, _At]:
        """A task was suspended while nothing under it ran: back to what stood in a queue then, or else ran last or
        was suspended.
        """
        last = task.received
        for one in self._past.under(task):
            if any(queueing.start < queueing.end == time for queueing in one.queueings if queueing.end is not None):
                return None, _At(time, one.id)
            spans: list[Handling | Suspension] = [*one.handlings, *one.suspensions]
            last = max([last, *(span.end for span in spans if span.end is not None and span.end < time)])
        return _waited(last, time, Doing.UNKNOWN, task.id)

    def _delayed(self, task: Task, before: int, moment: Moment, added: float, time: float) -> tuple[Step, _At]:
        """Back to the point after which the delay counts; counted from the time that it was asked for, to that."""
        start, cause = delay_of(self._past, task, before, moment, added)
        start = start if start < time else min(added, time)
        return Step(start, time, Doing.DELAY, task.id, ""), _At(start, cause)

    def _monitored(self, message: Message, time: float) -> tuple[Step | None, _At | None]:
        """Central asks a monitor's condition, or sends its action, when the time has come: back to its start."""
        monitor = self._past.tasks.get(message.about)
        if monitor is None:
            return None, None
        start = monitor.reached.get(Moment.START_HANDLING, monitor.received)
        if start >= time:
            return None, _At(time, monitor.id)
        return Step(start, time, Doing.WATCHING, monitor.id, ""), _At(start, monitor.id)


def _went_on(message: Message, time: float) -> tuple[Step | None, _At] | None:
    """Somebody waited no longer for a message or task that was still handled, or still in a queue: back to that."""
    run = next((run for run in reversed(message.handlings) if _covers(run, time)), None)
    if run is not None:
        wait = next((wait for wait in reversed(run.waits) if _covers(wait, time) and wait.awaited > message.id), None)
        return None, _At(time, wait.awaited) if wait is not None else _At(time, message.id, run)
    queueing = next((one for one in reversed(message.queueings) if _covers(one, time)), None)
    if queueing is None:
        return None
    doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
    return _waited(queueing.start, time, doing, message.id, queueing)


def _covers(span: Handling | Wait | Queueing, time: float) -> bool:
    return span.start < time and (span.end is None or span.end > time)


def _before(step: Step, since: float) -> _At:
    """Where a walk goes on that leaves out the wait before a step: in its handler, or where it was put into a queue."""
    return _At(since, step.message_id, step.handling if step.resumed else None)


def delay_of(past: Past, task: Task, before: int, moment: Moment, added: float) -> tuple[float, int]:
    """When a delay of a task began that counts from a moment of task *before*; and the message with which it did."""
    other = past.tasks.get(before) if before != ROOT else None
    return (other.reached.get(moment, added), other.id) if other else (added, task.id)


def _waited(start: float, end: float, doing: Doing, message: int, where: Queueing | None = None) -> tuple[Step, _At]:
    module, resource = (where.module, where.resource) if where else ("", "")
    return Step(start, end, doing, message, module, resource), _At(start, message)


def _stood(suspension: Suspension, end: float) -> Step | None:
    """The part of a suspension in which nothing ran any more."""
    since = suspension.standstill
    return Step(since, end, Doing.SUSPENDED, suspension.cause, "") if since is not None and since < end else None


def _last_over(waits: list[Wait], time: float) -> Wait | None:
    """The last of a handler's waits that was over by then."""
    place = bisect_right(waits, time, key=attrgetter("start"))
    while place:
        place -= 1
        end = waits[place].end
        if end is not None and end <= time:
            return waits[place]
    return None


def _by_end(waits: list[Wait]) -> list[Wait]:
    """Those that are over, as they ended."""
    return sorted((wait for wait in waits if wait.end is not None), key=_end_of)


def _end_of(wait: Wait) -> float:
    return wait.start if wait.end is None else wait.end
