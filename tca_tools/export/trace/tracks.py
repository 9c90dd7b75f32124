"""Modules as groups of tracks: what each resource handled, waited for, kept waiting, and what was sent. Pure."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, count, groupby
from typing import Any

from tca_tools.export.trace.details import of_handling, of_message, of_wait
from tca_tools.export.trace.events import Details, Event, Trace, TraceSpan, Track, in_lanes, in_order
from tca_tools.journal.fates import has_coped
from tca_tools.journal.records import Claim, HandlerWait, Handling, Message, Queueing
from tca_tools.journal.whole_run import Run
from tca_wire.vocabulary import Outcome

Sent = dict[int | str, list[Message]]
"""The messages sent by each handling (by its identity), or by each module where the handling is not known."""
Waits = list[tuple[TraceSpan, HandlerWait]]


def add_modules(trace: Trace) -> None:
    """A group for every module, for central if it sent anything, and for what nobody handles."""
    run, places = trace.run, _places(trace)
    sent: Sent = defaultdict(list)
    for message in run.messages.values():
        sent[id(message.by) if message.by else message.sender].append(message)
    outside = [name for name in sent if isinstance(name, str)]
    for name in dict.fromkeys([*run.modules, *outside, *(module for module, _ in places)]):
        group = trace.add(name or "(no handler)")
        group.events = _connected(group)
        resources = [resource for module, resource in places if module == name]
        ranks = count(1)
        for resource in sorted(resources, key=lambda resource: resource not in ("", name)):
            places[name, resource].add_to(group, ranks, resource or name or "messages", sent)
        _add_outside(group, next(ranks), sent.get(name, []))


def _places(trace: Trace) -> "dict[tuple[str, str], _Place]":
    """By module and resource."""
    places: dict[tuple[str, str], _Place] = defaultdict(_Place)
    for module in trace.run.modules.values():
        for resource in module.resources:
            places[module.name, resource]  # its row is there, if empty
    for run in trace.run.handlings:
        places[run.module, run.resource].handlings.append((trace.span(run.start, run.end), run))
    for wait in trace.run.queueings:
        places[wait.module, wait.resource].queueings.append((trace.span(wait.start, wait.end), wait))
    for claim in trace.run.claims.values():
        if claim.granted is not None:
            places[claim.module, claim.resource].claims.append((trace.span(claim.granted, claim.end), claim))
    return places


class _Place:
    """A resource: what happened in it and before it."""

    def __init__(self) -> None:
        self.handlings: list[tuple[TraceSpan, Handling]] = []
        self.queueings: list[tuple[TraceSpan, Queueing]] = []
        self.claims: list[tuple[TraceSpan, Claim]] = []

    def add_to(self, group: Track, ranks: Iterator[int], name: str, sent: Sent) -> None:
        """Tracks for handlings, waits that overlap, claims, the queue and its length."""
        trace, rank = group.trace, next(ranks)
        further: Waits = []
        for lane in in_lanes(self.handlings):
            track = trace.add(name, group, rank)
            runs = []
            for span, handling in lane:
                first, *others = in_lanes(_waits(trace, span, handling)) or [[]]
                further += chain.from_iterable(others)
                runs.append(_run(track, span, handling, first, sent.get(id(handling), [])))
            track.events = chain.from_iterable(runs)
        _add_lanes(group, next(ranks), f"further waits of {name}", further, _waiting)
        _add_lanes(group, next(ranks), f"locks of {name}", self.claims, _claimed)
        if self.queueings:
            length = trace.add(f"queue length of {name}", group, next(ranks), is_counter=True)
            length.events = length.counter([span for span, _ in self.queueings])
        _add_lanes(group, next(ranks), f"queue of {name}", self.queueings, _queued)


Begin = Callable[[Track, TraceSpan, Any], Event]


def _add_lanes(group: Track, rank: int, name: str, spans: Iterable[tuple[TraceSpan, Any]], of: Begin) -> None:
    """As many tracks of one name as it takes."""
    for lane in in_lanes(spans):
        track = group.trace.add(name, group, rank)
        track.events = _slices(track, lane, of)


def _slices(track: Track, spans: Iterable[tuple[TraceSpan, Any]], of: Begin) -> Iterator[Event]:
    return track.slices((span, of(track, span, thing)) for span, thing in spans)


def _run(track: Track, span: TraceSpan, handling: Handling, waits: Waits, sent: list[Message]) -> Iterator[Event]:
    """A handling with its waits, what it sent, and its failure."""
    run = track.trace.run
    flow = _flow(run.messages.get(handling.message_id), handling.delivery)
    outer = track.begin(span, handling.name, "handling", of_handling(run, handling), flow)
    failed = []
    if handling.outcome is Outcome.FAILED and span.end is not None:
        failed = [track.instant(span.end, "failed", "failure", _failure(run, handling))]
    yield from track.within(span, outer, _sending(track, sent), failed, _slices(track, waits, _waiting))


def _failure(run: Run, handling: Handling) -> Details:
    """The failure that was raised when a handling ended."""
    message = run.messages.get(handling.message_id)
    end = handling.until
    failure = message.was("failure", end) if message and message.written("failure", end) == end else None
    return {"failure": failure, "handled": has_coped(run, handling)}


def _waits(trace: Trace, around: TraceSpan, handling: Handling) -> Waits:
    """The waits of a handler, none longer than itself."""
    spans = [(trace.span(wait.start, wait.end), wait) for wait in handling.waits]
    if around.end is None:
        return spans
    last = around.end
    return [(TraceSpan(min(span.start, last), int(min(span.last, last))), wait) for span, wait in spans]


def _flow(message: Message | None, delivery: int = 0) -> int:
    """The arrow that leads to a handling or a wait in a queue: one along all stations of a message, but to each
    receiver of many one.
    """
    return 0 if message is None else delivery if message.message_class.fans_out else message.id


def _sending(track: Track, messages: Iterable[Message]) -> Iterator[Event]:
    """Where messages were sent; those of one moment are one event."""
    for time, group in groupby(messages, key=lambda message: track.trace.nanoseconds(message.received)):
        sent = list(group)
        flows = [flow for one in sent for flow in dict.fromkeys(_flow(one, run.delivery) for run in one.handlings)]
        flows += [one.id for one in sent if one.queueings and not one.handlings]
        what = sent[0].name if len(sent) == 1 else f"{len(sent)} messages"
        details = of_message(track.trace.run, sent[0]) if len(sent) == 1 else {"messages": [str(one) for one in sent]}
        yield track.instant(time, f"sends {what}", "sent", details, flows)


def _add_outside(group: Track, rank: int, sent: list[Message]) -> None:
    """Add the waits and messages of a module while none of its handlers ran."""
    trace = group.trace
    module = trace.run.modules.get(group.name)
    waits = [(trace.span(wait.start, wait.end), wait) for wait in module.waits] if module else []
    for lane in in_lanes(waits) or ([[]] if sent else []):
        track = trace.add("outside of handlers" if module else "sent", group, rank)
        track.events = in_order(_sending(track, sent), _slices(track, lane, _waiting))
        sent = []


def _connected(group: Track) -> Iterator[Event]:
    """From when until when a module was connected, on the line of its group."""
    module = group.trace.run.modules.get(group.name)
    spans = [group.trace.span(start, end) for start, end in module.joined] if module else []
    return group.slices((span, group.begin(span, "connected", "module")) for span in spans)


def _waiting(track: Track, span: TraceSpan, wait: HandlerWait) -> Event:
    run = track.trace.run
    what = "a lock" if wait.awaited in run.claims else run.name(wait.awaited)
    return track.begin(span, f"waits for {what}", "waiting", of_wait(run, wait))


def _queued(track: Track, span: TraceSpan, queueing: Queueing) -> Event:
    run, number = track.trace.run, queueing.message_id
    return track.begin(span, run.name(number), "queued", {"id": number}, _flow(run.messages.get(number)))


def _claimed(track: Track, span: TraceSpan, claim: Claim) -> Event:
    name = f"{'reserved' if claim.is_reserved else 'locked'} by {claim.sender}"
    return track.begin(span, name, "lock", {"id": claim.id, "ended": claim.ended or None})
