"""A run as known at an instant, read from the records of the whole run. Pure.

An instant is the time of an entry; entries have unique times. A ``Moment`` is the start or end of
an interval of a task. Reading one task is O(log n) in the number of its changes.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, wraps
from itertools import islice
from math import inf
from operator import attrgetter, itemgetter
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from tca_tools.journal.coordinators import STANDINGS, sent_by_coordinator, tasks_of_coordinator
from tca_tools.journal.failure import Failure
from tca_tools.journal.fates import is_watching, standing
from tca_tools.journal.lives import Life, life_at
from tca_tools.journal.records import (
    OVER,
    Claim,
    HandlerWait,
    Handling,
    Hold,
    Message,
    PlannedEvent,
    Queueing,
    Suspension,
    Task,
    TaskState,
)
from tca_tools.journal.sequences import active_at, newest_active
from tca_tools.journal.whole_run import Run
from tca_wire.constraints import Constraint
from tca_wire.coordination import read_report
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.text.facts_in_words import called, kill_reason
from tca_wire.vocabulary import MessageClass, Role

_T = TypeVar("_T")
_P = ParamSpec("_P")
_SINCE, _START, _GRANTED = itemgetter(0), attrgetter("start"), attrgetter("granted")


class _Constant(Generic[_T]):
    """A field of a ``TaskAt`` whose value in the record never changes."""

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    def __get__(self, task: "TaskAt", _owner: type) -> _T:
        found: _T = getattr(task.record, self._name)
        return found


class _AtInstant(_Constant[_T]):
    """A field of a ``TaskAt`` with the value that it had in the record at the instant."""

    def __get__(self, task: "TaskAt", _owner: type) -> _T:
        found: _T = task.record.value_at(self._name, task.instant)
        return found


class TaskAt:
    """A task as known at an instant; its fields are those of ``Task``."""

    __slots__ = ("_run", "instant", "record")

    id = _Constant[TaskId]()
    name = _Constant[str]()
    message_class = _Constant[MessageClass]()
    parent = _Constant[TaskId]()
    sender = _Constant[str]()
    role = _Constant[Role]()
    failure = _AtInstant[Failure]()
    body = _AtInstant[bytes]()
    result = _AtInstant[bytes]()
    failure_data = _AtInstant[bytes]()

    def __init__(self, run: Run, record: Task, instant: float) -> None:
        self._run, self.record, self.instant = run, record, instant

    def __str__(self) -> str:
        return str(self.record)

    @property
    def state(self) -> TaskState:
        """Its state."""
        return self.record.state_at(self.instant)

    @property
    def life(self) -> Life:
        """Its place in its life cycle."""
        return life_at(self._run, self.record, self.instant)

    @property
    def standing(self) -> str:
        """Its state in words, including whether a failure was handled or a monitor was watching."""
        return standing(self._run, self.record, self.state, self.instant)

    @property
    def since(self) -> float:
        """The start of its state; for a queued task, when it entered its current queue."""
        since, state = self.record.stage(self.record.place_at(self.instant))
        queueing = self.queueing if state is TaskState.QUEUED else None
        return max(since, queueing.start) if queueing else since

    @property
    def why_killed(self) -> str | None:
        """Why and by which module it was killed; None if it was not."""
        why: str | None = self.record.value_at("killed", self.instant)
        return (
            None
            if why is None
            else kill_reason(why, self.record.value_at("killed_by", self.instant))
        )

    @property
    def suspension(self) -> Suspension | None:
        """Its active suspension, of itself or of an ancestor."""
        return active_at(self.record.suspensions, self.instant)

    @property
    def attempt(self) -> int:
        """The number of its newest attempt: 1, and one more for each retry but a fallback's."""
        retries = self.record.retries
        until = bisect_right(retries, self.instant, key=attrgetter("time")) if retries else 0
        return 1 + sum(not one.fallback for one in retries[:until])

    @property
    def children(self) -> Sequence[TaskId]:
        """The tasks right under it, oldest first."""
        return self._run.children_until(self.record.children, self.instant)

    @property
    def caught_by(self) -> Sequence[TaskId]:
        """The exception handlers that were called for its failures."""
        return self._run.children_until(self.record.caught_by, self.instant)

    @property
    def reached(self) -> dict[Moment, float]:
        """The moments it had reached, with their times."""
        known = self.record.reached.items()
        return {reached: time for reached, time in known if time <= self.instant}

    @property
    def preview(self) -> str:
        """The words for a coordinator's early work, such as ``ahead, kept``; "" for other tasks."""
        sent = sent_by_coordinator(self._run, self.record)
        return STANDINGS.get(sent.role(self.instant), "") if sent is not None else ""

    @property
    def machine_state(self) -> str:
        """The current state of a coordinator's machine; "" for other tasks."""
        sent = tasks_of_coordinator(self._run, self.record)
        report = read_report(self.life.progress) if sent is not None else None
        return sent.label(report.current) if sent is not None and report is not None else ""

    @property
    def holds(self) -> list[Hold]:
        """The constraints on its moments."""
        return [hold for hold in self.record.holds if hold.added <= self.instant]

    @property
    def constraints(self) -> list[Constraint]:
        """The constraints on its moments, as they were declared."""
        return [hold.constraint for hold in self.holds]

    @property
    def queueing(self) -> Queueing | None:
        """Its wait in a queue."""
        return active_at(self.record.queueings, self.instant)

    @property
    def handling(self) -> Handling | None:
        """The active run of its handler."""
        return active_at(self.record.handlings, self.instant)

    @property
    def waits(self) -> list[HandlerWait]:
        """The waits of its handler; of many waits of an async handler, the newest."""
        return newest_active(self.handling.waits, self.instant) if self.handling else []

    @property
    def unanswered(self) -> list[Message]:
        """The unanswered queries of its handler, oldest first."""
        asked = (self.handling.asked if self.handling else None) or ()
        return [one for one in asked if one.received <= self.instant and not self._is_over(one)]

    def _is_over(self, query: Message) -> bool:
        """Whether a query was answered or dropped, or had failed."""
        is_answered = query.answered is not None and query.answered <= self.instant
        return is_answered or any(
            query.value_at(one, self.instant) for one in ("dropped", "failure")
        )

    @property
    def is_watching(self) -> bool:
        """Whether it was a monitor that was watching."""
        return is_watching(self.record, self.state, self.instant)

    @property
    def is_retry_due(self) -> bool:
        """Whether a retry was due that had not started."""
        return self.record.was_retry_due(self.instant)

    @property
    def plans(self) -> list[PlannedEvent]:
        """Its pending deadlines and planned kills."""
        if self.state in (*OVER, TaskState.ENDING):
            return []
        known = self._run.plans.get(self.record.id, ())
        return [one for one in known if one.set_at <= self.instant]


