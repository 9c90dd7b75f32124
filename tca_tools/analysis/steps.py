"""What led to what: backwards from any moment of a run through whatever was waited for last. Pure.

Theory. An entry holds all that one event brought about, and no two entries have the same time. So the cause of what
happened at a time is the event of that entry: a handler returned, a message was sent, a delay was over. A handler that
returned or sent had worked since it was given its message, or since it last resumed from a wait; whatever let it begin
or resume is the event of *that* entry; and so on, back to where somebody acted of his own will. Each step goes back in
time, so a walk costs what it passes through, and a run is walked through in time proportional to its journal.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from tca_tools.run.records import Claim, HandlerWait, Handling, Hold, Message, Queueing, Suspension, Task
from tca_tools.run.whole_run import Run
from tca_wire.points import ROOT, Moment
from tca_wire.vocabulary import Role


class Doing(StrEnum):
    """What went on during a step."""

    WORK = "work"  # a handler ran, and waited for nothing
    OUTSIDE = "outside"  # a module worked outside of any handler
    DELAY = "delay"  # a constraint with a delay
    NO_HANDLER = "no handler"  # nobody handled the message
    QUEUED = "queued"  # for a resource, and no handler is known that had it
    LOCKED = "locked"  # a resource was locked from outside of any handler, or a lock was waited for in vain
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
    resumed: HandlerWait | None = None
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
    wait: HandlerWait | None = None
    """The wait that was over then, if the walk came by one."""


class Causes:
    """The causes of a run's events."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._ended: dict[float, Handling] = {}
        self._deliveries: dict[int, Handling] = {}
        for handling in run.handlings:
            if handling.delivery:
                self._deliveries[handling.delivery] = handling
                if handling.end is not None:
                    self._ended[handling.end] = handling
        self._sent = {message.received: message for message in run.messages.values() if not message.role}
        self._released = {
            claim.end: claim for claim in run.claims.values() if claim.end is not None and claim.granted is not None
        }
        self._resumed = {one.end: one for one in run.suspensions() if one.is_resumed}
        self._outside = {name: _Outside(run, module.waits) for name, module in run.modules.items()}
        self._waits: dict[int, list[HandlerWait]] = {}
        """Of runs of handlers that were walked through, their waits as they ended."""

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
        wait = self._last_over(handling, at.time)
        if wait is None:
            start, before = handling.start, _At(handling.start, handling.message_id)
        else:
            start = _end_of(wait)
            before = _At(start, wait.awaited, wait=wait)
        message = handling.message_id
        step = Step(start, at.time, Doing.WORK, message, handling.module, handling.resource, handling, wait)
        return step, before

    def _last_over(self, handling: Handling, time: float) -> HandlerWait | None:
        """The one of a handler's waits that was over last by then."""
        if not handling.waits:
            return None
        if (waits := self._waits.get(id(handling))) is None:
            waits = self._waits[id(handling)] = _by_end(handling.waits)
        place = bisect_right(waits, time, key=_end_of)
        return waits[place - 1] if place else None

    def _at_event(self, at: _At) -> tuple[Step | None, _At | None]:
        """What the event at a time was, and who brought it about."""
        if (ended := self._ended_then(at)) is not None:
            return None, _At(at.time, at.message_id, ended)
        if (resumed := self._resumed.get(at.time)) is not None and (stood := _stood(resumed, at.time)):
            return stood, _At(stood.start, resumed.task)
        if (sent := self._sent.get(at.time)) is not None:
            return self._by(sent.sender, sent.origin, sent.id, at.time)
        if (found := self._at_claim(at)) is not None:
            return found
        if (message := self._run.messages.get(at.message_id)) is not None:
            return self._without_event(message, at)
        return (None, None) if at.wait is None else self._in_vain(at.wait, at.time)

    def _at_claim(self, at: _At) -> tuple[Step | None, _At | None] | None:
        """Back into who had a lock until then; or from a lock that was wanted until then, to where it was asked for."""
        wanted, held = self._run.claims.get(at.message_id), self._released.get(at.time)
        if held is None or held is wanted or held.granted is None or held.granted >= at.time:
            return None if wanted is None else self._wanted(wanted, at.time)
        if holder := self.handling_of(held.origin, at.time):
            return None, _At(at.time, at.message_id, holder)
        return Step(held.granted, at.time, Doing.LOCKED, at.message_id, held.sender), _At(held.granted, held.id)

    def _ended_then(self, at: _At) -> Handling | None:
        """The handler that ended then; of several (a module was lost) that of the message that is looked at. One that
        was cut off while it waited did nothing.
        """
        message = self._run.messages.get(at.message_id)
        own = (run for run in reversed(message.handlings) if run.end == at.time) if message else ()
        ended = next(iter(own), None) or self._ended.get(at.time)
        waited = at.wait.by if at.wait else None
        return ended if ended is not None and ended is not waited and ended.start < at.time else None

    def _by(self, module: str, origin: int, message_id: int, time: float) -> tuple[Step | None, _At | None]:
        """Back into the handler that did something; or to where the program last waited, outside of any handler."""
        if run := self.handling_of(origin, time):
            return None, _At(time, message_id, run)
        if (run := self._deliveries.get(origin)) is not None and run.end is not None and run.end < time:
            step = Step(run.end, time, Doing.OUTSIDE, message_id, module)  # it went on beside its handler
            return step, _At(run.end, run.message_id, run)
        if origin or (outside := self._outside.get(module)) is None or (found := outside.last_over(time)) is None:
            return None, None
        start, wait = found
        step = Step(start, time, Doing.OUTSIDE, message_id, module, resumed=wait)
        return step, _At(start, wait.awaited, wait=wait)

    def _wanted(self, claim: Claim, time: float) -> tuple[Step | None, _At | None]:
        """Back to where a lock was asked for: nothing is known that let it be granted, or it was wanted in vain."""
        if claim.start >= time:
            return self._by(claim.sender, claim.origin, claim.id, time)
        message = claim.by.message_id if claim.by else claim.id
        step = Step(claim.start, time, Doing.LOCKED, message, claim.module, claim.resource)
        return step, _At(claim.start, claim.id)

    def _in_vain(self, wait: HandlerWait, time: float) -> tuple[Step | None, _At | None]:
        """Nothing is known that ended a wait: back to what went on of what was waited for, or to where it began."""
        if (claim := self._run.claims.get(wait.awaited)) is not None:
            return self._wanted(claim, time)
        message = self._run.messages.get(wait.awaited)
        if message is not None and (found := _went_on(self._run, message, time)):
            return found
        message_id, run = (wait.by.message_id, wait.by) if isinstance(wait.by, Handling) else (wait.awaited, None)
        return Step(wait.start, time, Doing.UNKNOWN, wait.awaited, ""), _At(wait.start, message_id, run)

    def _without_event(self, message: Message, at: _At) -> tuple[Step | None, _At | None]:
        """Nobody did anything just then: a time was due, or something happened that the journal does not tell."""
        time = at.time
        if message.role in (Role.CONDITION, Role.ACTION) and message.received == time:
            return self._monitored(message, time)
        queueing = self._left_queue(message, time)
        if queueing is not None and queueing.start < time:
            doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
            return _waited(queueing.start, time, doing, message.id, queueing)
        if isinstance(message, Task) and (held := self._held(message, time)):
            return held
        if message.received == time:
            return None, (_At(time, message.about) if message.about in self._run.messages else None)
        return self._until_ended(message, at)

    def _left_queue(self, message: Message, time: float) -> Queueing | None:
        """The stay in a queue that was over then; of what goes to many, of one of its copies."""
        queueings = [*message.queueings, *self._run.copies.get(message.id, ())]
        return next((one for one in queueings if one.end == time), None)

    def _until_ended(self, message: Message, at: _At) -> tuple[Step | None, _At | None]:
        """It was killed then, or nobody waited for it any longer, and it is not known that anybody did that."""
        time = at.time
        was_ended = any(when == time and name in ("killed", "failure") for when, name, _ in message.changes)
        if was_ended and isinstance(message, Task) and (stood := self._stood_until(message, time)):
            return None, _At(time, stood.id)
        ends = (run.end for run in reversed(message.handlings) if run.end is not None and run.end < time)
        since = max(next(ends, message.received), message.received)
        if was_ended:  # a handler that does not heed it goes on
            return _went_on(self._run, message, time) or _waited(since, time, Doing.KILLED, message.id)
        if at.wait is not None and at.wait.start < time:
            return self._in_vain(at.wait, time)
        return _went_on(self._run, message, time) or _waited(since, time, Doing.UNKNOWN, message.id)

    def _held(self, task: Task, time: float) -> tuple[Step | None, _At] | None:
        """A delay of a task was over then, or a suspension, or one began."""
        for hold in task.holds:
            if hold.over == time:
                return self._delayed(task, hold, time)
        for suspension in task.suspensions:
            if suspension.end == time and (stood := _stood(suspension, time)):
                return stood, _At(stood.start, suspension.cause)
            if suspension.start == time and suspension.cause == task.id:
                return self._before_suspension(task, time)
        return None

    def _stood_until(self, task: Task, time: float) -> Task | None:
        """What nobody handled under a task, or was suspended, until all was ended."""
        for one in self._run.under(task):
            unhandled = any(queueing.end == time and not queueing.module for queueing in one.queueings)
            if one is not task and (unhandled or any(end.end == time for end in one.suspensions)):
                return one
        return None

    def _before_suspension(self, task: Task, time: float) -> tuple[Step | None, _At]:
        """A task was suspended while nothing under it ran: back to what stood in a queue then, or else ran last or
        was suspended.
        """
        last = task.received
        for one in self._run.under(task):
            if any(queueing.start < queueing.end == time for queueing in one.queueings if queueing.end is not None):
                return None, _At(time, one.id)
            spans: list[Handling | Suspension] = [*one.handlings, *one.suspensions]
            last = max([last, *(span.end for span in spans if span.end is not None and span.end < time)])
        return _waited(last, time, Doing.UNKNOWN, task.id)

    def _delayed(self, task: Task, hold: Hold, time: float) -> tuple[Step, _At]:
        """Back to the point after which the delay counts; counted from the time that it was asked for, to that."""
        start, cause = delay_of(self._run, task, hold)
        start = start if start < time else min(hold.added, time)
        return Step(start, time, Doing.DELAY, task.id, ""), _At(start, cause)

    def _monitored(self, message: Message, time: float) -> tuple[Step | None, _At | None]:
        """Central asks a monitor's condition, or sends its action, when the time has come: back to its start."""
        monitor = self._run.tasks.get(message.about)
        if monitor is None:
            return None, None
        start = monitor.reached.get(Moment.START_HANDLING, monitor.received)
        if start >= time:
            return None, _At(time, monitor.id)
        return Step(start, time, Doing.WATCHING, monitor.id, ""), _At(start, monitor.id)


