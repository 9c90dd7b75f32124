"""The records of a run: messages, tasks, and the work of each handler. Plain data; the fold fills
them.

Many are spans: they start, and end unless they go on. Those of one thing lie in lists, oldest
first. A run may have millions of records, and most have none of most things: these share ``NONE``,
and ``added`` makes the first list.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import inf
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple, Self, TypeVar

from tca_tools.journal.overwriting import Changes, Overwritten
from tca_wire.constraints import Constraint
from tca_wire.journal.facts import TapAdded
from tca_wire.life_cycles import Effect
from tca_wire.points import ALL_MOMENTS, MOMENTS, ROOT, Moment, Point, TaskId
from tca_wire.text.facts_in_words import kill_reason, place, state_change
from tca_wire.vocabulary import Dropping, MessageClass, Outcome, Party, Role, Scope
from tca_wire.waits import WaitKind


class TaskState(StrEnum):
    """The state of a task at the moment folded so far."""

    HELD = "held"  # not begun: constraints or its parent do not allow it yet
    QUEUED = "queued"  # waits for a resource or for a handler
    PLANNING = "planning"  # is being expanded, ahead of its achievement
    PLANNED = "planned"  # expanded; may not be achieved yet
    HANDLING = "handling"  # its handler runs and it is being achieved
    ACHIEVING = "achieving"  # its handler is done, what is under it is being achieved
    ACHIEVED = "achieved"
    RESOLVED = str(
        Outcome.RESOLVED
    )  # an exception handler resolved its failure: it did not do what it should
    RECOVERING = "recovering"  # it failed, and an exception handler decides what becomes of it
    SUSPENDED = "suspended"  # nothing of it may be begun, and no handler has it; what is under it may still run
    ENDING = (
        "ending"  # killed, but its handler still runs, or something under it is still to be done
    )
    FAILED = "failed"
    KILLED = "killed"


DONE = (TaskState.ACHIEVED, TaskState.RESOLVED)
"""States of a task that has ended so that what follows it goes on as planned."""
OVER = (*DONE, TaskState.FAILED, TaskState.KILLED)
"""States of a task that has ended."""


NONE: Any = ()
_SHORT = 8
"""Records: a tuple takes less room than a list."""
_STATES = tuple(TaskState)
_SHARED: dict[bytes, bytes] = {}
"""Short sequences of states, one object each: most tasks go through the same."""
_AS_BYTE = {state: bytes([number]) for number, state in enumerate(_STATES)}
PLACES = {int(moment): place for place, moment in enumerate(MOMENTS, 1)}
"""The places of moments in ``Task.times``."""
PLACES_OF = [
    tuple(PLACES[moment] for moment in MOMENTS if moments & moment)
    for moments in range(ALL_MOMENTS + 1)
]
"""The same of each set of moments."""
_START_HANDLING, _START_ACHIEVING = PLACES[Moment.START_HANDLING], PLACES[Moment.START_ACHIEVING]
_END_PLANNING, _END_ACHIEVING = PLACES[Moment.END_PLANNING], PLACES[Moment.END_ACHIEVING]
_LATELY = 32
"""Waits of a coroutine that are looked at."""
_START, _SINCE, _RUNS = attrgetter("start"), itemgetter(0), attrgetter("runs")


class Span:
    """Something that starts, and ends unless it goes on."""

    __slots__ = ()
    start: float
    end: float | None

    @property
    def until(self) -> float:
        """When it ended; inf if it goes on."""
        return inf if self.end is None else self.end

    def goes_on(self, time: float) -> bool:
        """Whether it had begun at a time, and not ended."""
        return self.start <= time and (self.end is None or self.end > time)


_Span = TypeVar("_Span", bound=Span)
_T = TypeVar("_T")


def added(some: Sequence[_T], one: _T) -> Sequence[_T]:
    """Some, with one more."""
    if len(some) < _SHORT:
        return (*some, one)
    some = some if isinstance(some, list) else [*some]
    some.append(one)
    return some


def first_moment(moments: int) -> Moment | None:
    """The first of a set of moments; None if it is empty."""
    return next((MOMENTS[place - 1] for place in PLACES_OF[moments & ALL_MOMENTS]), None)


def going_on(spans: Sequence[_Span], time: float) -> _Span | None:
    """Of spans one after the other, the one that went on at a time."""
    begun = bisect_right(spans, time, key=_START) if spans else 0
    return spans[begun - 1] if begun and spans[begun - 1].goes_on(time) else None


def lately(spans: Sequence[_Span], time: float) -> list[_Span]:
    """Those that went on at a time, of the last that had begun."""
    begun = bisect_right(spans, time, key=_START) if spans else 0
    return [
        span
        for span in spans[max(begun - _LATELY, 0) : begun]
        if span.end is None or span.end > time
    ]


@dataclass(slots=True)
class HandlerWait(Span):
    """A handler blocks: for the reply to message *awaited*, until task *awaited* reaches a moment,
    or for a claim; or for a change of task *awaited*, or for what *name* says (0).
    """

    awaited: int
    start: float
    moment: Moment | None = None
    end: float | None = None
    by: "Handling | str" = field(default="", repr=False, compare=False)
    """The run of a handler that waits, or the module where it does outside of any."""
    kind: WaitKind = WaitKind.TASK
    """CHANGE, PRESENCE; or TASK, also of a reply or a claim."""
    name: str = ""


@dataclass(slots=True)
class Queueing(Span):
    """A delivery waits for a resource, or for a handler (module "")."""

    message_id: int
    module: str
    resource: str
    start: float
    end: float | None = None
    priority: int = 0


class Drop(NamedTuple):
    """A loss: a message that came to nothing, what one receiver of it was to get, or direct
    messages.
    """

    time: float
    name: str
    """Of the message; "" for notes of direct messages."""
    number: int
    """How many at once."""
    why: str
    message_id: int = 0
    """The message (0: direct ones), or what it is a copy of."""
    is_copy: bool = False
    """Only one receiver did not get it."""
    dropping: Dropping = Dropping.OTHER
    sender: str = ""
    """The module that lost direct messages on the way."""

    @property
    def is_loss(self) -> bool:
        """Whether a handler should have had it."""
        return (
            self.is_copy
            or not self.message_id
            or self.dropping in (Dropping.OVERLOAD, Dropping.DISPLACED)
        )


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
    """KILLED if it returned, but its task had been killed meanwhile; None while it goes on, or if
    it was cut off.
    """
    waits: Sequence[HandlerWait] = NONE
    direct_from: str = ""
    """The module that sent the message directly: it has no id (0), and no record of its own."""
    by: "Handling | None" = field(default=None, repr=False, compare=False)
    """Of such a message the run of a handler that sent it."""
    delivery: int = 0
    """The delivery: what its handler sends names it as its origin. A retried message has a new one
    each time.
    """
    asked: "list[Message] | None" = field(default=None, repr=False, compare=False)
    """The queries that its handler sent."""
    is_lost: bool = False
    """Whether it failed because its module was lost: no handler returned."""
    beside: "tuple[Handling, ...]" = field(default=(), repr=False, compare=False)
    """The runs that went on in the same resource when it began."""
    slot: int = 0
    """The connection of the module that had it."""
    is_nested: bool = False
    """Whether it was handled while its slot waited, in the midst of another message."""
    priority: int = 0


@dataclass(slots=True)
class Claim(Span):
    """A lock or reservation of a module's resource: wanted, then granted, then over."""

    id: int
    module: str
    resource: str
    is_reserved: bool
    sender: str
    origin: int
    """The delivery whose handler wanted it (0: none)."""
    start: float
    granted: float | None = None
    end: float | None = None
    ended: str = ""
    """Why it is over."""
    by: "Handling | None" = field(default=None, repr=False, compare=False)
    """The run of a handler for which it was wanted."""

    @property
    def name(self) -> str:
        """The kind of claim, and its resource."""
        return f"{'reservation' if self.is_reserved else 'lock'} of {place(self.module, self.resource)}"

    def __str__(self) -> str:
        return f"{self.name} {{{self.id}}}"


