"""Waits on a critical path: how often for what, and by how much sooner the end could come without them. Pure.

Method. Waits in one queue overlap: who stands last in it waits for all the others, and no one can win more than his own
wait. So the path is walked back once more, and wherever a step began after a wait of the kind that is looked at, the
walk goes on not with what was waited for but with whoever began to wait, at the time when he did. All that this walk
passes through had to happen before the end even if nobody had ever waited so; what it left out, and no more, could have
been saved. The spans left out do not overlap, so they are never more than the path is long.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import CriticalPath, queueing_before
from tca_tools.analysis.locks import Locks
from tca_tools.analysis.long_waits import is_in_vain
from tca_tools.analysis.steps import Doing, Step
from tca_tools.run.records import Claim, HandlerWait, Queueing
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.text.facts_in_words import called, place


class Reason(StrEnum):
    """What a step had to wait for."""

    QUEUE = "queue"  # a slot of a resource
    LOCK = "lock"  # the end of somebody's lock or reservation, or of his wait for it, most of the time
    CLAIM = "claim"  # a lock or reservation, until what was handled there was done
    REPLY = "reply"  # the reply to a query
    IN_VAIN = "in vain"  # the same, and it was given up


class Before(NamedTuple):
    """The wait that was over when a step began."""

    reason: Reason
    name: str
    """The resource, or the message that was asked."""
    start: float
    end: float
    claim: Claim | None = None
    """Who had the resource in whose queue it stood, locked or reserved."""
    queueing: Queueing | None = None
    """If it was a wait in a queue: that."""

    @property
    def key(self) -> tuple[Reason, str]:
        """What its like have in common."""
        return self.reason, self.name

    @property
    def seconds(self) -> float:
        """How long."""
        return self.end - self.start


@dataclass(slots=True)
class HeldUp:
    """All waits of one kind and name on a path."""

    reason: Reason
    name: str
    times: int
    seconds: float
    """How long the path's steps waited so; where waits overlap, once."""
    saving: float
    """By so many seconds at most the end would come sooner, had there been no such wait."""
    longest: Before
    step: Step
    """The step that began after the longest."""


def held_up(run: Run, causes: Causes, path: CriticalPath, window: Span, at_least: float) -> list[HeldUp]:
    """What the steps of a path waited for before they began, where it took *at_least* so many seconds in a window."""
    waits = _Waits(run)
    found: dict[tuple[Reason, str], list[tuple[Before, Step]]] = {}
    for step in path.steps:
        if (before := waits.before(step)) is not None:
            found.setdefault(before.key, []).append((before, step))
    told = []
    for (reason, name), alike in found.items():
        seconds = Cover((before.start, before.end) for before, _ in alike).within(*window)
        if seconds >= at_least:
            saving = _saving(waits, causes, alike[-1][1], window)
            longest, step = max(alike, key=lambda wait: wait[0].seconds)
            told.append(HeldUp(reason, name, len(alike), seconds, saving, longest, step))
    return told


class _Waits:
    """What the steps of a run had waited for."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self._locks = Locks(run)

    def before(self, step: Step) -> Before | None:
        """What a step had waited for in a queue, or its handler for a reply or a lock; None if it was neither."""
        if (queueing := queueing_before(self.run, step)) is not None:
            return self._in_queue(queueing, step) if queueing.module else None
        wait, asker = step.resumed, self.run.messages.get(step.message_id)
        if wait is None or wait.moment or asker is None or step.doing is not Doing.WORK:
            return None
        if asker.message_class.has_reply:
            return None  # the questions that a reply needs itself are part of the wait for it
        if (wanted := self.run.claims.get(wait.awaited)) is not None:
            return self._of_claim(wanted, wait, step)
        reason = Reason.IN_VAIN if is_in_vain(self.run, wait) else Reason.REPLY
        return Before(reason, self.run.name(wait.awaited), wait.start, step.start)

    def _in_queue(self, queueing: Queueing, step: Step) -> Before:
        where, start, end = (queueing.module, queueing.resource), queueing.start, step.start
        message = self.run.messages.get(queueing.message_id)
        locked = self._locks.kept_out(*where, message.sender if message else "", start, end)
        if locked * 2 <= end - start:
            return Before(Reason.QUEUE, place(*where), start, end, queueing=queueing)
        holder = self._locks.last_before(*where, end)
        return Before(Reason.LOCK, place(called(where[0]), where[1]), start, end, holder, queueing)

    def _of_claim(self, wanted: Claim, wait: HandlerWait, step: Step) -> Before:
        by_others = self._locks.ahead_of(wanted, step.start)
        reason = Reason.LOCK if by_others * 2 > step.start - wait.start else Reason.CLAIM
        return Before(reason, place(called(wanted.module), wanted.resource), wait.start, step.start)


def _saving(waits: _Waits, causes: Causes, last: Step, window: Span) -> float:
    """What a walk back from the last of the steps leaves out, in seconds of the window."""
    left_out = Cover(span for step in _without(waits, causes, last) for span in _not_unhandled(waits, step))
    return left_out.within(*window)


def _without(waits: _Waits, causes: Causes, last: Step) -> Iterator[Step]:
    """The steps before which a walk leaves out a wait such as the one before *last*; the newest first."""
    key = before.key if (before := waits.before(last)) else None

    def since(step: Step) -> float | None:
        found = waits.before(step)
        return found.start if found is not None and found.key == key else None

    yield last
    for step in causes.back_before(last, since):
        if since(step) is not None:
            yield step


def _not_unhandled(waits: _Waits, step: Step) -> Iterator[Span]:
    """The wait before a step, without the time in which nobody handled what was asked: that is told of elsewhere."""
    if (before := waits.before(step)) is None:
        return
    is_asked = step.resumed is not None and before.reason in (Reason.REPLY, Reason.IN_VAIN)
    asked = waits.run.messages.get(step.resumed.awaited) if step.resumed and is_asked else None
    since = before.start
    for queueing in asked.queueings if asked else ():
        if not queueing.module and queueing.end is not None and queueing.end <= before.end:
            yield since, max(queueing.start, since)
            since = max(queueing.end, since)
    yield since, before.end
