"""Reports of an application, from its schedule: allocation, measurements, analysis."""

from collections.abc import Sequence

from tca_behaviours.activities import reports
from tca_behaviours.activities.analysis import (
    Demand,
    is_hyperbolic,
    liu_layland,
    response_bounds,
    utilisation,
)
from tca_behaviours.activities.processing.schedule import Processor, Schedule, ScheduledActivity
from tca_wire.text.measures import duration

_RECENT, _RECENT_PERIODS = 10.0, 100
"""How long a late tick overrules the analysis: in seconds and in periods; the longer counts."""


def allocation_report(
    application: str, policy: str, is_running: bool, schedule: Schedule
) -> reports.AllocationReport:
    """The allocation of the activities."""
    processors = [
        reports.ProcessorEntry(
            processor.name,
            processor.priority,
            processor.period,
            [_entry(activity) for activity in processor.activities],
        )
        for processor in schedule.processors
    ]
    unallocated = [
        _entry(activity) for activity in schedule.activities.values() if activity.processor is None
    ]
    return reports.AllocationReport(application, policy, is_running, processors, unallocated)


def application_figures(
    application: str, running_for: float, now: float, schedule: Schedule
) -> reports.ApplicationFigures:
    """The measurements, and the results of the analysis."""
    demands = [
        demand for one in schedule.processors if (demand := _demands(one.activities)) is not None
    ]
    is_known = len(demands) == len(schedule.processors)
    bounds = response_bounds(demands) if is_known else [None for _ in schedule.processors]
    processors = [
        _processor(schedule, one, bound, is_known, now)
        for one, bound in zip(schedule.processors, bounds, strict=True)
    ]
    verdicts = {one.is_schedulable for one in processors}
    return reports.ApplicationFigures(
        application,
        running_for,
        sum(one.load for one in processors),
        sum(utilisation(one) for one in demands) if is_known else None,
        liu_layland(len(schedule.processors)),
        is_hyperbolic(utilisation(one) for one in demands) if is_known else None,
        None if verdicts == {None} else False not in verdicts,
        processors,
        [_activity(one) for one in schedule.activities.values()],
        schedule.held_by(now),
        next((f"{one.name}: {one.refuted}" for one in processors if one.refuted), ""),
    )


def _demands(activities: Sequence[ScheduledActivity]) -> list[Demand] | None:
    """The demands of activities; None while an execution time is unknown."""
    known = [Demand(one.name, one.period, one.cost) for one in activities if one.cost is not None]
    return known if len(known) == len(activities) else None


def _entry(activity: ScheduledActivity) -> reports.ActivityEntry:
    return reports.ActivityEntry(
        activity.name, activity.activity.component, activity.period, activity.activity.estimate
    )


def _activity(activity: ScheduledActivity) -> reports.ActivityFigures:
    execution, left_out = activity.execution, activity.release.left_out
    return reports.ActivityFigures(
        activity.name,
        execution.ticks,
        activity.release.missed - left_out,
        left_out,
        execution.errors,
        execution.error,
        execution.mean,
        execution.longest,
        activity.times.response,
        activity.times.jitter,
    )


def _processor(
    schedule: Schedule, processor: Processor, bound: float | None, is_known: bool, now: float
) -> reports.ProcessorFigures:
    """The figures of a processor. A recent late tick overrules the analysis."""
    jitter = max((each.times.jitter for each in processor.activities), default=0.0)
    margin = processor.period - bound if bound is not None else None
    verdict = bound is not None if is_known else None
    last_late, refuted = None, ""
    if late := schedule.last_late(processor, bound or processor.period, now):
        last_late = now - late[0]
        if verdict is not False and last_late <= max(_RECENT, _RECENT_PERIODS * processor.period):
            took = f"{duration(late[1])} from due to done {duration(last_late)} ago"
            limit = f"the {'bound' if bound else 'period'} is {duration(bound or processor.period)}"
            verdict, refuted = False, f"refuted by measurement: {took}; {limit}"
    return reports.ProcessorFigures(
        processor.name,
        processor.ticks,
        processor.load.share(now),
        processor.times.response,
        jitter,
        processor.overruns,
        bound,
        margin,
        verdict,
        refuted,
        last_late,
    )
