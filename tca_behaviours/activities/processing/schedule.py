"""Which activity is ticked next, and when: fixed priorities, switched between activities. Pure:
times are passed in.
"""

import math
from collections import deque
from typing import NamedTuple, Protocol

from tca_behaviours.activities.processing.measured import Execution, Late, Load, TickTimes
from tca_module import MisuseError
from tca_module.checks import check, check_known, number
from tca_module.period import Period
from tca_wire.text.measures import duration

_EXACT = 1e-9  # seconds: so much comes of rounding
_LONG = 1.0  # seconds: no tick should take so long
_LONGEST = 1e9  # seconds: threads can't wait for much longer
_PERIOD = number(f"{_EXACT:g} to {_LONGEST:g} seconds", _EXACT, _LONGEST)
_ESTIMATE = number(f"0 to {_LONGEST:g} seconds", 0, _LONGEST).or_none()


class StateActivity(Protocol):
    """Something short that is to be done once a period."""

    name: str
    """Unique in an application: "x.movement.moving", "x.movement.machine", "x.port handler"."""
    component: str
    period: float
    """Seconds. The component's own wish; a processor may be told another."""
    estimate: float | None
    """Its longest execution time in seconds, as declared; None: it is to be measured."""

    def tick(self) -> None:
        """Do one step. Never blocks. The activity of a state does nothing while that state is not
        active.
        """


class ScheduledActivity:
    """An activity with the times at which it is due, which stay its own wherever it goes."""

    def __init__(self, activity: StateActivity) -> None:
        self.activity = activity
        self.name = activity.name
        self.period = activity.period  #: seconds, as they are wanted now
        self.processor: Processor | None = None  #: None: nothing ticks it
        self.release = Period(0.0, activity.period)
        self.execution = Execution(activity.estimate)
        self.times = TickTimes()

    @property
    def cost(self) -> float | None:
        """Its longest execution time: as declared, else as measured; None: unknown. What is
        declared does not count any more once most ticks take longer: then their mean does.
        """
        if self.activity.estimate is not None:
            return self.execution.mean if self.execution.is_refuted else self.activity.estimate
        return self.execution.longest if self.execution.ticks else None


class Processor:
    """Ticks its activities in the order of their subscription, in rounds: one of those that are due
    at its beginning. What becomes due meanwhile comes in the next round.
    """

    def __init__(self, name: str, now: float) -> None:
        self.name = name
        self.priority = 0
        self.period = math.inf  #: the least of its activities
        self.activities: list[ScheduledActivity] = []
        self.round: deque[ScheduledActivity] = deque()  #: those that are still to be ticked in it
        self._due: float | None = None  #: when the next of its activities is, if that is known
        self.ticks = 0
        self.overruns = 0
        self.times = TickTimes()
        self.load = Load(now)

    @property
    def due(self) -> float:
        """When the next of its activities is."""
        if self._due is None:
            self._due = min((one.release.due for one in self.activities), default=math.inf)
        return self._due

    def look_again(self) -> None:
        """When one of its activities is due has changed."""
        self._due = None


class ProcessorTurn(NamedTuple):
    """The processor that is next, and when: now, or later if no activity is due yet."""

    processor: Processor
    at: float