def remembered(
    compute: Callable[Concatenate["RunAt", _P], _T],
) -> Callable[Concatenate["RunAt", _P], _T]:
    """Cache a function's results in ``RunAt.memo``: the state at an instant never changes."""

    @wraps(compute)
    def cached(at: "RunAt", /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        key = (compute, *args)
        if key not in at.memo:
            at.memo[key] = compute(at, *args, **kwargs)
        result: _T = at.memo[key]
        return result

    return cached


class RunAt:
    """A run as known at an instant: ``tasks`` are those sent by then."""

    def __init__(self, run: Run, instant: float = inf, time: float | None = None) -> None:
        self.run = run
        self.instant = min(instant, run.time)
        self.time = self.instant if time is None else time
        """The time on the clock of the entries."""
        self.tasks = _Tasks(run, self.instant)
        self.memo: dict[object, Any] = {}
        """The cached results of ``remembered`` functions."""

    @classmethod
    def by_clock(cls, run: Run, clock: float | None, now: float | None = None) -> "RunAt":
        """Return the run as known at a time on the entries' clock.

        Args:
            run: The run.
            clock: The time in seconds; None for the end.
            now: The present, if the run is live; else the run ends with its last entry.
        """
        place = len(run.times) if clock is None else run.entries_until(clock)
        end = run.time if now is None else max(now, run.time)
        instant = run.times[place - 1] if place else -inf
        return cls(run, instant, end if clock is None else min(clock, end))

    @cached_property
    def top(self) -> Sequence[TaskId]:
        """The tasks under the root."""
        return self.run.children_until(self.run.top, self.instant)

    def children(self, task: int) -> Sequence[TaskId]:
        """Return the children of *task*, oldest first."""
        return self.top if task == ROOT else self.tasks[task].children

    def reached_at(self, point: Point) -> float | None:
        """Return when a point was reached; None if it was not, or if its task is unknown."""
        task = self.run.tasks.get(point.task)
        time = inf if task is None else task.time_of(point.moment)
        return time if time <= self.instant else None

    def has_reached(self, point: Point) -> bool:
        """Whether a point had been reached; an unknown task had ended before the journal began."""
        return point.task not in self.run.tasks or self.reached_at(point) is not None

    def working_under(self, task: TaskAt) -> list[Handling]:
        """Return the handlings of a suspended task and its descendants that were still working."""
        known = task.suspension.handlings if task.suspension else []
        return [
            one
            for one in known
            if self._is_working(one) and self._is_under(one.message_id, task.id)
        ]

    def _is_working(self, handling: Handling) -> bool:
        """Whether a handler runs, and does not wait for a task."""
        wait = active_at(handling.waits, self.instant)
        return handling.is_active(self.instant) and (wait is None or wait.moment is None)

    def _is_under(self, task: int, ancestor: int) -> bool:
        while task > ancestor:  # ancestors have smaller ids
            task = self.run.tasks[task].parent
        return task == ancestor

    @remembered
    def running(self, module: str, resource: str) -> list[Handling]:
        """Return the active runs of handlers in a resource."""
        handlings = self.run.by_resource.get((module, resource), [])
        begun = bisect_right(handlings, self.instant, key=_START)
        # The handling that started last lists the others that were active at its start
        last = (*handlings[begun - 1].concurrent, handlings[begun - 1]) if begun else ()
        return [one for one in last if one.until > self.instant]

    def running_in_copies(self, module: str, resource: str) -> list[Handling]:
        """Return the active runs of handlers in a resource, in all copies of the module."""
        copies = [one for one in self.run.modules if called(one) == called(module)]
        return [handling for one in copies for handling in self.running(one, resource)]

    def queueing_of(self, message: Message) -> Queueing | None:
        """Return a message's wait in a queue."""
        return active_at(message.queueings, self.instant)

    def handling_of(self, message: Message) -> Handling | None:
        """Return the active run of a message's handler."""
        return active_at(message.handlings, self.instant)

    def copies_of(self, query: Message) -> tuple[list[Handling], list[Queueing]]:
        """Return the active runs of a multi-query's handlers, and its copies' waits in queues."""
        queueings = self.run.copies.get(query.id, ())
        return (
            [one for one in query.handlings if one.is_active(self.instant)],
            [one for one in queueings if one.is_active(self.instant)],
        )

    @remembered
    def pending_claims(self, module: str, resource: str) -> list[Claim]:
        """Return the pending locks and reservations of all copies of a module, oldest first."""
        claims = self.run.requested_claims(module, resource)
        begun = islice(claims, bisect_right(claims, self.instant, key=_START))
        return [
            claim for claim in begun if claim.until > self.instant and not self.is_granted(claim)
        ]

    def is_granted(self, claim: Claim) -> bool:
        """Whether a claim had been granted."""
        return claim.granted is not None and claim.granted <= self.instant

    def capacity(self, module: str, resource: str) -> int:
        """Return the capacity of a resource."""
        known = self.run.modules.get(module)
        sizes = known.sizes.get(resource, ()) if known else ()
        begun = bisect_right(sizes, self.instant, key=_SINCE)
        return sizes[begun - 1][1] if begun else 1

    @remembered
    def claim_in_force(self, module: str, resource: str) -> Claim | None:
        """Return the lock or reservation in force, in all copies of a module."""
        grants = self.run.granted(module, resource)
        granted = bisect_right(grants, self.instant, key=_GRANTED)
        last = grants[granted - 1] if granted else None
        return last if last and last.until > self.instant else None

    def describe(self, message_id: int) -> str:
        """Return a message's name with its id: ``take steps {7}``."""
        return self.run.describe(message_id)


class _Tasks(Mapping[int, TaskAt]):
    """The tasks that had been sent, oldest first."""

    def __init__(self, run: Run, instant: float) -> None:
        self._run = run
        self._instant = instant
        self._count = bisect_right(run.births, instant)

    def __getitem__(self, task: int) -> TaskAt:
        record = self._run.tasks[task]
        if record.received > self._instant:
            raise KeyError(task)
        return TaskAt(self._run, record, self._instant)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        return islice(self._run.tasks, self._count)