def _went_on(run: Run, message: Message, time: float) -> tuple[Step | None, _At] | None:
    """Somebody waited no longer for a message or task that was still handled, or still in a queue: back to that."""
    handling = next((handling for handling in reversed(message.handlings) if _covers(handling, time)), None)
    if handling is not None:
        wait = next(
            (wait for wait in reversed(handling.waits) if _covers(wait, time) and wait.awaited > message.id), None
        )
        return None, _At(time, wait.awaited) if wait is not None else _At(time, message.id, handling)
    queueings = message.queueings or run.copies.get(message.id, [])
    queueing = next((one for one in reversed(queueings) if _covers(one, time)), None)
    if queueing is None:
        return None
    doing = Doing.QUEUED if queueing.module else Doing.NO_HANDLER
    return _waited(queueing.start, time, doing, message.id, queueing)


def _covers(span: Handling | HandlerWait | Queueing, time: float) -> bool:
    return span.start < time and (span.end is None or span.end > time)


def _before(step: Step, since: float) -> _At:
    """Where a walk goes on that leaves out the wait before a step: in its handler, or where it was put into a queue."""
    return _At(since, step.message_id, step.handling if step.resumed else None)


def delay_of(run: Run, task: Task, hold: Hold) -> tuple[float, int]:
    """When the delay of a constraint began; and the message with which it did."""
    before = hold.constraint.before
    other = run.tasks.get(before.task) if before.task != ROOT else None
    return (other.reached.get(before.moment, hold.added), other.id) if other else (hold.added, task.id)


