"""What was known at a moment of a run, from records that go on after it. Pure, and nothing is folded again.

A moment is the time of an entry: each entry has its own. Looking at one task costs O(log) of what happened to it.
"""

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import islice
from math import inf
from operator import attrgetter, itemgetter
from typing import Any, TypeVar

from tca_tools.run.fates import standing, watches
from tca_tools.run.records import (
    OVER,
    Ahead,
    Claim,
    Failure,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Queueing,
    State,
    Suspension,
    Task,
)
from tca_tools.run.whole_run import Run
from tca_wire.constraints import Constraint
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.text.facts_in_words import called, kill_reason
from tca_wire.vocabulary import MessageClass, Role

_WAITS = 32
"""Waits of a handler that are looked at."""
_Span = TypeVar("_Span", Queueing, Handling, HandlerWait, Suspension)
_SINCE, _START, _GRANTED = itemgetter(0), attrgetter("start"), attrgetter("granted")


class TaskAt:
    """A task as it was; what never changes is read from its record."""

    __slots__ = ("_record", "_run", "_time")

    def __init__(self, run: Run, record: Task, time: float) -> None:
        self._run = run
        self._record = record
        self._time = time

    def __str__(self) -> str:
        return str(self._record)

    @property
    def id(self) -> TaskId:
        """Its number."""
        return TaskId(self._record.id)

    @property
    def name(self) -> str:
        """Its message's name."""
        return self._record.name

    @property
    def message_class(self) -> MessageClass:
        """Goal, command or a monitor."""
        return self._record.message_class

    @property
    def parent(self) -> TaskId:
        """The task that it is under."""
        return self._record.parent

    @property
    def sender(self) -> str:
        """The module that sent it."""
        return self._record.sender

    @property
    def role(self) -> Role:
        """Why central made it."""
        return self._record.role

    @property
    def state(self) -> State:
        """What it was doing."""
        return self._stage[1]

    @property
    def standing(self) -> str:
        """The same in words; of a failure whether the run had gone on after it by then, of a monitor whether it
        watched.
        """
        return standing(self._run, self._record, self.state, self._time)

    @property
    def since(self) -> float:
        """From when on it was in that state; of a queued one, in the queue that it was in then."""
        since, state = self._stage
        queueing = self.queueing if state is State.QUEUED else None
        return max(since, queueing.start) if queueing else since

    @property
    def _stage(self) -> tuple[float, State]:
        states = self._record.states
        return states[max(bisect_right(states, self._time, key=_SINCE) - 1, 0)]

    @property
    def failure(self) -> Failure:
        """The failure raised on it."""
        failure: Failure = self._record.was("failure", self._time)
        return failure

    @property
    def why_killed(self) -> str | None:
        """Why it was killed, and by whom; None if it was not."""
        why: str | None = self._record.was("killed", self._time)
        return None if why is None else kill_reason(why, self._record.was("killed_by", self._time))

    @property
    def body(self) -> bytes:
        """Its data."""
        body: bytes = self._record.was("body", self._time)
        return body

    @property
    def result(self) -> bytes:
        """What its handler returned."""
        result: bytes = self._record.was("result", self._time)
        return result

    @property
    def failure_data(self) -> bytes:
        """The data of the failure with which its handler ended last."""
        failure_data: bytes = self._record.was("failure_data", self._time)
        return failure_data

    @property
    def is_suspended(self) -> bool:
        """Whether it was suspended, by itself or with what it is under."""
        return self.suspension is not None

    @property
    def suspension(self) -> Suspension | None:
        """Its suspension that went on."""
        return _going_on(self._record.suspensions, self._time)

    @property
    def children(self) -> list[TaskId]:
        """The tasks right under it, oldest first."""
        return self._run.children_until(self._record.children, self._time)

    @property
    def caught_by(self) -> list[TaskId]:
        """The exception handlers that were called for its failures."""
        return self._run.children_until(self._record.caught_by, self._time)

    @property
    def called(self) -> float | None:
        """When the last of them was called."""
        last = next((self._run.tasks.get(one) for one in reversed(self.caught_by)), None)
        return None if last is None else last.received

    @property
    def reached(self) -> dict[Moment, float]:
        """When it reached which moments."""
        return {moment: time for moment, time in self._record.reached.items() if time <= self._time}

    @property
    def holds(self) -> list[Hold]:
        """The constraints on its moments."""
        return [hold for hold in self._record.holds if hold.added <= self._time]

    def is_over(self, hold: Hold) -> bool:
        """Whether the delay of one of them was over."""
        return hold.over is not None and hold.over <= self._time

    @property
    def constraints(self) -> list[Constraint]:
        """The same, as they were written."""
        return [hold.constraint for hold in self.holds]

    @property
    def queueing(self) -> Queueing | None:
        """Its wait in a queue."""
        return _going_on(self._record.queueings, self._time)

    @property
    def handling(self) -> Handling | None:
        """The run of its handler that went on."""
        return _going_on(self._record.handlings, self._time)

    @property
    def wait(self) -> HandlerWait | None:
        """What its handler waited for."""
        return self.waits[-1] if self.waits else None

    @property
    def waits(self) -> list[HandlerWait]:
        """The same; of an async handler that waits in several places, all that began lately."""
        run = self.handling
        return _waits(run.waits, self._time) if run else []

    @property
    def asking(self) -> list[Message]:
        """The queries of its handler that had not been answered, oldest first."""
        asked = self.handling.asked if self.handling else None
        return [one for one in asked or () if one.received <= self._time and not self._is_answered(one)]

    def _is_answered(self, query: Message) -> bool:
        is_given_up = bool(query.was("dropped", self._time) or query.was("failure", self._time))
        return is_given_up or (query.answered is not None and query.answered <= self._time)

    @property
    def watches(self) -> bool:
        """Whether it was a monitor that had begun to watch, and went on."""
        return watches(self._record, self.state, self._time)

    @property
    def _retried(self) -> float | None:
        return max((one.time for one in self._record.retries if one.time <= self._time), default=None)

    @property
    def is_retried(self) -> bool:
        """Whether it was to be handled again, and had not been."""
        retried = self._retried
        begun = max((run.start for run in self._record.handlings if run.start <= self._time), default=None)
        return retried is not None and begun is not None and begun < retried

    @property
    def ahead(self) -> list[Ahead]:
        """Its deadlines that were to come, and when it was to be killed."""
        known = self._run.ahead.get(self._record.id, ())
        return [one for one in known if one.set_at <= self._time] if self.state not in (*OVER, State.ENDING) else []


