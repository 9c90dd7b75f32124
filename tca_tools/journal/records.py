"""The records of a run: messages, tasks, and the runs of handlers. Plain data, filled by the fold.

Many records are spans: they have a start, and an end once they are over. The spans of one thing
are listed oldest first. All empty lists are the one object ``NONE``, because a run may have
millions. ``appended`` returns a new sequence for the first element.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf
from operator import attrgetter
from typing import NamedTuple

from tca_tools.journal.failure import NO_FAILURE, Failure
from tca_tools.journal.overwriting import Changes, Overwritten
from tca_tools.journal.sequences import NONE, SHORT, Span, appended
from tca_wire.constraints import Constraint
from tca_wire.journal.facts import TapAdded
from tca_wire.life_cycles import Effect
from tca_wire.points import ALL_MOMENTS, MOMENTS, ROOT, Moment, Point, TaskId
from tca_wire.text.facts_in_words import kill_reason, place, state_change
from tca_wire.text.measures import duration
from tca_wire.vocabulary import Dropping, MessageClass, Outcome, Party, Role, Scope
from tca_wire.waits import WaitKind


class TaskState(StrEnum):
    """The state of a task at the time folded so far."""

    HELD = "held"  # not started: its constraints or its parent do not allow it yet
    QUEUED = "queued"  # waits for a resource or for a handler
    PLANNING = "planning"  # is being expanded before it may be achieved
    PLANNED = "planned"  # expanded, but may not be achieved yet
    HANDLING = "handling"  # its handler runs and it is being achieved
    ACHIEVING = "achieving"  # its handler has returned; its subtasks are being achieved
    ACHIEVED = "achieved"
    RESOLVED = str(Outcome.RESOLVED)  # it failed, and an exception handler resolved the failure
    RECOVERING = "recovering"  # it failed, and an exception handler decides what to do
    SUSPENDED = "suspended"  # no part of it may start and no handler has it; subtasks may run
    ENDING = "ending"  # killed, but its handler still runs or a subtask has not ended
    FAILED = "failed"
    KILLED = "killed"


DONE = (TaskState.ACHIEVED, TaskState.RESOLVED)
"""States of an ended task whose successors continue as planned."""
OVER = (*DONE, TaskState.FAILED, TaskState.KILLED)
"""States of an ended task."""


_STATES = tuple(TaskState)
_SHARED: dict[bytes, bytes] = {}
"""One shared object for each short sequence of states: most tasks pass the same states."""
_AS_BYTE = {state: bytes([number]) for number, state in enumerate(_STATES)}
PLACES = {int(moment): place for place, moment in enumerate(MOMENTS, 1)}
"""The index of each moment in ``Task.times``."""
PLACES_OF = [
    tuple(PLACES[moment] for moment in MOMENTS if moments & moment)
    for moments in range(ALL_MOMENTS + 1)
]
"""The indexes for each set of moments."""
_START_HANDLING, _START_ACHIEVING = PLACES[Moment.START_HANDLING], PLACES[Moment.START_ACHIEVING]
_END_PLANNING, _END_ACHIEVING = PLACES[Moment.END_PLANNING], PLACES[Moment.END_ACHIEVING]
_START, _TIME = attrgetter("start"), attrgetter("time")


def first_moment(moments: int) -> Moment | None:
    """Return the first moment of a set; None if the set is empty."""
    return next((MOMENTS[place - 1] for place in PLACES_OF[moments & ALL_MOMENTS]), None)


@dataclass(slots=True)
class HandlerWait(Span):
    """A handler, or a module's thread, blocks until something happens.

    *awaited* is the number of a query (for its reply), of a claim (for its grant), or of a task
    (for a moment or a change of it). If it is 0, *name* names the awaited thing.
    """

    awaited: int
    start: float
    moment: Moment | None = None
    end: float | None = None
    by: "Handling | str" = field(default="", repr=False, compare=False)
    """The run of a handler that waits; the module's name for a wait outside of handlers."""
    kind: WaitKind = WaitKind.TASK
    """CHANGE, PRESENCE or TASK; TASK also for a reply or a claim."""
    name: str = ""