@dataclass(slots=True)
class Offer(Span):
    """A module handles a message, in one of its resources."""

    module: str
    resource: str
    start: float
    end: float | None = None
    """When it took that back, or left."""
    accepts: bool = False
    """It says itself when it accepts a task."""


class Failure(str):
    """A failure as text: its *name*, and the *words* that were said of it; empty where there is
    none.
    """

    __slots__ = ("name", "words")
    name: str
    words: str

    def __new__(cls, name: str = "", words: str = "") -> Self:
        """The two of them as one text."""
        self = super().__new__(cls, f"{name}: {words}" if words else name)
        self.name, self.words = name, words
        return self


NO_FAILURE = Failure()


class Raised(NamedTuple):
    """A failure was raised on a task beside its handler, which goes on."""

    time: float
    failure: Failure
    by: str
    """The module that raised it, or "central"."""
    asker: Handling | None = None
    """The run of a handler that raised it."""


class Retry(NamedTuple):
    """A task was to be handled again."""

    time: float
    by: str
    is_other: bool
    """Whether with other data."""
    runs: int
    """The number of its handlings that had begun."""
    sent: int
    """The number of tasks that had been sent under it."""
    asker: Handling | None = None
    """The run of a handler that asked for it."""


class LifeChange(NamedTuple):
    """A transition of a task's life cycle."""

    time: float
    transition: str
    state: str
    """The state from then on."""
    serial: int
    by: Party
    module: str = ""
    """Of the client or server."""
    text: str = ""
    """The reason, for people."""
    body: bytes = b""
    """The goal that a client asks for, or an intermediate result."""
    effect: Effect = Effect.NONE

    def __str__(self) -> str:
        """``update by planner, now update requested``; without the state, where that stays."""
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
    """The wiretap whose listener it waits for, if it is that."""


