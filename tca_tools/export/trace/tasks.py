"""The task tree as tracks: one for each depth, on which every task is a slice with its states inside. Pure."""

from collections import defaultdict
from collections.abc import Iterator
from functools import partial
from itertools import chain, pairwise, starmap
from math import inf
from operator import itemgetter

from tca_tools.export.trace.details import of_task
from tca_tools.export.trace.events import Details, Event, Trace, TraceSpan, Track, in_lanes
from tca_tools.journal.fates import went_on
from tca_tools.journal.records import Task
from tca_wire.points import Moment
from tca_wire.text.bodies import plain_data

_DEEPEST = 12
"""Deeper tasks share one track: a tree may be a hundred thousand tasks deep."""


def add_task_tree(trace: Trace) -> None:
    """Tracks for all tasks, those at the top first; each lasts from its birth to its end."""
    depths: dict[int, int] = {}
    levels = defaultdict(list)
    for task in trace.run.tasks.values():
        depth = depths[task.id] = depths.get(task.parent, 0) + 1
        span = trace.span(task.received, task.reached.get(Moment.END_ACHIEVING))
        levels[min(depth, _DEEPEST)].append((span, task))
    group = trace.add("task tree") if levels else None
    for depth in sorted(levels):
        name = f"depth {depth}" + (" and deeper" if depth == _DEEPEST else "")
        for lane in in_lanes(levels[depth]):
            track = trace.add(name, group, depth)
            track.events = chain.from_iterable(starmap(partial(_task, track), lane))


def _task(track: Track, span: TraceSpan, task: Task) -> Iterator[Event]:
    outer = track.begin(span, task.name, "task", of_task(track.trace.run, task))
    return track.within(span, outer, _moments(track, span, task), _states(track, span, task))


def _states(track: Track, span: TraceSpan, task: Task) -> Iterator[Event]:
    """The states that it was in until its end."""
    stages: list[tuple[float, str]] = [(track.trace.nanoseconds(time), str(state)) for time, state in task.states]
    found = []
    for (start, state), (after, _) in pairwise([*stages, (span.last, "")]):
        end = min(after, span.last)
        if start < end:
            stage = TraceSpan(int(start), None if end == inf else int(end))
            found.append((stage, track.begin(stage, state, "state")))
    return track.slices(found)


def _moments(track: Track, span: TraceSpan, task: Task) -> list[Event]:
    """Its failures and kills, and what was asked of it and told of it while it went on."""
    trace = track.trace
    news: list[tuple[float, str, str, Details]] = [
        (time, "failed", "failure", {"failure": text, "handled": went_on(trace.run, task, time)})
        for time, text in task.became("failure")
        if text
    ]
    news += [
        (time, "killed", "failure", {"why": why, "by": task.was("killed_by", time) or None})
        for time, why in task.became("killed")
        if why is not None
    ]
    for one in task.life:
        details: Details = {"state": one.state, "by": one.module or str(one.by), "why": one.text or None}
        news.append((one.time, one.transition, "change", details | {"data": plain_data(one.body)}))
    return [
        track.instant(int(min(trace.nanoseconds(time), span.last)), name, category, details)
        for time, name, category, details in sorted(news, key=itemgetter(0))
    ]
