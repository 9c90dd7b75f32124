"""A run as known at a moment, from records that go on after it. Pure, and nothing is folded again.

A moment is the time of an entry: each entry has its own. Looking at one task costs O(log) of what
happened to it.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, wraps
from itertools import islice
from math import inf
from operator import attrgetter, itemgetter
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from tca_tools.journal.coordinators import STANDINGS, agent_task, coordinator_of
from tca_tools.journal.fates import standing, watches
from tca_tools.journal.lives import Life, life_at
from tca_tools.journal.records import (
    OVER,
    Claim,
    EventAhead,
    Failure,
    HandlerWait,
    Handling,
    Hold,
    Message,
    Queueing,
    Suspension,
    Task,
    TaskState,
    going_on,
    lately,
)
from tca_tools.journal.whole_run import Run
from tca_wire.constraints import Constraint
from tca_wire.coordination import read_report
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.text.facts_in_words import called, kill_reason
from tca_wire.vocabulary import MessageClass, Role

_T = TypeVar("_T")
_P = ParamSpec("_P")
_SINCE, _START, _GRANTED = itemgetter(0), attrgetter("start"), attrgetter("granted")


class _Same(Generic[_T]):
    """A field of a task's record that never changes."""

    def __set_name__(self, _owner: type, name: str) -> None:
        self._name = name

    def __get__(self, task: "TaskAt", _owner: type) -> _T:
        found: _T = getattr(task.record, self._name)
        return found


class _Was(_Same[_T]):
    """A field of its record, as it was then."""

    def __get__(self, task: "TaskAt", _owner: type) -> _T:
        found: _T = task.record.was(self._name, task.moment)
        return found


class TaskAt:
    """A task as it was; its fields are those of ``Task``."""

    __slots__ = ("_run", "moment", "record")

    id = _Same[TaskId]()
    name = _Same[str]()
    message_class = _Same[MessageClass]()
    parent = _Same[TaskId]()
    sender = _Same[str]()
    role = _Same[Role]()
    failure = _Was[Failure]()
    body = _Was[bytes]()
    result = _Was[bytes]()
    failure_data = _Was[bytes]()

    def __init__(self, run: Run, record: Task, moment: float) -> None:
        self._run, self.record, self.moment = run, record, moment

    def __str__(self) -> str:
        return str(self.record)

    @property
    def state(self) -> TaskState:
        """Its state."""
        return self.record.state_at(self.moment)

    @property
    def life(self) -> Life:
        """How it stood for its clients and its server."""
        return life_at(self._run, self.record, self.moment)

    @property
    def standing(self) -> str:
        """Its state in words; of a failure whether the run had gone on after it, of a monitor
        whether it watched.
        """
        return standing(self._run, self.record, self.state, self.moment)

    @property
    def since(self) -> float:
        """From when on it was in that state; of a queued one, in the queue that it was in then."""
        since, state = self.record.stage(self.record.place_at(self.moment))
        queueing = self.queueing if state is TaskState.QUEUED else None
        return max(since, queueing.start) if queueing else since

    @property
    def why_killed(self) -> str | None:
        """Why it was killed, and by whom; None if it was not."""
        why: str | None = self.record.was("killed", self.moment)
        return None if why is None else kill_reason(why, self.record.was("killed_by", self.moment))

    @property
    def suspension(self) -> Suspension | None:
        """Its suspension that went on, of itself or with what it is under."""
        return going_on(self.record.suspensions, self.moment)

    @property
    def children(self) -> Sequence[TaskId]:
        """The tasks right under it, oldest first."""
        return self._run.children_until(self.record.children, self.moment)

    @property
    def caught_by(self) -> Sequence[TaskId]:
        """The exception handlers that were called for its failures."""
        return self._run.children_until(self.record.caught_by, self.moment)

    @property
    def reached(self) -> dict[Moment, float]:
        """When it reached which moments."""
        return {moment: time for moment, time in self.record.reached.items() if time <= self.moment}

    @property
    def preview(self) -> str:
        """Whether a coordinator sent it ahead of its state, and what became of that: ``ahead,
        kept``; else "".
        """
        sent = agent_task(self._run, self.record)
        return STANDINGS.get(sent.role(self.moment), "") if sent is not None else ""

    @property
    def machine_state(self) -> str:
        """Of a coordinator the state that its machine was in."""
        record = coordinator_of(self._run, self.record)
        report = read_report(self.life.progress) if record is not None else None
        return record.label(report.current) if record is not None and report is not None else ""

    @property
    def holds(self) -> list[Hold]:
        """The constraints on its moments."""
        return [hold for hold in self.record.holds if hold.added <= self.moment]

    @property
    def constraints(self) -> list[Constraint]:
        """The constraints on its moments, as they were written."""
        return [hold.constraint for hold in self.holds]

    @property
    def queueing(self) -> Queueing | None:
        """Its wait in a queue."""
        return going_on(self.record.queueings, self.moment)

    @property
    def handling(self) -> Handling | None:
        """The run of its handler that went on."""
        return going_on(self.record.handlings, self.moment)

    @property
    def waits(self) -> list[HandlerWait]:
        """The waits of its handler; of an async handler that waits in several places, all that
        began lately.
        """
        return lately(run.waits, self.moment) if (run := self.handling) else []

    @property
    def asking(self) -> list[Message]:
        """The queries of its handler that had not been answered, oldest first."""
        asked = self.handling.asked if self.handling else None
        return [
            one for one in asked or () if one.received <= self.moment and not self._is_answered(one)
        ]

    def _is_answered(self, query: Message) -> bool:
        is_given_up = bool(query.was("dropped", self.moment) or query.was("failure", self.moment))
        return is_given_up or (query.answered is not None and query.answered <= self.moment)

    @property
    def watches(self) -> bool:
        """Whether it was a monitor that had begun to watch, and went on."""
        return watches(self.record, self.state, self.moment)

    @property
    def is_retried(self) -> bool:
        """Whether it was to be handled again, and had not been."""
        return self.record.was_retried(self.moment)

    @property
    def ahead(self) -> list[EventAhead]:
        """Its deadlines that were to come, and when it was to be killed."""
        known = self._run.ahead.get(self.record.id, ())
        return [
            one
            for one in known
            if one.set_at <= self.moment and self.state not in (*OVER, TaskState.ENDING)
        ]


