"""The task tree as tracks: one for each depth, on which every task is a slice with its states inside. Pure."""

from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from math import inf

from tca_tools.export.trace.details import Details, of_task
from tca_tools.export.trace.events import Event, Kind, Trace, Track, slices, within
from tca_tools.export.trace.lanes import Span, in_lanes
from tca_tools.run.fates import went_on
from tca_tools.run.records import Task
from tca_wire.points import Moment

_DEEPEST = 12
"""What is deeper shares one track: a tree may be a hundred thousand tasks deep."""


def add_task_tree(trace: Trace) -> None:
    """Tracks for all tasks, those at the top first."""
    levels = _levels(trace)
    group = trace.add("task tree") if levels else None
    for depth in sorted(levels):
        name = f"depth {depth}" + (" and deeper" if depth == _DEEPEST else "")
        for lane in in_lanes(levels[depth]):
            track = trace.add(name, group, depth)
            track.events = _lane(trace, track, lane)


def _levels(trace: Trace) -> dict[int, list[tuple[Span, Task]]]:
    """The tasks of each depth, with their spans: from their birth to their end."""
    depths: dict[int, int] = {}
    levels = defaultdict(list)
    for task in trace.run.tasks.values():
        depth = depths[task.id] = depths.get(task.parent, 0) + 1
        span = trace.span(task.received, task.reached.get(Moment.END_ACHIEVING))
        levels[min(depth, _DEEPEST)].append((span, task))
    return levels


def _lane(trace: Trace, track: Track, lane: list[tuple[Span, Task]]) -> Iterator[Event]:
    for span, task in lane:
        yield from _task(trace, track, span, task)


def _task(trace: Trace, track: Track, span: Span, task: Task) -> Iterator[Event]:
    begin = Event(span.start, False, track.uuid, Kind.BEGIN, task.name, "task", of_task(trace.run, task))
    return within(track, span, begin, _failures_and_kills(trace, track, span, task), _states(trace, track, span, task))


def _states(trace: Trace, track: Track, span: Span, task: Task) -> Iterator[Event]:
    """The states that it was in until its end."""
    stages: list[tuple[float, str]] = [(trace.nanoseconds(time), str(state)) for time, state in task.states]
    found = []
    for (start, state), (after, _) in pairwise([*stages, (span.last, "")]):
        end = min(after, span.last)
        if start < end:
            stage = Span(int(start), None if end == inf else int(end))
            found.append((stage, Event(stage.start, False, track.uuid, Kind.BEGIN, state, "state")))
    return slices(track, found)


def _failures_and_kills(trace: Trace, track: Track, span: Span, task: Task) -> list[Event]:
    raised = [(time, text) for time, text in task.became("failure") if text]
    news: list[tuple[float, str, Details]] = [
        (time, "failed", {"failure": text, "handled": went_on(trace.run, task, time)}) for time, text in raised
    ]
    kills = [(time, why) for time, why in task.became("killed") if why is not None]
    news += [(time, "killed", {"why": why, "by": task.was("killed_by", time) or None}) for time, why in kills]
    found = []
    for time, name, details in news:
        place = int(min(trace.nanoseconds(time), span.last))
        found.append(Event(place, False, track.uuid, Kind.INSTANT, name, "failure", details))
    return sorted(found, key=lambda event: event.time)
