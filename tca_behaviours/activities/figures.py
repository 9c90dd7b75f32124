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
"""A late tick overrules the analysis for 10 s, or for 100 periods if those are longer.
"""


def allocation_report(
    application: str, policy: str, is_running: bool, schedule: Schedule
) -> reports.AllocationReport:
    """Return the allocation of the activities."""
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
    """Return the measurements, and the results of the analysis."""
    found = [_demands(processor.activities) for processor in schedule.processors]
    demands = [each for each in found if each is not None]
    is_known = len(demands) == len(found)
    bounds = response_bounds(demands) if is_known else [None] * len(found)
    processors = [
        _processor_figures(schedule, processor, bound, is_known, now)
        for processor, bound in zip(schedule.processors, bounds, strict=True)
    ]
    verdicts = {each.is_schedulable for each in processors}
    return reports.ApplicationFigures(
        application=application,
        running_for=running_for,
        load=sum(each.load for each in processors),
        utilisation=sum(map(utilisation, demands)) if is_known else None,
        liu_layland=liu_layland(len(schedule.processors)),
        is_hyperbolic=is_hyperbolic(map(utilisation, demands)) if is_known else None,
        is_schedulable=None if verdicts == {None} else False not in verdicts,
        processors=processors,
        activities=[_activity_figures(each) for each in schedule.activities.values()],
        held_by=schedule.held_by(now),
        refuted=next((f"{each.name}: {each.refuted}" for each in processors if each.refuted), ""),
    )


def _demands(activities: Sequence[ScheduledActivity]) -> list[Demand] | None:
    """Return the demands of activities; None while an execution time is unknown."""
    demands = [
        Demand(each.name, each.period, each.cost) for each in activities if each.cost is not None
    ]
    return demands if len(demands) == len(activities) else None


def _entry(activity: ScheduledActivity) -> reports.ActivityEntry:
    return reports.ActivityEntry(
        activity.name, activity.activity.component, activity.period, activity.activity.estimate
    )


def _activity_figures(activity: ScheduledActivity) -> reports.ActivityFigures:
    execution, left_out = activity.execution, activity.release.left_out
    return reports.ActivityFigures(
        name=activity.name,
        ticks=execution.ticks,
        overruns=activity.release.missed - left_out,
        left_out=left_out,
        errors=execution.errors,
        error=execution.error,
        mean=execution.mean,
        longest=execution.longest,
        response=activity.times.response,
        jitter=activity.times.jitter,
    )


def _processor_figures(
    schedule: Schedule, processor: Processor, bound: float | None, is_known: bool, now: float
) -> reports.ProcessorFigures:
    """Return the figures of a processor. A recent late tick overrules the verdict of the
    analysis.
    """
    verdict = bound is not None if is_known else None
    last_late, refuted, limit = None, "", bound or processor.period
    if late := schedule.last_late(processor, limit, now):
        ended_at, response = late
        last_late = now - ended_at
        if verdict is not False and last_late <= max(_RECENT, _RECENT_PERIODS * processor.period):
            took = f"{duration(response)} from due to done {duration(last_late)} ago"
            known = f"the {'bound' if bound else 'period'} is {duration(limit)}"
            verdict, refuted = False, f"refuted by measurement: {took}; {known}"
    return reports.ProcessorFigures(
        name=processor.name,
        ticks=processor.ticks,
        load=processor.load.share(now),
        response=processor.times.response,
        jitter=max((each.times.jitter for each in processor.activities), default=0.0),
        overruns=processor.overruns,
        bound=bound,
        margin=processor.period - bound if bound is not None else None,
        is_schedulable=verdict,
        refuted=refuted,
        last_late=last_late,
    )