class Schedule:
    """The activities of an application, and the processors that tick them one at a time."""

    def __init__(self) -> None:
        self.activities: dict[str, ScheduledActivity] = {}
        self.processors: list[Processor] = []  #: the first one goes first
        self.ticked: ScheduledActivity | None = None  #: now
        self._ticking = Processor("", 0.0)
        self._release = Period(0.0, 1.0)
        self._began = 0.0

    # --- at work ----------------------------------------------------------------------------------

    def start(self, now: float) -> None:
        """All activities are due."""
        for one in self.activities.values():
            one.release = Period(now, one.period)
        for processor in self.processors:
            processor.round.clear()
            processor.load = Load(now)
        self.change_order()

    def next_turn(self, now: float) -> ProcessorTurn | None:
        """The processor that is next, between two ticks; None: there is nothing to tick."""
        for processor in self.processors:
            if processor.round or processor.due <= now + _EXACT:
                return ProcessorTurn(processor, now)
        earliest = min(self.processors, key=lambda one: one.due, default=None)
        if earliest is None or earliest.due == math.inf:
            return None
        return ProcessorTurn(earliest, earliest.due)

    def begin(self, processor: Processor, now: float) -> ScheduledActivity:
        """The tick that is next on a processor whose turn it is."""
        if not processor.round:
            processor.round.extend(
                one for one in processor.activities if one.release.due <= now + _EXACT
            )
        self.ticked, self._ticking, self._began = processor.round.popleft(), processor, now
        self._release = self.ticked.release
        return self.ticked

    def end(self, now: float, error: str = "") -> None:
        """That tick is over."""
        one, processor = self.ticked, self._ticking
        assert one is not None
        due, took = self._release.due, now - self._began
        self._release.next(now, one.period)
        one.execution.add(took, error)
        one.times.add(due, self._began, now)
        processor.ticks += 1
        processor.times.add(due, self._began, now)
        processor.load.add(now, took)
        processor.overruns += now - due > processor.period + _EXACT
        self.ticked = None
        if one.processor is not None:
            one.processor.look_again()

    def last_late(self, processor: Processor, limit: float, now: float) -> Late | None:
        """The last tick of a processor with a longer response time: the one that is due now, or one
        that has ended.
        """
        so_far = (
            now - processor.due if self.ticked is not None else 0.0
        )  # it may wait for a tick that does not end
        return (
            (now, so_far) if so_far > limit + _EXACT else processor.times.last_above(limit + _EXACT)
        )

    def held_by(self, now: float) -> str:
        """The activity whose tick takes so long that something must be wrong with it."""
        return self.ticked.name if self.ticked is not None and now - self._began > _LONG else ""

    # --- changes, while it runs too ---------------------------------------------------------------

    def add(self, activity: StateActivity) -> None:
        """An activity that is on no processor yet."""
        if activity.name in self.activities:
            raise MisuseError(
                f"two activities are called '{activity.name}': give their components different names"
            )
        check(f"activity '{activity.name}'", _PERIOD, period=activity.period)
        check(f"activity '{activity.name}'", _ESTIMATE, estimate=activity.estimate)
        if activity.estimate is not None and activity.estimate > activity.period:
            said = f"activity '{activity.name}' takes {duration(activity.estimate)}, longer than its period"
            raise MisuseError(
                f"{said} of {duration(activity.period)}: divide it into shorter steps"
            )
        self.activities[activity.name] = ScheduledActivity(activity)

    def processor(self, name: str) -> Processor | None:
        """None if there is none of that name."""
        return next((one for one in self.processors if one.name == name), None)

    def new_processor(self, name: str, now: float) -> Processor:
        """One without activities."""
        self.processors.append(Processor(name, now))
        return self.processors[-1]

    def activity(self, name: str) -> ScheduledActivity:
        """Raises MisuseError if there is none of that name."""
        check_known("there is no activity", name, self.activities)
        return self.activities[name]

    def put(
        self, one: ScheduledActivity, processor: Processor, now: float, position: int | None = None
    ) -> None:
        """Move an activity to a processor, or within it: to the end, or to a position. One that was
        on none is due at once; else the times at which it is due stay as they are.
        """
        if one.processor is None:
            one.release = Period(now, one.period)
        else:
            self.take_off(one)
        place = (
            len(processor.activities)
            if position is None
            else min(position, len(processor.activities))
        )
        processor.activities.insert(place, one)
        one.processor = processor

    def take_off(self, one: ScheduledActivity) -> None:
        """Nothing ticks it any more."""
        if (processor := one.processor) is not None:
            processor.activities.remove(one)
            if one in processor.round:
                processor.round.remove(one)
            one.processor = None

    def set_period(self, one: ScheduledActivity, seconds: float, now: float) -> None:
        """It counts from the tick before. A tick that is due stays due."""
        check(f"activity '{one.name}'", _PERIOD, period=seconds)
        if seconds < (takes := one.activity.estimate or 0.0):
            raise MisuseError(
                f"activity '{one.name}' takes {duration(takes)}: its period can't be {duration(seconds)}"
            )
        one.period = seconds
        if one is not self.ticked:
            one.release.change(now, seconds)

    def change_order(self) -> None:
        """After changes: processors without activities go, the others are put in order, and times
        are measured anew.
        """
        self.processors = [one for one in self.processors if one.activities]
        for processor in self.processors:
            processor.period = min(one.period for one in processor.activities)
        self.processors.sort(
            key=lambda one: (-one.priority, one.period)
        )  # the sort is stable: then the older one
        for processor in self.processors:
            processor.look_again()
            processor.ticks = processor.overruns = 0
            processor.times = TickTimes()
        for activity in self.activities.values():
            activity.times = TickTimes()
