"""The tracks of a trace.

Each depth of the task tree has a track, on which a task is a slice with its states inside. Each
module has a group of tracks: for handled and queued messages, waits of handlers, locks, and sent
messages.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import chain, count, groupby, pairwise, starmap
from math import inf
from operator import itemgetter
from typing import Any

from tca_tools.explain.waits import of_handler_wait
from tca_tools.export.trace.events import (
    Details,
    Event,
    Trace,
    TraceSpan,
    Track,
    in_lanes,
    in_order,
)
from tca_tools.journal.fates import run_continued, run_continued_after
from tca_tools.journal.records import Claim, HandlerWait, Handling, Message, Queueing, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import Moment, describe_moments
from tca_wire.text.bodies import plain_data
from tca_wire.vocabulary import Outcome

# --- the details that the page shows of an event --------------------------------------------------


def of_message(run: Run, message: Message) -> Details:
    """Return the details of a message."""
    parent = message.parent if isinstance(message, Task) else 0
    return {
        "id": message.id,
        "class": str(message.message_class),
        "sender": message.sender,
        "parent": run.describe(parent) if parent else None,
        "role": str(message.role) or None,
        "about": run.describe(message.about) if message.about else None,
        "data": plain_data(message.body),
        "dropped": message.dropped or None,
    }


def of_task(run: Run, task: Task) -> Details:
    """Return the details of a task at its end."""
    return of_message(run, task) | {
        "state": str(task.state),
        "failure": task.failure or None,
        "killed": task.killed,
        "killed by": task.killed_by or None,
        "result": plain_data(task.result),
        "failure data": plain_data(task.failure_data),
    }


def of_handling(run: Run, handling: Handling) -> Details:
    """Return the details of a handling; a message's last one also has the message's results."""
    message = run.messages.get(handling.message_id)
    details: Details = of_message(run, message) if message else {}
    details["outcome"] = handling.outcome and str(handling.outcome)
    if message and message.handlings and message.handlings[-1] is handling:
        details |= {
            "result": plain_data(message.result),
            "failure data": plain_data(message.failure_data),
        }
    return details


def of_wait(run: Run, wait: HandlerWait) -> Details:
    """Return the details of a handler's wait."""
    return {
        "kind": str(of_handler_wait(run, wait).kind),
        "for": run.describe(wait.awaited),
        "until": ", ".join(describe_moments(wait.moment or 0)) or None,
    }


# --- modules --------------------------------------------------------------------------------------

Sent = dict[int | str, list[Message]]
"""The messages that were sent, by ``id()`` of the handling, or by module outside of handlers."""
Waits = list[tuple[TraceSpan, HandlerWait]]


def add_modules(trace: Trace) -> None:
    """Add a group for each module, for central if it sent anything, and for unhandled messages."""
    run, places = trace.run, _places(trace)
    sent: Sent = defaultdict(list)
    for message in run.messages.values():
        sent[id(message.by) if message.by else message.sender].append(message)
    outside = [name for name in sent if isinstance(name, str)]
    for name in dict.fromkeys([*run.modules, *outside, *(module for module, _ in places)]):
        group = trace.add(name or "(no handler)")
        group.events = _connection_slices(group)
        resources = [resource for module, resource in places if module == name]
        ranks = count(1)
        for resource in sorted(resources, key=lambda resource: resource not in ("", name)):
            places[name, resource].add_to(group, ranks, resource or name or "messages", sent)
        _add_outside(group, next(ranks), sent.get(name, []))


def _places(trace: Trace) -> "dict[tuple[str, str], _Place]":
    """Return the resources of the run, by module and resource."""
    places: dict[tuple[str, str], _Place] = defaultdict(_Place)
    for module in trace.run.modules.values():
        for resource in module.resources:
            places[module.name, resource]  # creates it, even if it stays empty
    for handling in trace.run.handlings:
        span = trace.span(handling.start, handling.end)
        places[handling.module, handling.resource].handlings.append((span, handling))
    for queueing in trace.run.queueings:
        span = trace.span(queueing.start, queueing.end)
        places[queueing.module, queueing.resource].queueings.append((span, queueing))
    for claim in trace.run.claims.values():
        if claim.granted is not None:
            span = trace.span(claim.granted, claim.end)
            places[claim.module, claim.resource].claims.append((span, claim))
    return places


