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

from tca_tools.analysis import advice_words as words
from tca_tools.analysis.advice_words import Words
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import CriticalPath
from tca_tools.analysis.long_waits import is_in_vain
from tca_tools.analysis.resources import kept_out
from tca_tools.analysis.step_words import queueing_before
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.journal.records import Claim
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.text.facts_in_words import called, place


class Before(NamedTuple):
    """The wait that was over when a step began."""

    words: Words
    """The words for waits of its kind."""
    name: str
    """The resource, or the message that was asked."""
    start: float
    end: float
    claim: Claim | None = None
    """The lock or reservation on the resource in whose queue it stood."""

    @property
    def seconds(self) -> float:
        """How long."""
        return self.end - self.start


@dataclass(slots=True)
class HeldUp:
    """All waits of one kind and name on a path."""

    waits: list[tuple[Before, PathStep]]
    """Each with the step that began after it."""
    seconds: float
    """How long the path's steps waited so; where waits overlap, once."""
    saving: float
    """By so many seconds at most the end would come sooner, had there been no such wait."""


def held_up(run: Run, causes: Causes, path: CriticalPath, window: Span, at_least: float) -> Iterator[HeldUp]:
    """The waits before the steps of a path, where they took *at_least* so many seconds in a window."""
    found: dict[tuple[Words, str], list[tuple[Before, PathStep]]] = {}
    for step in path.steps:
        if before := _before(run, step):
            found.setdefault((before.words, before.name), []).append((before, step))
    for alike in found.values():
        seconds = Cover((before.start, before.end) for before, _ in alike).within(*window)
        if seconds >= at_least:
            left_out = Cover(_left_out(run, causes, alike[-1][1]))
            yield HeldUp(alike, seconds, left_out.within(*window))


def _before(run: Run, step: PathStep) -> Before | None:
    """The wait of a step in a queue, or of its handler for a reply or a lock; None if it was neither."""
    message = run.messages.get(step.message_id)
    if message and (queueing := queueing_before(run, step)):
        module, resource = queueing.module, queueing.resource
        span = queueing.start, step.start
        locked, holder = kept_out(run, (module, resource), *span, sender=message.sender)
        if locked * 2 > span[1] - span[0]:
            return Before(words.LOCK, place(called(module), resource), *span, holder)
        return Before(words.QUEUE, place(module, resource), *span) if module else None
    wait = step.resumed
    if wait is None or wait.moment or not wait.awaited or step.doing is not Doing.WORK:
        return None
    if message is None or message.message_class.has_reply:
        return None  # the questions that a reply needs itself are part of the wait for it
    said, span = words.REPLY, (wait.start, step.start)
    if (wanted := run.claims.get(wait.awaited)) is not None:
        name = place(called(wanted.module), wanted.resource)
        locked, _ = kept_out(run, (wanted.module, wanted.resource), *span, but=wanted)
        said = words.LOCK if locked * 2 > span[1] - span[0] else words.CLAIM
        return Before(said, name, *span)
    if is_in_vain(run, wait):
        said = words.IN_VAIN
    return Before(said, run.name(wait.awaited), *span)


def _left_out(run: Run, causes: Causes, last: PathStep) -> Iterator[Span]:
    """The spans that a walk back from the last step leaves out: waits like the one before it."""
    like = _before(run, last)

    def since(step: PathStep) -> float | None:
        found = _before(run, step)
        return found.start if found and like and found[:2] == like[:2] else None

    yield from _not_unhandled(run, last)
    for step in causes.back_before(last, since):
        if since(step) is not None:
            yield from _not_unhandled(run, step)


def _not_unhandled(run: Run, step: PathStep) -> Iterator[Span]:
    """The wait before a step, without the time in which nobody handled what was asked: that is told of elsewhere."""
    if (before := _before(run, step)) is None:
        return
    asked = run.messages.get(step.resumed.awaited) if step.resumed else None
    since = before.start
    for queueing in asked.queueings if asked else ():
        if not queueing.module and queueing.until <= before.end:
            yield since, max(queueing.start, since)
            since = max(queueing.until, since)
    yield since, before.end