def remembered(
    look: Callable[Concatenate["RunAt", _P], _T],
) -> Callable[Concatenate["RunAt", _P], _T]:
    """Look once a moment: what was so then never changes."""

    @wraps(look)
    def found(at: "RunAt", /, *args: _P.args, **kwargs: _P.kwargs) -> _T:
        key = (look, *args)
        if key not in at.memo:
            at.memo[key] = look(at, *args, **kwargs)
        known: _T = at.memo[key]
        return known

    return found


class RunAt:
    """A run as it was at a moment: ``tasks`` are those that had been sent."""

    def __init__(self, run: Run, moment: float = inf, time: float | None = None) -> None:
        self.run = run
        self.moment = min(moment, run.time)
        self.time = self.moment if time is None else time
        """The time on the clock of the entries."""
        self.tasks = _Tasks(run, self.moment)
        self.memo: dict[object, Any] = {}
        """Results worked out for this moment: they never change."""

    @classmethod
    def by_clock(cls, run: Run, clock: float | None, now: float | None = None) -> "RunAt":
        """As it was when the clock of the entries showed so many seconds (None: at the end).

        Of a run that goes on, *now* is the present; else time ends with the last entry.
        """
        place = len(run.times) if clock is None else run.place(clock)
        end = run.time if now is None else max(now, run.time)
        return cls(
            run, run.times[place - 1] if place else -inf, end if clock is None else min(clock, end)
        )

    @cached_property
    def top(self) -> Sequence[TaskId]:
        """The tasks under the root."""
        return self.run.children_until(self.run.top, self.moment)

    def children(self, task: int) -> Sequence[TaskId]:
        """The tasks right under *task*, oldest first."""
        return self.top if task == ROOT else self.tasks[task].children

    def reached_at(self, point: Point) -> float | None:
        """When a point was reached, if that is known and it was."""
        task = self.run.tasks.get(point.task)
        time = inf if task is None else task.time_of(point.moment)
        return time if time <= self.moment else None

    def has_reached(self, point: Point) -> bool:
        """Whether the point was past; what is unknown ended before the journal began."""
        return point.task not in self.run.tasks or self.reached_at(point) is not None

    def ran_on(self, task: TaskAt) -> list[Handling]:
        """The handlers of what is under a suspended task that worked, though it was suspended."""
        still = task.suspension.still if task.suspension else []
        return [
            run for run in still if self._works(run) and self._is_under(run.message_id, task.id)
        ]

    def _works(self, run: Handling) -> bool:
        wait = going_on(run.waits, self.moment)
        return run.goes_on(self.moment) and (wait is None or wait.moment is None)

    def _is_under(self, task: int, above: int) -> bool:
        while task > above:  # what is above has the smaller number
            task = self.run.tasks[task].parent
        return task == above

    @remembered
    def running(self, module: str, resource: str) -> list[Handling]:
        """The handlers that ran in a resource."""
        runs = self.run.runs.get((module, resource), [])
        begun = bisect_right(runs, self.moment, key=_START)
        last = (*runs[begun - 1].beside, runs[begun - 1]) if begun else ()
        return [run for run in last if run.until > self.moment]

    def inside(self, module: str, resource: str) -> list[Handling]:
        """The handlers that ran in a resource, in all copies of the module."""
        copies = [one for one in self.run.modules if called(one) == called(module)]
        return [run for one in copies for run in self.running(one, resource)]

    def queueing_of(self, message: Message) -> Queueing | None:
        """The wait of a message in a queue."""
        return going_on(message.queueings, self.moment)

    def handling_of(self, message: Message) -> Handling | None:
        """The run of its handler."""
        return going_on(message.handlings, self.moment)

    def copies_of(self, query: Message) -> tuple[list[Handling], list[Queueing]]:
        """Of a multi-query the runs of its handlers, and the waits of its copies in queues."""
        copies = self.run.copies.get(query.id, ())
        return [run for run in query.handlings if run.goes_on(self.moment)], [
            one for one in copies if one.goes_on(self.moment)
        ]

    @remembered
    def wanted(self, module: str, resource: str) -> list[Claim]:
        """The locks and reservations that somebody waited for, oldest first, of all copies of a
        module.
        """
        claims = self.run.asked_for(module, resource)
        begun = islice(claims, bisect_right(claims, self.moment, key=_START))
        return [
            claim for claim in begun if claim.until > self.moment and not self.is_granted(claim)
        ]

    def is_granted(self, claim: Claim) -> bool:
        """Whether it is in force, or was."""
        return claim.granted is not None and claim.granted <= self.moment

    def capacity(self, module: str, resource: str) -> int:
        """How many messages a resource took at a time."""
        known = self.run.modules.get(module)
        sizes = known.sizes.get(resource, ()) if known else ()
        begun = bisect_right(sizes, self.moment, key=_SINCE)
        return sizes[begun - 1][1] if begun else 1

    @remembered
    def held_by(self, module: str, resource: str) -> Claim | None:
        """The lock or reservation that was in force, in all copies of a module."""
        grants = self.run.granted(module, resource)
        granted = bisect_right(grants, self.moment, key=_GRANTED)
        last = grants[granted - 1] if granted else None
        return last if last and last.until > self.moment else None

    def describe(self, message_id: int) -> str:
        """A message's name with its id: ``take steps {7}``."""
        return self.run.describe(message_id)


class _Tasks(Mapping[int, TaskAt]):
    """The tasks that had been sent, oldest first."""

    def __init__(self, run: Run, moment: float) -> None:
        self._run = run
        self._moment = moment
        self._count = bisect_right(run.births, moment)

    def __getitem__(self, task: int) -> TaskAt:
        record = self._run.tasks[task]
        if record.received > self._moment:
            raise KeyError(task)
        return TaskAt(self._run, record, self._moment)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[int]:
        return islice(self._run.tasks, self._count)
