"""What an application tells of itself: its allocation, and figures measured and computed. All times
are in seconds.
"""

import msgspec


class ActivityEntry(msgspec.Struct, frozen=True):
    """An activity as it is ticked."""

    name: str
    component: str
    period: float
    estimate: float | None
    """Its longest execution time, as declared."""


class ProcessorEntry(msgspec.Struct, frozen=True):
    """A processor and its activities, in order of subscription."""

    name: str
    priority: int
    """The higher one goes first; among equal ones the shorter period."""
    period: float
    """The least of its activities."""
    activities: list[ActivityEntry]


class AllocationReport(msgspec.Struct, frozen=True):
    """The processors, the first of which goes first."""

    application: str
    policy: str
    is_running: bool
    processors: list[ProcessorEntry]
    unallocated: list[ActivityEntry]
    """On no processor, so that nothing ticks them."""


class ActivityFigures(msgspec.Struct, frozen=True):
    """What was measured of an activity."""

    name: str
    ticks: int
    overruns: int
    """Ticks that ended after the next was due."""
    left_out: int
    """Times at which it was due and not ticked, as the tick before had not begun yet, or took too
    long.
    """
    errors: int
    """Ticks that raised."""
    error: str
    """The last error."""
    mean: float
    """Execution time."""
    longest: float
    """Execution time."""
    response: float
    """The longest time from being due to the end of the tick, since the last change of the
    allocation.
    """
    jitter: float
    """The longest less the shortest time from being due to the beginning, since the last change of
    the allocation.
    """


class ProcessorFigures(msgspec.Struct, frozen=True):
    """What was measured of a processor since the last change of the allocation, and what analysis
    says of it.

    Analysis says nothing (None) while an execution time is neither declared nor measured.
    """

    name: str
    ticks: int
    load: float
    """The share of a processor core in the last second."""
    response: float
    jitter: float
    overruns: int
    """Ticks that ended later than one period of the processor after they were due."""
    bound: float | None
    """Of the response time. None, too, where there is none within the period."""
    margin: float | None
    """The period less the bound."""
    is_schedulable: bool | None
    """By the analysis, unless a recent tick has refuted it."""
    refuted: str = ""
    """The tick of the last 10 s, or 100 periods, that ended later than the bound, or than the
    period if there is none:
    in words; empty: none did.
    """
    last_late: float | None = None
    """Seconds since the last such tick, however long ago; None: there was none."""


class ApplicationFigures(msgspec.Struct, frozen=True):
    """Figures of an application that runs, or has run."""

    application: str
    running_for: float
    load: float
    """Measured, of the last second."""
    utilisation: float | None
    """By the analysis: the sum of execution times, each divided by its period."""
    liu_layland: float
    """Preemptive processors that use no more than this are schedulable by rate-monotonic
    priorities.
    """
    is_hyperbolic: bool | None
    """Whether they are by the hyperbolic bound, which accepts more."""
    is_schedulable: bool | None
    processors: list[ProcessorFigures]
    activities: list[ActivityFigures]
    held_by: str = ""
    """An activity whose tick has run for more than a second: nothing else is ticked until it
    ends.
    """
    refuted: str = ""
    """The first processor that measurement refutes, in words."""
