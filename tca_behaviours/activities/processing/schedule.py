"""Decides which activity is ticked next, and when.

Priorities are fixed, and processors switch between activities. Pure: the caller passes the times.
"""

import math
from collections import deque
from typing import NamedTuple, Protocol

from tca_behaviours.activities.processing.measured import Execution, Late, Load, TickTimes
from tca_module import MisuseError
from tca_module.checks import check, check_known, number
from tca_module.period import Period
from tca_wire.text.measures import duration

_ROUNDING = 1e-9  # seconds that rounding may cause
_LONG = 1.0  # seconds: a longer tick is suspicious
_LONGEST = 1e9  # seconds: threads can't wait for much longer
_PERIOD = number(f"{_ROUNDING:g} to {_LONGEST:g} seconds", _ROUNDING, _LONGEST)
_ESTIMATE = number(f"0 to {_LONGEST:g} seconds", 0, _LONGEST).or_none()


class StateActivity(Protocol):
    """A short step that is done once a period."""

    name: str
    """Unique in an application: "x.movement.moving", "x.movement.machine", "x.port handler"."""
    component: str
    period: float
    """Seconds, as the component declares them; the schedule may use another period."""
    estimate: float | None
    """Its declared longest execution time in seconds; None: it is measured."""

    def tick(self) -> None:
        """Do one step, without blocking. The activity of an inactive state does nothing."""


class ScheduledActivity:
    """An activity with its due times. The due times stay the same when the activity moves to
    another processor.
    """

    def __init__(self, activity: StateActivity) -> None:
        self.activity = activity
        self.name = activity.name
        self.period = activity.period  #: seconds, at present
        self.processor: Processor | None = None  #: None: it is not ticked
        self.release = Period(0.0, activity.period)  #: its due times
        self.execution = Execution(activity.estimate)
        self.times = TickTimes()

    @property
    def cost(self) -> float | None:
        """The longest execution time of a tick: the declared one, else the measured one; None if
        both are unknown.

        If most ticks take longer than declared, the mean of the measured times counts instead.
        """
        if self.activity.estimate is not None:
            return self.execution.mean if self.execution.is_refuted else self.activity.estimate
        return self.execution.longest if self.execution.ticks else None


class Processor:
    """Ticks its activities in rounds, in the order of their subscription.

    A round has one tick of each activity that was due at the start of the round. An activity that
    becomes due during a round waits for the next round.
    """

    def __init__(self, name: str, now: float) -> None:
        self.name = name
        self.priority = 0
        self.period = math.inf  #: the least period of its activities
        self.activities: list[ScheduledActivity] = []
        self.round: deque[ScheduledActivity] = deque()  #: the activities yet to tick in this round
        self._due: float | None = None  #: the cached ``due``; None: compute it again
        self.ticks = 0
        self.overruns = 0
        self.times = TickTimes()
        self.load = Load(now)

    @property
    def due(self) -> float:
        """When its next activity is due."""
        if self._due is None:
            self._due = min((each.release.due for each in self.activities), default=math.inf)
        return self._due

    def invalidate_due(self) -> None:
        """Compute ``due`` again: the due time of one of its activities has changed."""
        self._due = None


class ProcessorTurn(NamedTuple):
    """The processor that goes next, and when: now, or later if no activity is due yet."""

    processor: Processor
    at: float