class _Place:
    """A resource: its handlings, queue and claims."""

    def __init__(self) -> None:
        self.handlings: list[tuple[TraceSpan, Handling]] = []
        self.queueings: list[tuple[TraceSpan, Queueing]] = []
        self.claims: list[tuple[TraceSpan, Claim]] = []

    def add_to(self, group: Track, ranks: Iterator[int], name: str, sent: Sent) -> None:
        """Add tracks for handlings, overlapping waits, claims, the queue and its length."""
        trace, rank = group.trace, next(ranks)
        further: Waits = []
        for lane in in_lanes(self.handlings):
            track = trace.add(name, group, rank)
            slices = []
            for span, handling in lane:
                first, *others = in_lanes(_waits(trace, span, handling)) or [[]]
                further += chain.from_iterable(others)
                slices.append(_handling(track, span, handling, first, sent.get(id(handling), [])))
            track.events = chain.from_iterable(slices)
        _add_lanes(group, next(ranks), f"further waits of {name}", further, _wait_slice)
        _add_lanes(group, next(ranks), f"locks of {name}", self.claims, _claim_slice)
        if self.queueings:
            length = trace.add(f"queue length of {name}", group, next(ranks), is_counter=True)
            length.events = length.counter([span for span, _ in self.queueings])
        _add_lanes(group, next(ranks), f"queue of {name}", self.queueings, _queue_slice)


Begin = Callable[[Track, TraceSpan, Any], Event]


def _add_lanes(
    group: Track, rank: int, name: str, spans: Iterable[tuple[TraceSpan, Any]], begin: Begin
) -> None:
    """Add as many tracks of one name as the spans need."""
    for lane in in_lanes(spans):
        track = group.trace.add(name, group, rank)
        track.events = _slices(track, lane, begin)


def _slices(track: Track, spans: Iterable[tuple[TraceSpan, Any]], begin: Begin) -> Iterator[Event]:
    return track.slices((span, begin(track, span, thing)) for span, thing in spans)


def _handling(
    track: Track, span: TraceSpan, handling: Handling, waits: Waits, sent: list[Message]
) -> Iterator[Event]:
    """Yield a handling with its waits, its sent messages, and its failure."""
    run = track.trace.run
    flow = _flow(run.messages.get(handling.message_id), handling.delivery)
    outer = track.begin(span, handling.name, "handling", of_handling(run, handling), flow)
    failed = []
    if handling.outcome is Outcome.FAILED and span.end is not None:
        failed = [track.instant(span.end, "failed", "failure", _failure(run, handling))]
    yield from track.within(
        span, outer, _sending(track, sent), failed, _slices(track, waits, _wait_slice)
    )


def _failure(run: Run, handling: Handling) -> Details:
    """Return the details of the failure at the end of a handling."""
    message = run.messages.get(handling.message_id)
    end = handling.until
    failure = (
        message.value_at("failure", end)
        if message and message.written_at("failure", end) == end
        else None
    )
    return {"failure": failure, "handled": run_continued_after(run, handling)}


def _waits(trace: Trace, around: TraceSpan, handling: Handling) -> Waits:
    """Return the waits of a handler, cut at its end."""
    spans = [(trace.span(wait.start, wait.end), wait) for wait in handling.waits]
    if around.end is None:
        return spans
    last = around.end
    return [
        (TraceSpan(min(span.start, last), int(min(span.last, last))), wait) for span, wait in spans
    ]


def _flow(message: Message | None, delivery: int = 0) -> int:
    """Return the number of the arrow to a handling or a wait in a queue; 0 for none.

    A message has one arrow through all its handlings and waits; a copy of a broadcast has its own.
    """
    if message is None:
        return 0
    return delivery if message.message_class.fans_out else message.id