class EventAhead(NamedTuple):
    """An event set for a task: it is killed, or fails if it has not reached a moment by then."""

    set_at: float
    seconds: float
    """How long after *set_at*, or after a point was reached."""
    moment: Moment | None
    """None: it is killed."""
    after: Point | None = None
    scope: Scope = Scope.TASK
    by: str = ""
    """The module that planned the kill."""


class Exhausted(NamedTuple):
    """An exception handler that had been called as often as it may, when a failure was not
    handled.
    """

    time: float
    handler: str
    calls: int


@dataclass(slots=True)
class Suspension(Span):
    """Nothing of a task was begun, from when it was suspended until it was resumed or ended."""

    task: TaskId
    cause: TaskId
    """The suspended task: this one, or one above it."""
    start: float
    still: list[Handling] = field(default_factory=list, repr=False)
    """Handlers of *cause* and under it that ran then, or began since: resumed alone, or to leave
    things safe.
    """
    end: float | None = None
    is_resumed: bool = False
    """Whether it ended so; else the task itself ended."""
    by: str = ""
    """The module that suspended *cause*, or "central"."""
    resumed_by: str = ""
    since_birth: bool = False
    """Whether *cause* was created suspended."""

    @property
    def standstill(self) -> float | None:
        """From when on none of those handlers worked any more (None: one still does)."""
        since = max(
            [self.start, *(self._work_end(one) for one in self.still if one.start < self.until)]
        )
        return since if since < inf else None

    def _work_end(self, handling: Handling) -> float:
        """When a handler was done; or from when on it waited for a task until the suspension was
        over.
        """
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
    body: bytes = b""
    queueings: Sequence[Queueing] = NONE
    handlings: Sequence[Handling] = NONE
    changes: Changes = NONE
    """The overwritten values: when, which of the fields (``body`` or one below), and the old value.
    Many are kept by field, so that each is found in O(log).
    """
    failure: Failure = NO_FAILURE
    """The failure raised on it; none again when it is handled anew."""
    dropped: str = ""
    dropping: Dropping = Dropping.OTHER
    result: bytes = b""
    failure_data: bytes = b""
    role: Role = Role.NONE
    """Why central made it; NONE if a module sent it."""
    about: int = 0
    """The message that it was made for: the failing, tapped, killed or monitoring one."""
    answered: float | None = None
    """When its sender got the (last) answer; of queries only."""
    by: Handling | None = field(default=None, repr=False, compare=False)
    """The run of a handler that sent it, if that went on then."""

    def __str__(self) -> str:
        return f"{self.name} {{{self.id}}}"

    @property
    def was_given_up(self) -> bool:
        """Whether its sender waited no longer for the answer."""
        return self.dropping is Dropping.GIVEN_UP

    @property
    def failures(self) -> list[tuple[float, Failure]]:
        """The failures that were raised on it, and when, oldest first."""
        return (
            [(time, failure) for time, failure in self.became("failure") if failure]
            if self.changes
            else []
        )

    @property
    def is_queued(self) -> bool:
        """Whether it waits for a resource or a handler now."""
        return bool(self.queueings) and self.queueings[-1].end is None

    @property
    def handling(self) -> Handling | None:
        """The run of its handler that goes on now."""
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
    """When it reached which moment (inf: not yet), at its place of ``PLACES``."""
    killed: str | None = None
    """Why it was killed, as central gave it."""
    killed_by: str = ""
    """The module that wanted it killed, or "central"."""
    killer: Handling | None = field(default=None, repr=False, compare=False)
    """The run of a handler that asked for the kill, perhaps long before."""
    killed_for: TaskId = ROOT
    """The task whose failure nobody handled, if it was killed for that."""
    is_waited_for: bool = False
    """Of a polling or demon monitor: its parent waits for its end, else it ends with all else there
    at the latest.
    """
    outlives_retry: bool = False
    """Of a monitor: a retry of the task that it is under spares it."""
    watched: str = ""
    """Of a monitor: why it watches no longer."""
    caught_by: Sequence[TaskId] = NONE
    """The tasks of the exception handlers that were called for its failures."""
    deciders: Sequence[TaskId] = NONE
    """Those of them that decided, one after the other, what became of it; not those for failures
    raised beside.
    """
    is_recovering: bool = False
    """An exception handler decides what becomes of it."""
    is_dealt_with: bool = False
    """Its failure was dealt with."""
    is_unhandled: bool = False
    """Nobody dealt with its failure. Unless killed (it is retried, or survives what is above it) it
    goes on.
    """
    suspensions: Sequence[Suspension] = NONE
    retries: Sequence[Retry] = NONE
    life: Sequence[LifeChange] = NONE
    """The transitions of its life cycle that are facts of their own; lives.py adds those that other
    facts imply.
    """
    since: Sequence[float] = NONE
    """From when on it was in each of its states."""
    stages: bytes | bytearray = b""
    """Those states, a byte each: see ``states``."""

    @property
    def why_killed(self) -> str | None:
        """Why, and by whom; None if it was not killed."""
        return None if self.killed is None else kill_reason(self.killed, self.killed_by)

    def time_of(self, moment: int) -> float:
        """When it reached a moment; inf if it has not."""
        return self.times[PLACES.get(moment, 0)]

    @property
    def reached(self) -> dict[Moment, float]:
        """When it reached which moments."""
        return {
            moment: time for moment, time in zip(MOMENTS, self.times[1:], strict=True) if time < inf
        }

    @property
    def has_ended(self) -> bool:
        """Whether all of it is over, however it ended."""
        return self.times[_END_ACHIEVING] < inf

    def enter(self, state: TaskState, time: float) -> bool:
        """Note its state from a time on; whether it is another one."""
        if self.stages.endswith(stage := _AS_BYTE[state]):
            return False
        self.since = added(self.since, time)
        if isinstance(self.stages, bytearray):
            self.stages += stage
        elif len(self.stages) < _SHORT:
            self.stages = _SHARED.setdefault(stages := self.stages + stage, stages)
        else:
            self.stages = bytearray(self.stages + stage)
        return True

    @property
    def states(self) -> list[tuple[float, TaskState]]:
        """From when on it was in which state."""
        return [
            (since, _STATES[stage]) for since, stage in zip(self.since, self.stages, strict=True)
        ]

    def stage(self, place: int) -> tuple[float, TaskState]:
        """One of these."""
        return self.since[place], _STATES[self.stages[place]]

    def place_at(self, time: float) -> int:
        """Which of its states it was in."""
        return max(bisect_right(self.since, time) - 1, 0)

    def state_at(self, time: float) -> TaskState:
        """Its state at a time."""
        return _STATES[self.stages[-1 if self.since[-1] <= time else self.place_at(time)]]

    def spans(self) -> Iterator[tuple[float, float, TaskState]]:
        """Its states, with from when until when it was in each."""
        states = map(_STATES.__getitem__, self.stages)
        return zip(self.since, [*self.since[1:], inf], states, strict=True)

    @property
    def suspension(self) -> Suspension | None:
        """The one that goes on now, of itself or of what it is under."""
        return (
            self.suspensions[-1] if self.suspensions and self.suspensions[-1].end is None else None
        )

    @property
    def is_retried(self) -> bool:
        """Whether it is to be handled again, and has not been."""
        return self.was_retried(inf)

    def was_retried(self, time: float) -> bool:
        """Whether it was to be handled again at a time, and had not been."""
        begun = bisect_right(self.handlings, time, key=_START)
        first = bisect_left(self.retries, begun, key=_RUNS)
        return bool(begun) and any(
            one.runs == begun and one.time <= time for one in self.retries[first : first + 1]
        )

    @property
    def state(self) -> TaskState:
        """Its current state."""
        if self.killed is None and not self.failure and not self.is_recovering:  # as most
            return TaskState.ACHIEVED if self.times[_END_ACHIEVING] < inf else self._running_state()
        return self._end_state() or self._running_state()

    def _end_state(self) -> TaskState | None:
        has_ended = self.times[_END_ACHIEVING] < inf
        if not has_ended and self.killed is not None:
            return TaskState.ENDING
        if self.is_recovering and not has_ended:
            return TaskState.RECOVERING
        if (
            self.failure
            and not self.is_dealt_with
            and (has_ended or not (self.is_unhandled or self.is_retried))
        ):
            return TaskState.FAILED
        if self.killed is not None:
            return TaskState.KILLED
        if not has_ended:
            return None
        return TaskState.RESOLVED if self.failure else TaskState.ACHIEVED

    def _running_state(self) -> TaskState:
        times, runs = self.times, self.handlings
        handling = runs and runs[-1].end is None
        if self.suspensions and self.suspension and not handling:
            return TaskState.SUSPENDED
        if self.queueings and self.queueings[-1].end is None:
            return TaskState.QUEUED
        if times[_START_HANDLING] == inf:
            return TaskState.HELD
        is_achieving = times[_START_ACHIEVING] < inf
        if handling:
            return TaskState.HANDLING if is_achieving else TaskState.PLANNING
        if is_achieving:
            return TaskState.ACHIEVING
        return TaskState.PLANNED if times[_END_PLANNING] < inf else TaskState.PLANNING


@dataclass(slots=True)
class ModuleRecord:
    """A module, as long as the journal goes."""

    name: str
    joined: list[tuple[float, float | None]] = field(default_factory=list)
    """From when until when it was connected."""
    left: str = ""
    """Why it left the last time."""
    resources: dict[str, int] = field(default_factory=dict)
    """Its resources with their capacities (0: its module has left)."""
    capacities: dict[str, int] = field(default_factory=dict)
    """The largest capacity that each resource had."""
    sizes: dict[str, list[tuple[float, int]]] = field(default_factory=dict)
    """From when on each resource had which capacity."""
    waits: Sequence[HandlerWait] = NONE
    """Its waits outside of any handler."""