class RunAt:
    """A run as it was at a moment: ``tasks`` are those that had been sent."""

    def __init__(self, run: Run, moment: float = inf, time: float | None = None) -> None:
        self.run = run
        self.moment = min(moment, run.time)
        self.time = self.moment if time is None else time
        """What the clock of the entries showed."""
        self.tasks = _Tasks(run, self.moment)
        self.memo: dict[object, Any] = {}
        """What others have worked out of this moment, by whoever did: it never changes."""
        self._running: dict[tuple[str, str], list[Handling]] = {}
        self._holders: dict[tuple[str, str], Claim | None] = {}
        self._wanted: dict[tuple[str, str], list[Claim]] = {}

    @classmethod
    def by_clock(cls, run: Run, clock: float | None, now: float | None = None) -> "RunAt":
        """As it was when the clock of the entries showed so many seconds (None: at the end).

        Of a run that goes on, *now* is the present; else time ends with the last entry.
        """
        place = len(run.times) if clock is None else run.place(clock)
        end = run.time if now is None else max(now, run.time)
        return cls(run, run.times[place - 1] if place else -inf, end if clock is None else min(clock, end))

    @cached_property
    def top(self) -> list[TaskId]:
        """The tasks under the root."""
        return self.run.children_until(self.run.top, self.moment)

    def children(self, task: int) -> list[TaskId]:
        """The tasks right under *task*, oldest first."""
        return self.top if task == ROOT else self.tasks[task].children

    def has_reached(self, point: Point) -> bool:
        """Whether the point was past; what is unknown ended before the journal began."""
        task = self.run.tasks.get(point.task)
        return task is None or task.reached.get(point.moment, inf) <= self.moment

    def ran_on(self, task: TaskAt) -> list[Handling]:
        """The handlers of what is under a suspended task that still worked, though it was suspended."""
        still = task.suspension.still if task.suspension else []
        return [run for run in still if self._works(run) and self._is_under(run.message_id, task.id)]

    def _works(self, run: Handling) -> bool:
        if run.end is not None and run.end <= self.moment:
            return False
        wait = _going_on(run.waits, self.moment)
        return wait is None or wait.moment is None

    def _is_under(self, task: int, above: int) -> bool:
        while task > above:  # what is above has the smaller number
            task = self.run.tasks[task].parent
        return task == above

    def running(self, module: str, resource: str) -> list[Handling]:
        """The handlers that ran in a resource."""
        key = (module, resource)
        if key not in self._running:
            runs = self.run.runs.get(key, [])
            begun = bisect_right(runs, self.moment, key=_START)
            last = (*runs[begun - 1].beside, runs[begun - 1]) if begun else ()
            self._running[key] = [run for run in last if run.end is None or run.end > self.moment]
        return self._running[key]

    def inside(self, module: str, resource: str) -> list[Handling]:
        """The same of all copies of the module."""
        copies = [one for one in self.run.modules if called(one) == called(module)]
        return [run for one in copies for run in self.running(one, resource)]

    def queueing_of(self, message: Message) -> Queueing | None:
        """The wait of a message in a queue."""
        return _going_on(message.queueings, self.moment)

    def handling_of(self, message: Message) -> Handling | None:
        """The run of its handler."""
        return _going_on(message.handlings, self.moment)

    def copies_of(self, query: Message) -> tuple[list[Handling], list[Queueing]]:
        """Of a multi-query the runs of its handlers, and the waits of its copies in queues."""
        runs = [run for run in query.handlings if run.start <= self.moment and not _is_over(run, self.moment)]
        copies = self.run.copies.get(query.id, ())
        return runs, [one for one in copies if one.start <= self.moment and not _is_over(one, self.moment)]

    def waits_of(self, run: Handling) -> list[HandlerWait]:
        """What a handler waited for, like ``TaskAt.waits``."""
        return _waits(run.waits, self.moment)

    def waits_outside(self, module: str) -> list[HandlerWait]:
        """What a module waited for outside of handlers."""
        known = self.run.modules.get(module)
        return _waits(known.waits, self.moment) if known else []

    def wanted(self, module: str, resource: str) -> list[Claim]:
        """The locks and reservations that somebody waited for, oldest first, of all copies of a module."""
        key = (called(module), resource)
        if key not in self._wanted:
            claims = self.run.asked_for(module, resource)
            begun = islice(claims, bisect_right(claims, self.moment, key=_START))
            self._wanted[key] = [claim for claim in begun if not (self.is_granted(claim) or self._has_ended(claim))]
        return self._wanted[key]

    def is_granted(self, claim: Claim) -> bool:
        """Whether it is in force, or was."""
        return claim.granted is not None and claim.granted <= self.moment

    def _has_ended(self, claim: Claim) -> bool:
        return claim.end is not None and claim.end <= self.moment

    def capacity(self, module: str, resource: str) -> int:
        """How many messages a resource took at a time."""
        known = self.run.modules.get(module)
        sizes = known.sizes.get(resource, ()) if known else ()
        begun = bisect_right(sizes, self.moment, key=_SINCE)
        return sizes[begun - 1][1] if begun else 1

    def reached_at(self, point: Point) -> float | None:
        """When a point was reached, if that is known and it was."""
        task = self.run.tasks.get(point.task)
        time = None if task is None else task.reached.get(point.moment)
        return time if time is not None and time <= self.moment else None

    def held_by(self, module: str, resource: str) -> Claim | None:
        """The lock or reservation that was in force, in all copies of a module."""
        key = (called(module), resource)
        if key not in self._holders:
            grants = self.run.granted(module, resource)
            granted = bisect_right(grants, self.moment, key=_GRANTED)
            last = grants[granted - 1] if granted else None
            self._holders[key] = last if last and (last.end is None or last.end > self.moment) else None
        return self._holders[key]

    def describe(self, message_id: int) -> str:
        """A message's name with its id: ``take steps {7}``."""
        return self.run.describe(message_id)