@dataclass(slots=True)
class Queueing(Span):
    """A delivery waits for a resource, or for a handler if its module is ""."""

    message_id: int
    module: str
    resource: str
    start: float
    end: float | None = None
    priority: int = 0


class Drop(NamedTuple):
    """A dropped message, or a copy of it for one receiver."""

    time: float
    name: str
    """The message's name."""
    why: str
    message_id: int
    """The message, or the original of the copy."""
    is_copy: bool
    """Whether it was the copy for one receiver."""
    dropping: Dropping

    @property
    def is_loss(self) -> bool:
        """Whether a handler should have received it."""
        return self.is_copy or self.dropping in (Dropping.OVERLOAD, Dropping.DISPLACED)


@dataclass(slots=True)
class Handling(Span):
    """One run of a handler."""

    message_id: int
    name: str
    module: str
    resource: str
    start: float
    end: float | None = None
    outcome: Outcome | None = None
    """KILLED if it returned after its task was killed; None while it runs, or if it was cut off."""
    waits: Sequence[HandlerWait] = NONE
    delivery: int = 0
    """The number of the delivery, new for each retry. Messages of the handler have it as origin."""
    asked: "list[Message] | None" = field(default=None, repr=False, compare=False)
    """The queries that its handler sent."""
    is_lost: bool = False
    """Whether it failed because its module was lost: no handler returned."""
    concurrent: "tuple[Handling, ...]" = field(default=(), repr=False, compare=False)
    """The runs that were active in the same resource when it started."""
    slot: int = 0
    """The connection of the module's slot that ran it."""
    is_nested: bool = False
    """Whether it ran in a slot while another handler there waited."""
    priority: int = 0
    transition: str = ""
    """The transition with which it ended the task ("": the usual one)."""


@dataclass(slots=True)
class Claim(Span):
    """A lock or reservation of a module's resource: requested, then granted, then over."""

    id: int
    module: str
    resource: str
    is_reserved: bool
    sender: str
    origin: int
    """The delivery whose handler requested it (0: none)."""
    start: float
    granted: float | None = None
    end: float | None = None
    ended: str = ""
    """Why it ended."""
    by: "Handling | None" = field(default=None, repr=False, compare=False)
    """The run of a handler that requested it."""

    @property
    def name(self) -> str:
        """The kind of claim, and its resource."""
        kind = "reservation" if self.is_reserved else "lock"
        return f"{kind} of {place(self.module, self.resource)}"

    def __str__(self) -> str:
        return f"{self.name} {{{self.id}}}"


@dataclass(slots=True)
class Offer(Span):
    """A module handles a message, in one of its resources."""

    module: str
    resource: str
    start: float
    end: float | None = None
    """When it withdrew the handler, or left."""
    accepts: bool = False
    """Whether its handler accepts tasks explicitly, rather than by being called."""


class Raised(NamedTuple):
    """A failure was raised on a task while its handler kept running."""

    time: float
    failure: Failure
    by: str
    """The module that raised it, or "central"."""
    asker: Handling | None = None
    """The run of a handler that raised it."""


@dataclass(slots=True)
class Retry:
    """A request that a task be handled again."""

    time: float
    by: str
    has_other_data: bool
    """Whether the retry has other data."""
    handlings: int
    """The number of handlings started before."""
    children: int
    """The number of subtasks sent before."""
    asker: Handling | None = None
    """The run of a handler that requested it."""
    failed: TaskId = ROOT
    """The task whose failure a retry policy deals with (0: no policy wanted it)."""
    fallback: str = ""
    """The message that replaces the task, if the policy wants that."""
    replaced: float = inf
    """When the fallback was called in place of the next handling."""


class Restart(NamedTuple):
    """A restart of central, which continued the run."""

    time: float
    away: float
    """The seconds without central; 0: unknown."""
    is_planned: bool
    """Whether a module had asked central to end and to keep the run."""

    def __str__(self) -> str:
        how = ", as asked" if self.is_planned else ""
        return f"central was restarted{how}" + (f", after {duration(self.away)}" * (self.away > 0))