def _waited(start: float, end: float, doing: Doing, message: int, where: Queueing | None = None) -> tuple[Step, _At]:
    module, resource = (where.module, where.resource) if where else ("", "")
    return Step(start, end, doing, message, module, resource), _At(start, message)


def _stood(suspension: Suspension, end: float) -> Step | None:
    """The part of a suspension in which nothing ran any more."""
    since = suspension.standstill
    return Step(since, end, Doing.SUSPENDED, suspension.cause, "") if since is not None and since < end else None


def _by_end(waits: list[HandlerWait]) -> list[HandlerWait]:
    """Those that took time and are over, as they ended. What takes no time is over with the event that begins it."""
    return sorted((wait for wait in waits if wait.end is not None and wait.end > wait.start), key=_end_of)


def _end_of(wait: HandlerWait) -> float:
    return wait.start if wait.end is None else wait.end


class _Outside:
    """What a program waited for outside of any handler. Where it looks at what had come so far before, it has waited
    until then.
    """

    def __init__(self, run: Run, waits: list[HandlerWait]) -> None:
        self._ends: list[float] = []
        self._last: list[tuple[float, HandlerWait]] = []
        """What was over last until then, and since when."""
        for wait in sorted((wait for wait in waits if wait.end is not None), key=_end_of):
            end = since = _end_of(wait)
            if wait.start == end:
                task = run.tasks.get(wait.awaited)
                since = task.reached.get(wait.moment, end) if task is not None and wait.moment else end
                if since == end:
                    continue
            self._ends.append(end)
            is_last = not self._last or since >= self._last[-1][0]
            self._last.append((since, wait) if is_last else self._last[-1])

    def last_over(self, time: float) -> tuple[float, HandlerWait] | None:
        """What was over last when it did something at a time, and since when."""
        place = bisect_left(self._ends, time)
        return self._last[place - 1] if place else None