class _Tasks(Mapping[int, TaskAt]):
    """The tasks that had been sent, oldest first."""

    def __init__(self, run: Run, moment: float) -> None:
        self._run = run
        self._moment = moment
        self._count = bisect_right(run.births, moment)
        self._seen: dict[int, TaskAt] = {}

    def __getitem__(self, task: int) -> TaskAt:
        if (seen := self._seen.get(task)) is not None:
            return seen
        record = self._run.tasks[task]
        if record.received > self._moment:
            raise KeyError(task)
        return self._seen.setdefault(task, TaskAt(self._run, record, self._moment))

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        return islice(self._run.tasks, self._count)


def _is_over(span: _Span, time: float) -> bool:
    return span.end is not None and span.end <= time


def _going_on(spans: list[_Span], time: float) -> _Span | None:
    """The last of them that had begun, if it had not ended."""
    begun = bisect_right(spans, time, key=_START)
    last = spans[begun - 1] if begun else None
    return last if last is not None and (last.end is None or last.end > time) else None


def _waits(waits: list[HandlerWait], time: float) -> list[HandlerWait]:
    begun = bisect_right(waits, time, key=_START)
    lately = waits[max(begun - _WAITS, 0) : begun]
    return [wait for wait in lately if wait.end is None or wait.end > time]