class LifeChange(NamedTuple):
    """A transition of a task's life cycle."""

    time: float
    transition: str
    state: str
    """The state after it."""
    serial: int
    by: Party
    module: str = ""
    """The module that is the client or server."""
    text: str = ""
    """The reason, as text for the user."""
    body: bytes = b""
    """The goal that a client requests, or an intermediate result."""
    effect: Effect = Effect.NONE

    def __str__(self) -> str:
        """Return ``update by planner, now update requested``; no state if that is unchanged."""
        stays = self.effect in (Effect.RESULT, Effect.STOP)
        return state_change(self.transition, "" if stays else self.state, self.module, self.text)


@dataclass(slots=True)
class Hold:
    """A constraint on a moment of a task."""

    constraint: Constraint
    added: float
    over: float = inf
    """When its delay was over, if it has one."""
    tap: TapAdded | None = None
    """The wiretap that it comes from, if the task waits for a listener."""


class PlannedEvent(NamedTuple):
    """A planned kill of a task, or a deadline by which it must have reached a moment."""

    set_at: float
    seconds: float
    """The delay after *set_at*, or after point *after* is reached."""
    moment: Moment | None
    """The moment of a deadline; None for a kill."""
    after: Point | None = None
    scope: Scope = Scope.TASK
    by: str = ""
    """The module that planned the kill."""


class Exhausted(NamedTuple):
    """An exception handler that had reached its maximum of calls when a failure occurred."""

    time: float
    handler: str
    calls: int


@dataclass(slots=True)
class Suspension(Span):
    """The time from when a task was suspended until it was resumed or ended."""

    task: TaskId
    cause: TaskId
    """The suspended task: this one or an ancestor."""
    start: float
    handlings: list[Handling] = field(default_factory=list, repr=False)
    """The handlers of *cause* and its descendants that ran at the start, or that started later.
    Those that started later are of tasks that were resumed alone, or sent on termination.
    """
    end: float | None = None
    is_resumed: bool = False
    """Whether the task was resumed; else the task ended."""
    by: str = ""
    """The module that suspended *cause*, or "central"."""
    resumed_by: str = ""
    since_birth: bool = False
    """Whether *cause* was created suspended."""

    @property
    def standstill(self) -> float | None:
        """When the last of ``handlings`` stopped working; None if one still works."""
        started = (one for one in self.handlings if one.start < self.until)
        since = max([self.start, *map(self._work_end, started)])
        return since if since < inf else None

    def _work_end(self, handling: Handling) -> float:
        """Return when a handler returned, or started a wait that outlasted the suspension."""
        blocked = (
            wait.start for wait in handling.waits if wait.moment and wait.until >= self.until
        )
        return next(blocked, handling.until)


@dataclass(slots=True)
class Message(Overwritten):
    """A message that central accepted."""

    id: int
    name: str
    message_class: MessageClass
    sender: str
    origin: int
    """The delivery whose handler sent it (0: none)."""
    received: float
    """When central accepted it."""
    body: bytes = b""
    queueings: Sequence[Queueing] = NONE
    handlings: Sequence[Handling] = NONE
    changes: Changes = NONE
    """The overwritten values of ``body`` and the fields below; see ``Overwritten``."""
    failure: Failure = NO_FAILURE
    """The failure raised on it; cleared when it is handled again."""
    dropped: str = ""
    dropping: Dropping = Dropping.OTHER
    result: bytes = b""
    failure_data: bytes = b""
    role: Role = Role.NONE
    """Why central made it; NONE if a module sent it."""
    about: int = 0
    """The failing, tapped, killed or monitoring message that it was made for."""
    answered: float | None = None
    """When the sender of a query received the last answer."""
    by: Handling | None = field(default=None, repr=False, compare=False)
    """The run of a handler that sent it; None if that had ended."""

    def __str__(self) -> str:
        return f"{self.name} {{{self.id}}}"

    @property
    def was_given_up(self) -> bool:
        """Whether its sender stopped waiting for the answer."""
        return self.dropping is Dropping.GIVEN_UP

    @property
    def failures(self) -> list[tuple[float, Failure]]:
        """The failures that were raised on it, with their times, oldest first."""
        values = self.new_values("failure") if self.changes else []
        return [(time, failure) for time, failure in values if failure]

    @property
    def is_queued(self) -> bool:
        """Whether it waits for a resource or a handler now."""
        return bool(self.queueings) and self.queueings[-1].end is None

    @property
    def handling(self) -> Handling | None:
        """The current run of its handler."""
        return self.handlings[-1] if self.handlings and self.handlings[-1].end is None else None


