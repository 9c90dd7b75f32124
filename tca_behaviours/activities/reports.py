"""Reports of an application: its allocation, and measured and computed figures. Times are in
seconds.
"""

import msgspec


class ActivityEntry(msgspec.Struct, frozen=True):
    """An activity, as it is ticked."""

    name: str
    component: str
    period: float
    estimate: float | None
    """The declared longest execution time; None if none was declared."""


class ProcessorEntry(msgspec.Struct, frozen=True):
    """A processor and its activities, in order of subscription."""

    name: str
    priority: int
    """The processor with the higher priority goes first. Among equal priorities the shorter period
    does.
    """
    period: float
    """The least period of its activities."""
    activities: list[ActivityEntry]


class AllocationReport(msgspec.Struct, frozen=True):
    """The processors, in the order in which they go."""

    application: str
    policy: str
    is_running: bool
    processors: list[ProcessorEntry]
    unallocated: list[ActivityEntry]
    """The activities on no processor, which are not ticked."""


class ActivityFigures(msgspec.Struct, frozen=True):
    """The measured figures of an activity."""

    name: str
    ticks: int
    overruns: int
    """The number of ticks that ended after the next tick was due."""
    left_out: int
    """How often the activity was due and not ticked, because the tick before had not begun or took
    too long.
    """
    errors: int
    """The number of ticks that raised an exception."""
    error: str
    """The last exception."""
    mean: float
    """The mean execution time."""
    longest: float
    """The longest execution time."""
    response: float
    """The longest time from due to done, since the last change of the allocation."""
    jitter: float
    """The longest minus the shortest delay from due to started, since the last change."""


class ProcessorFigures(msgspec.Struct, frozen=True):
    """The figures of a processor since the last change of the allocation, and its analysis.

    The analysis yields None while an execution time is neither declared nor measured.
    """

    name: str
    ticks: int
    load: float
    """The share of a processor core in the last second."""
    response: float
    jitter: float
    overruns: int
    """The number of ticks that took more than one period of the processor, from due to done."""
    bound: float | None
    """The bound of the response time. Also None if the bound exceeds the period."""
    margin: float | None
    """The period less the bound."""
    is_schedulable: bool | None
    """The verdict of the analysis, unless a recent tick has refuted it."""
    refuted: str = ""
    """A text about the last tick whose response time exceeded the bound. Without a bound, the
    period counts.

    "" if no such tick ended in the last 10 s or 100 periods, or if the analysis itself says "not
    schedulable".
    """
    last_late: float | None = None
    """The seconds since the last late tick, which may be any time ago; None: no tick was late."""


class ApplicationFigures(msgspec.Struct, frozen=True):
    """The figures of an application that runs, or has run."""

    application: str
    running_for: float
    load: float
    """The measured load of the last second."""
    utilisation: float | None
    """The sum of execution times, each divided by its period."""
    liu_layland: float
    """The utilisation up to which preemptive, rate-monotonic processors are schedulable."""
    is_hyperbolic: bool | None
    """Whether the processors are schedulable by the hyperbolic bound, which accepts more than
    ``liu_layland``.
    """
    is_schedulable: bool | None
    processors: list[ProcessorFigures]
    activities: list[ActivityFigures]
    held_by: str = ""
    """The activity whose tick has run for over a second. Until the end of that tick, no other
    activity is ticked.
    """
    refuted: str = ""
    """The first processor whose analysis a measurement has refuted, with the reason."""