class Schedule:
    """The activities of an application, and the processors that tick them one at a time."""

    def __init__(self) -> None:
        self.activities: dict[str, ScheduledActivity] = {}
        self.processors: list[Processor] = []  #: in the order in which they go
        self.ticked: ScheduledActivity | None = None  #: the activity whose tick is running
        # The newest tick: its processor, the due times of its activity, and its start.
        self._ticking_processor = Processor("", 0.0)
        self._release = Period(0.0, 1.0)
        self._began = 0.0

    # --- running ----------------------------------------------------------------------------------

    def start(self, now: float) -> None:
        """Make all activities due."""
        for activity in self.activities.values():
            activity.release = Period(now, activity.period)
        for processor in self.processors:
            processor.round.clear()
            processor.load = Load(now)
        self.update_order()

    def next_turn(self, now: float) -> ProcessorTurn | None:
        """Return the processor that goes next, between two ticks; None if there is nothing to
        tick.
        """
        for processor in self.processors:
            if processor.round or processor.due <= now + _ROUNDING:
                return ProcessorTurn(processor, now)
        earliest = min(self.processors, key=lambda processor: processor.due, default=None)
        if earliest is None or earliest.due == math.inf:
            return None
        return ProcessorTurn(earliest, earliest.due)

    def begin(self, processor: Processor, now: float) -> ScheduledActivity:
        """Begin the next tick on a processor whose turn it is. Returns its activity."""
        if not processor.round:
            processor.round.extend(
                activity
                for activity in processor.activities
                if activity.release.due <= now + _ROUNDING
            )
        self.ticked = processor.round.popleft()
        self._ticking_processor, self._release, self._began = processor, self.ticked.release, now
        return self.ticked

    def end(self, now: float, error: str = "") -> None:
        """End the tick."""
        activity, processor = self.ticked, self._ticking_processor
        assert activity is not None
        due, took = self._release.due, now - self._began
        self._release.next(now, activity.period)
        activity.execution.add(took, error)
        activity.times.add(due, self._began, now)
        processor.ticks += 1
        processor.times.add(due, self._began, now)
        processor.load.add(now, took)
        processor.overruns += now - due > processor.period + _ROUNDING
        self.ticked = None
        if activity.processor is not None:
            activity.processor.invalidate_due()

    def last_late(self, processor: Processor, limit: float, now: float) -> Late | None:
        """Return the last tick of a processor whose response time exceeds a limit, if any.

        While a tick is running, a tick that is due and has not ended counts, too.
        """
        # If the running tick does not end, the activities that wait for it are late already.
        waited = now - processor.due if self.ticked is not None else 0.0
        if waited > limit + _ROUNDING:
            return now, waited
        return processor.times.last_above(limit + _ROUNDING)

    def held_by(self, now: float) -> str:
        """Return the activity whose tick takes suspiciously long, if any."""
        return self.ticked.name if self.ticked is not None and now - self._began > _LONG else ""

    # --- changes, also while it runs --------------------------------------------------------------

    def add(self, activity: StateActivity) -> None:
        """Add an activity, on no processor yet."""
        if activity.name in self.activities:
            raise MisuseError(
                f"two activities are called '{activity.name}': give their components other names"
            )
        check(f"activity '{activity.name}'", _PERIOD, period=activity.period)
        check(f"activity '{activity.name}'", _ESTIMATE, estimate=activity.estimate)
        if activity.estimate is not None and activity.estimate > activity.period:
            raise MisuseError(
                f"activity '{activity.name}' takes {duration(activity.estimate)}, longer than its "
                f"period of {duration(activity.period)}: divide it into shorter steps"
            )
        self.activities[activity.name] = ScheduledActivity(activity)

    def processor(self, name: str) -> Processor | None:
        """Return the processor of that name, if any."""
        return next((each for each in self.processors if each.name == name), None)

    def new_processor(self, name: str, now: float) -> Processor:
        """Add a processor without activities."""
        self.processors.append(Processor(name, now))
        return self.processors[-1]

    def activity(self, name: str) -> ScheduledActivity:
        """Return the activity of that name. Raises MisuseError if there is none."""
        check_known("there is no activity", name, self.activities)
        return self.activities[name]

    def put(
        self,
        activity: ScheduledActivity,
        processor: Processor,
        now: float,
        position: int | None = None,
    ) -> None:
        """Put an activity on a processor: at the end, or at a position. The activity may be on that
        processor already.

        An activity that was on no processor is due at once. Any other activity keeps its due times.
        """
        if activity.processor is None:
            activity.release = Period(now, activity.period)
        else:
            self.unassign(activity)
        # list.insert() takes no huge position.
        last = len(processor.activities)
        processor.activities.insert(last if position is None else min(position, last), activity)
        activity.processor = processor

    def unassign(self, activity: ScheduledActivity) -> None:
        """Remove an activity from its processor."""
        if (processor := activity.processor) is not None:
            processor.activities.remove(activity)
            if activity in processor.round:
                processor.round.remove(activity)
            activity.processor = None

    def set_period(self, activity: ScheduledActivity, seconds: float, now: float) -> None:
        """Change the period of an activity. The new period counts from the last tick. A tick that
        is due stays due.
        """
        check(f"activity '{activity.name}'", _PERIOD, period=seconds)
        if seconds < (takes := activity.activity.estimate or 0.0):
            raise MisuseError(
                f"activity '{activity.name}' takes {duration(takes)}: "
                f"its period can't be {duration(seconds)}"
            )
        activity.period = seconds
        if activity is not self.ticked:
            activity.release.change(now, seconds)

    def update_order(self) -> None:
        """Update the processors after a change.

        Processors without activities are removed, the others are sorted, and measurements start
        again.
        """
        self.processors = [processor for processor in self.processors if processor.activities]
        for processor in self.processors:
            processor.period = min(activity.period for activity in processor.activities)
        # The sort is stable: among equal processors the older one goes first.
        self.processors.sort(key=lambda processor: (-processor.priority, processor.period))
        for processor in self.processors:
            processor.invalidate_due()
            processor.ticks = processor.overruns = 0
            processor.times = TickTimes()
        for activity in self.activities.values():
            activity.times = TickTimes()