def _sending(track: Track, messages: Iterable[Message]) -> Iterator[Event]:
    """Yield an event for each instant at which messages were sent."""
    for time, group in groupby(
        messages, key=lambda message: track.trace.nanoseconds(message.received)
    ):
        sent = list(group)
        flows = [
            flow
            for message in sent
            for flow in dict.fromkeys(_flow(message, one.delivery) for one in message.handlings)
        ]
        flows += [message.id for message in sent if message.queueings and not message.handlings]
        if len(sent) == 1:
            name, details = sent[0].name, of_message(track.trace.run, sent[0])
        else:
            name = f"{len(sent)} messages"
            details = {"messages": [str(message) for message in sent]}
        yield track.instant(time, f"sends {name}", "sent", details, flows)


def _add_outside(group: Track, rank: int, sent: list[Message]) -> None:
    """Add the waits and sent messages of a module outside of its handlers."""
    trace = group.trace
    module = trace.run.modules.get(group.name)
    waits = [(trace.span(wait.start, wait.end), wait) for wait in module.waits] if module else []
    for lane in in_lanes(waits) or ([[]] if sent else []):
        track = trace.add("outside of handlers" if module else "sent", group, rank)
        track.events = in_order(_sending(track, sent), _slices(track, lane, _wait_slice))
        sent = []


def _connection_slices(group: Track) -> Iterator[Event]:
    """Yield the spans in which a module was connected, for the track of its group."""
    module = group.trace.run.modules.get(group.name)
    spans = [group.trace.span(start, end) for start, end in module.joined] if module else []
    return group.slices((span, group.begin(span, "connected", "module")) for span in spans)


def _wait_slice(track: Track, span: TraceSpan, wait: HandlerWait) -> Event:
    run = track.trace.run
    name = "a lock" if wait.awaited in run.claims else run.name(wait.awaited)
    return track.begin(span, f"waits for {name}", "waiting", of_wait(run, wait))


def _queue_slice(track: Track, span: TraceSpan, queueing: Queueing) -> Event:
    run, number = track.trace.run, queueing.message_id
    return track.begin(
        span, run.name(number), "queued", {"id": number}, _flow(run.messages.get(number))
    )


def _claim_slice(track: Track, span: TraceSpan, claim: Claim) -> Event:
    name = f"{'reserved' if claim.is_reserved else 'locked'} by {claim.sender}"
    return track.begin(span, name, "lock", {"id": claim.id, "ended": claim.ended or None})


# --- the task tree --------------------------------------------------------------------------------

_DEEPEST = 12
"""The greatest depth with a track of its own; deeper tasks share the last one."""


def add_task_tree(trace: Trace) -> None:
    """Add tracks for all tasks, top-level ones first; a slice goes from sending to the end."""
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
    return track.within(span, outer, _instants(track, span, task), _states(track, span, task))


def _states(track: Track, span: TraceSpan, task: Task) -> Iterator[Event]:
    """Yield the states of a task until its end."""
    stages: list[tuple[float, str]] = [
        (track.trace.nanoseconds(time), str(state)) for time, state in task.states
    ]
    stages_with_events = []
    for (start, state), (after, _) in pairwise([*stages, (span.last, "")]):
        end = min(after, span.last)
        if start < end:
            stage = TraceSpan(int(start), None if end == inf else int(end))
            stages_with_events.append((stage, track.begin(stage, state, "state")))
    return track.slices(stages_with_events)


def _instants(track: Track, span: TraceSpan, task: Task) -> list[Event]:
    """Return the events of a task: failures, kills, and changes of its state."""
    trace = track.trace
    instants: list[tuple[float, str, str, Details]] = [
        (
            time,
            "failed",
            "failure",
            {"failure": text, "handled": run_continued(trace.run, task, time)},
        )
        for time, text in task.failures
    ]
    instants += [
        (time, "killed", "failure", {"why": why, "by": task.value_at("killed_by", time) or None})
        for time, why in task.new_values("killed")
        if why is not None
    ]
    for change in task.life:
        details: Details = {
            "state": change.state,
            "by": change.module or str(change.by),
            "why": change.text or None,
            "data": plain_data(change.body),
        }
        instants.append((change.time, change.transition, "change", details))
    return [
        track.instant(int(min(trace.nanoseconds(time), span.last)), name, category, details)
        for time, name, category, details in sorted(instants, key=itemgetter(0))
    ]
