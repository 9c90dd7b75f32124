"""Modules as groups of tracks: what each resource handled, waited for, kept waiting, and what was sent. Pure."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import chain, count, groupby
from typing import Any

from tca_tools.export.trace.details import flow_through, flow_to, flows_from, of_handling, of_message, of_wait
from tca_tools.export.trace.events import Event, Kind, Trace, Track, counter, in_order, slices, within
from tca_tools.export.trace.lanes import Span, in_lanes, nested
from tca_tools.run.fates import has_coped
from tca_tools.run.records import Claim, HandlerWait, Handling, Message, Queueing
from tca_wire.vocabulary import Outcome

_NO_HANDLER = "(no handler)"
_OUTSIDE = "outside of handlers"


def add_modules(trace: Trace) -> None:
    """A group for every module, for central if it sent anything, and for what nobody handles."""
    sent = _Sent(trace)
    places = _places(trace)
    for name in dict.fromkeys([*trace.run.modules, *sent.outside, *(module for module, _ in places)]):
        group = trace.add(name or _NO_HANDLER)
        group.events = _connected(trace, group)
        resources = [resource for module, resource in places if module == name]
        ranks = count(1)
        for resource in sorted(resources, key=lambda resource: resource not in ("", name)):
            places[name, resource].add_to(trace, group, ranks, resource or name or "messages", sent)
        _add_outside(trace, group, next(ranks), sent.outside.get(name, []))


class _Sent:
    """Who sent what: by the handling that sent it (its identity), or by module where that is not known."""

    def __init__(self, trace: Trace) -> None:
        self.by_handling: dict[int, list[Message]] = defaultdict(list)
        self.outside: dict[str, list[Message]] = defaultdict(list)
        deliveries: dict[int, list[Handling]] = defaultdict(list)
        for handling in trace.run.handlings:
            deliveries[handling.delivery].append(handling)
        for message in trace.run.messages.values():
            runs = deliveries.get(message.origin, []) if message.origin else []
            going_on = [run for run in runs if run.start <= message.received and _lasts_until(run, message.received)]
            if going_on:
                self.by_handling[id(going_on[-1])].append(message)
            else:
                self.outside[message.sender].append(message)


def _lasts_until(handling: Handling, time: float) -> bool:
    return handling.end is None or time <= handling.end


class _Place:
    """A resource: what happened in it and before it."""

    def __init__(self) -> None:
        self.handlings: list[Handling] = []
        self.queueings: list[Queueing] = []
        self.claims: list[Claim] = []

    def add_to(self, trace: Trace, group: Track, ranks: Iterator[int], name: str, sent: _Sent) -> None:
        """Tracks for handlings, waits that overlap, claims, the queue and its length."""
        handled = [(trace.span(handling.start, handling.end), handling) for handling in self.handlings]
        rank, further = next(ranks), []
        for lane in in_lanes(handled):
            track = trace.add(name, group, rank)
            runs = []
            for span, handling in lane:
                fitting, others = nested(_waits(trace, span, handling))
                further += others
                runs.append(_run(trace, track, span, handling, fitting, sent.by_handling.get(id(handling), [])))
            track.events = chain.from_iterable(runs)
        _add_lanes(trace, group, next(ranks), f"further waits of {name}", further, _waiting)
        _add_lanes(trace, group, next(ranks), f"locks of {name}", self._granted(trace), _claimed)
        queued = [(trace.span(queueing.start, queueing.end), queueing) for queueing in self.queueings]
        if queued:
            length = trace.add(f"queue length of {name}", group, next(ranks), is_counter=True)
            length.events = counter(length, [span for span, _ in queued])
        _add_lanes(trace, group, next(ranks), f"queue of {name}", queued, _queued)

    def _granted(self, trace: Trace) -> list[tuple[Span, Claim]]:
        return [(trace.span(claim.granted, claim.end), claim) for claim in self.claims if claim.granted is not None]


def _places(trace: Trace) -> dict[tuple[str, str], _Place]:
    """By module and resource."""
    places: dict[tuple[str, str], _Place] = defaultdict(_Place)
    for module in trace.run.modules.values():
        for resource in module.resources:
            places[module.name, resource]  # its row is there, if empty
    for handling in trace.run.handlings:
        places[handling.module, handling.resource].handlings.append(handling)
    for queueing in trace.run.queueings:
        places[queueing.module, queueing.resource].queueings.append(queueing)
    for claim in trace.run.claims.values():
        places[claim.module, claim.resource].claims.append(claim)
    return places


def _add_lanes(trace: Trace, group: Track, rank: int, name: str, spans: Iterable[tuple[Span, Any]], begin: Any) -> None:
    """As many tracks of one name as it takes."""
    for lane in in_lanes(spans):
        track = trace.add(name, group, rank)
        track.events = slices(track, _begun(trace, track, lane, begin))


def _begun(trace: Trace, track: Track, spans: Iterable[tuple[Span, Any]], begin: Any) -> Iterator[tuple[Span, Event]]:
    return ((span, begin(trace, track, span, thing)) for span, thing in spans)


def _run(
    trace: Trace,
    track: Track,
    span: Span,
    handling: Handling,
    waits: list[tuple[Span, HandlerWait]],
    sent: list[Message],
) -> Iterator[Event]:
    """A handling with its waits, what it sent, and its failure."""
    details, flows = of_handling(trace.run, handling), flow_to(trace.run, handling)
    begin = Event(span.start, True, track.uuid, Kind.BEGIN, handling.name, "handling", details, flows)
    failed = []
    if handling.outcome is Outcome.FAILED and span.end is not None:
        failed = [Event(span.end, False, track.uuid, Kind.INSTANT, "failed", "failure", _failure(trace, handling))]
    waiting = slices(track, _begun(trace, track, waits, _waiting))
    yield from within(track, span, begin, _sending(trace, track, sent), failed, waiting)


def _failure(trace: Trace, handling: Handling) -> dict[str, Any]:
    """The failure that was raised when a handling ended."""
    message = trace.run.messages.get(handling.message_id)
    texts = [text for time, text in message.became("failure") if time == handling.end] if message else []
    return {"failure": texts[-1] if texts else None, "handled": has_coped(trace.run, handling)}


def _waits(trace: Trace, around: Span, handling: Handling) -> list[tuple[Span, HandlerWait]]:
    """The waits of a handler, none longer than itself."""
    spans = [(trace.span(wait.start, wait.end), wait) for wait in handling.waits]
    if around.end is None:
        return spans
    last = around.end
    return [(Span(min(start, last), int(min(span.last, last))), wait) for span, wait in spans for start in [span.start]]


def _sending(trace: Trace, track: Track, messages: Iterable[Message]) -> Iterator[Event]:
    """Where messages were sent; those of one moment are one event."""
    for time, group in groupby(messages, key=lambda message: trace.nanoseconds(message.received)):
        sent = list(group)
        flows = [flow for message in sent for flow in flows_from(message)]
        what = sent[0].name if len(sent) == 1 else f"{len(sent)} messages"
        details = of_message(trace.run, sent[0]) if len(sent) == 1 else {"messages": [str(one) for one in sent]}
        yield Event(time, False, track.uuid, Kind.INSTANT, f"sends {what}", "sent", details, flows)


def _add_outside(trace: Trace, group: Track, rank: int, sent: list[Message]) -> None:
    """What a module did while none of its handlers ran."""
    module = trace.run.modules.get(group.name)
    waits = [(trace.span(wait.start, wait.end), wait) for wait in module.waits] if module else []
    lanes = in_lanes(waits) or ([[]] if sent else [])
    for number, lane in enumerate(lanes):
        track = trace.add(_OUTSIDE if module else "sent", group, rank)
        waiting = slices(track, _begun(trace, track, lane, _waiting))
        track.events = in_order(_sending(trace, track, sent), waiting) if number == 0 else waiting


def _connected(trace: Trace, group: Track) -> Iterator[Event]:
    """From when until when a module was connected, on the line of its group."""
    module = trace.run.modules.get(group.name)
    spans = [trace.span(start, end) for start, end in module.joined] if module else []
    begun = [(span, Event(span.start, False, group.uuid, Kind.BEGIN, "connected", "module")) for span in spans]
    return slices(group, begun)


def _waiting(trace: Trace, track: Track, span: Span, wait: HandlerWait) -> Event:
    what = "a lock" if wait.awaited in trace.run.claims else trace.run.name(wait.awaited)
    details = of_wait(trace.run, wait)
    return Event(span.start, False, track.uuid, Kind.BEGIN, f"waits for {what}", "waiting", details)


def _queued(trace: Trace, track: Track, span: Span, queueing: Queueing) -> Event:
    name, flows = trace.run.name(queueing.message_id), flow_through(trace.run, queueing.message_id)
    return Event(span.start, True, track.uuid, Kind.BEGIN, name, "queued", {"id": queueing.message_id}, flows)


def _claimed(_trace: Trace, track: Track, span: Span, claim: Claim) -> Event:
    name = f"{'reserved' if claim.is_reserved else 'locked'} by {claim.sender}"
    details = {"id": claim.id, "ended": claim.ended or None}
    return Event(span.start, False, track.uuid, Kind.BEGIN, name, "lock", details)