@dataclass(slots=True)
class Task(Message):
    """A message that is a node of the task tree."""

    parent: TaskId = ROOT
    top: TaskId = ROOT
    """The top-level task above it, or itself."""
    children: Sequence[TaskId] = NONE
    holds: Sequence[Hold] = NONE
    """The constraints on moments of this task."""
    times: list[float] = field(default_factory=lambda: [inf] * (1 + len(MOMENTS)))
    """When it reached each moment (inf: not yet), at the index in ``PLACES``."""
    killed: str | None = None
    """Why it was killed, in central's words."""
    killed_by: str = ""
    """The module that requested the kill, or "central"."""
    killer: Handling | None = field(default=None, repr=False, compare=False)
    """The run of a handler that requested the kill; it may have ended long before."""
    killed_for: TaskId = ROOT
    """The task whose unhandled failure was the reason for the kill."""
    is_waited_for: bool = False
    """Whether the parent waits for this monitor's end; else the monitor ends with its siblings."""
    outlives_retry: bool = False
    """Whether a retry of the parent leaves this monitor alive."""
    watched: str = ""
    """Why this monitor stopped watching."""
    caught_by: Sequence[TaskId] = NONE
    """The tasks of the exception handlers that were called for its failures."""
    deciders: Sequence[TaskId] = NONE
    """The exception handlers called for failures of its handler, not for failures raised beside."""
    is_recovering: bool = False
    """Whether an exception handler is deciding what to do about its failure."""
    is_dealt_with: bool = False
    """Whether its failure was dealt with."""
    is_unhandled: bool = False
    """Whether its failure was not handled. It continues if it is not killed: a retry may be due, or
    it may survive its ancestor's kill.
    """
    fails_by_subtask: bool = False
    """Whether it is a top-level task that fails, because a failure below it was not handled."""
    suspensions: Sequence[Suspension] = NONE
    retries: Sequence[Retry] = NONE
    life: Sequence[LifeChange] = NONE
    """Life cycle transitions with facts of their own; lives.py adds those implied by other facts.
    """
    since: Sequence[float] = NONE
    """The start of each of its states."""
    stages: bytes | bytearray = b""
    """Its states, one byte each, parallel to ``since``."""

    @property
    def why_killed(self) -> str | None:
        """Why and by which module it was killed; None if it was not."""
        return None if self.killed is None else kill_reason(self.killed, self.killed_by)

    def time_of(self, moment: int) -> float:
        """Return when it reached a moment; inf if it has not."""
        return self.times[PLACES.get(moment, 0)]

    @property
    def reached(self) -> dict[Moment, float]:
        """The moments it has reached, with their times."""
        times = zip(MOMENTS, self.times[1:], strict=True)
        return {moment: time for moment, time in times if time < inf}

    @property
    def has_ended(self) -> bool:
        """Whether it has ended, with any outcome."""
        return self.times[_END_ACHIEVING] < inf

    def enter(self, state: TaskState, time: float) -> bool:
        """Record its state from a time on. Returns whether the state is a new one."""
        if self.stages.endswith(stage := _AS_BYTE[state]):
            return False
        self.since = appended(self.since, time)
        if isinstance(self.stages, bytearray):
            self.stages += stage
        elif len(self.stages) < SHORT:
            self.stages = _SHARED.setdefault(stages := self.stages + stage, stages)
        else:
            self.stages = bytearray(self.stages + stage)
        return True

    @property
    def states(self) -> list[tuple[float, TaskState]]:
        """Its states, each with its start."""
        starts = zip(self.since, self.stages, strict=True)
        return [(since, _STATES[stage]) for since, stage in starts]

    def stage(self, place: int) -> tuple[float, TaskState]:
        """Return one of ``states`` without making the list."""
        return self.since[place], _STATES[self.stages[place]]

    def place_at(self, time: float) -> int:
        """Return the index in ``states`` at a time."""
        return max(bisect_right(self.since, time) - 1, 0)

    def state_at(self, time: float) -> TaskState:
        """Return its state at a time."""
        return _STATES[self.stages[-1 if self.since[-1] <= time else self.place_at(time)]]

    def spans(self) -> Iterator[tuple[float, float, TaskState]]:
        """Yield its states, each with its start and end."""
        states = map(_STATES.__getitem__, self.stages)
        return zip(self.since, [*self.since[1:], inf], states, strict=True)

    @property
    def suspension(self) -> Suspension | None:
        """The current suspension, of itself or of an ancestor."""
        last = self.suspensions[-1] if self.suspensions else None
        return last if last is not None and last.end is None else None

    @property
    def is_retry_due(self) -> bool:
        """Whether a retry is due that has not started."""
        return self.was_retry_due(inf)

    def was_retry_due(self, time: float) -> bool:
        """Whether a retry was due at a time and had not started."""
        begun = bisect_right(self.handlings, time, key=_START)
        # A retry requested before the first handling has no effect of its own
        known = bisect_right(self.retries, time, key=_TIME) if begun else 0
        last = self.retries[known - 1] if known else None
        if last is None or last.handlings != begun:
            return False
        return last.replaced == inf or time < last.replaced

    @property
    def state(self) -> TaskState:
        """Its current state."""
        # Most tasks neither fail nor are killed: a short cut
        if self.killed is None and not self.failure and not self.is_recovering:
            return TaskState.ACHIEVED if self.times[_END_ACHIEVING] < inf else self._running_state()
        return self._final_state() or self._running_state()

    def _final_state(self) -> TaskState | None:
        has_ended = self.times[_END_ACHIEVING] < inf
        if not has_ended and self.killed is not None:
            return TaskState.ENDING
        if self.is_recovering and not has_ended:
            return TaskState.RECOVERING
        if (
            self.failure
            and not self.is_dealt_with
            and (has_ended or not (self.is_unhandled or self.is_retry_due))
        ):
            return TaskState.FAILED
        if self.killed is not None:
            return TaskState.FAILED if self.fails_by_subtask else TaskState.KILLED
        if not has_ended:
            return None
        return TaskState.RESOLVED if self.failure else TaskState.ACHIEVED

    def _running_state(self) -> TaskState:
        times = self.times
        is_handled = self.handlings and self.handlings[-1].end is None
        if self.suspensions and self.suspension and not is_handled:
            return TaskState.SUSPENDED
        if self.queueings and self.queueings[-1].end is None:
            return TaskState.QUEUED
        if times[_START_HANDLING] == inf:
            return TaskState.HELD
        is_achieving = times[_START_ACHIEVING] < inf
        if is_handled:
            return TaskState.HANDLING if is_achieving else TaskState.PLANNING
        if is_achieving:
            return TaskState.ACHIEVING
        return TaskState.PLANNED if times[_END_PLANNING] < inf else TaskState.PLANNING


@dataclass(slots=True)
class ModuleRecord:
    """A module, over the whole journal."""

    name: str
    joined: list[tuple[float, float | None]] = field(default_factory=list)
    """Start and end of each of its connections."""
    left: str = ""
    """Why it left the last time."""
    resources: dict[str, int] = field(default_factory=dict)
    """The current capacity of each of its resources; 0 if the module has left."""
    capacities: dict[str, int] = field(default_factory=dict)
    """The largest capacity that each resource had."""
    sizes: dict[str, list[tuple[float, int]]] = field(default_factory=dict)
    """The capacities of each resource, each with its start."""
    waits: Sequence[HandlerWait] = NONE
    """Its waits outside of any handler."""
