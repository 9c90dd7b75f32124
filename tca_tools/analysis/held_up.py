"""Waits on a critical path: how often for what, and by how much sooner the end could come without them. Pure.

Method. Waits in one queue overlap: who stands last in it waits for all the others, and no one can win more than his own
wait. So the path is walked back once more, and wherever a step began after a wait of the kind that is looked at, the
walk goes on not with what was waited for but with whoever began to wait, at the time when he did. All that this walk
passes through had to happen before the end even if nobody had ever waited so; what it left out, and no more, could have
been saved. The spans left out do not overlap, so they are never more than the path is long.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from tca_tools.analysis.causes import Causes, Doing, Step
from tca_tools.analysis.critical_path import CriticalPath, queueing_before
from tca_tools.analysis.spans import Cover, Span
from tca_tools.analysis.waits import WaitKind, locked_during
from tca_tools.past import Past
from tca_tools.records import Claim
from tca_wire.wording import place


class Before(NamedTuple):
    """The wait that was over when a step began."""

    kind: WaitKind
    """RESOURCE, LOCK or REPLY."""
    name: str
    """The resource, or the message that was asked."""
    start: float
    end: float
    claim: Claim | None = None
    """Who had the resource in whose queue it stood, locked or reserved."""

    @property
    def key(self) -> tuple[WaitKind, str]:
        """What its like have in common."""
        return self.kind, self.name

    @property
    def seconds(self) -> float:
        """How long."""
        return self.end - self.start


@dataclass(slots=True)
class HeldUp:
    """All waits of one kind and name on a path."""

    kind: WaitKind
    name: str
    times: int
    seconds: float
    """How long the path's steps waited so; where waits overlap, once."""
    saving: float
    """By so many seconds at most the end would come sooner, had there been no such wait."""
    longest: Before
    step: Step
    """The step that began after the longest."""


def held_up(past: Past, causes: Causes, path: CriticalPath, window: Span, at_least: float) -> list[HeldUp]:
    """What the steps of a path waited for before they began, where it took *at_least* so many seconds in a window."""
    found: dict[tuple[WaitKind, str], list[tuple[Before, Step]]] = {}
    for step in path.steps:
        if (before := waited_before(past, step)) is not None:
            found.setdefault(before.key, []).append((before, step))
    told = []
    for (kind, name), waits in found.items():
        seconds = Cover((before.start, before.end) for before, _ in waits).within(*window)
        if seconds >= at_least:
            saving = _saving(past, causes, waits[-1][1], window)
            longest, step = max(waits, key=lambda wait: wait[0].seconds)
            told.append(HeldUp(kind, name, len(waits), seconds, saving, longest, step))
    return told


def waited_before(past: Past, step: Step) -> Before | None:
    """What a step had waited for in a queue, or its handler for a reply or a lock; None if it was nothing of these."""
    if (queueing := queueing_before(past, step)) is not None:
        if not queueing.module:
            return None
        claim = locked_during(past, queueing.module, queueing.resource, queueing.start, queueing.end)
        kind = WaitKind.LOCK if claim else WaitKind.RESOURCE
        return Before(kind, place(queueing.module, queueing.resource), queueing.start, step.start, claim)
    wait, asker = step.resumed, past.messages.get(step.message_id)
    if wait is None or wait.moment or asker is None or asker.message_class.has_reply or step.doing is not Doing.WORK:
        return None  # the questions that a reply needs itself are part of the wait for it
    if (wanted := past.claims.get(wait.awaited)) is not None:
        return Before(WaitKind.LOCK, place(wanted.module, wanted.resource), wait.start, step.start)
    return Before(WaitKind.REPLY, past.name(wait.awaited), wait.start, step.start)


def _saving(past: Past, causes: Causes, last: Step, window: Span) -> float:
    """What a walk back from the last of the steps leaves out, in seconds of the window."""
    left_out = Cover(span for step in _without(past, causes, last) for span in _not_unhandled(past, step))
    return left_out.within(*window)


def _without(past: Past, causes: Causes, last: Step) -> Iterator[Step]:
    """The steps before which a walk leaves out a wait such as the one before *last*; the newest first."""
    key = before.key if (before := waited_before(past, last)) else None

    def since(step: Step) -> float | None:
        found = waited_before(past, step)
        return found.start if found is not None and found.key == key else None

    yield last
    for step in causes.back_before(last, since):
        if since(step) is not None:
            yield step


def _not_unhandled(past: Past, step: Step) -> Iterator[Span]:
    """The wait before a step, without the time in which nobody handled what was asked: that is told of elsewhere."""
    if (before := waited_before(past, step)) is None:
        return
    asked = past.messages.get(step.resumed.awaited) if step.resumed and before.kind is WaitKind.REPLY else None
    since = before.start
    for queueing in asked.queueings if asked else ():
        if not queueing.module and queueing.end is not None and queueing.end <= before.end:
            yield since, max(queueing.start, since)
            since = max(queueing.end, since)
    yield since, before.end
