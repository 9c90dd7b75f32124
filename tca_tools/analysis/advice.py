"""Advice on making a run shorter, and by how much at most: from the critical path and from idle
resources. Pure.

Each piece of advice has a bound of its own. They may be about the same seconds, so bounds must not
be added up.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from tca_tools.analysis import advice_words as words
from tca_tools.analysis.advice_words import Advice, Topic, Words
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import Overlap, why_held
from tca_tools.analysis.critical_path import CriticalPath
from tca_tools.analysis.failures import FailureKind
from tca_tools.analysis.long_waits import is_in_vain
from tca_tools.analysis.resources import Growing, Use, growing, kept_out
from tca_tools.analysis.step_words import queueing_before, still_handled, waited
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.analysis.summary import span_of
from tca_tools.journal.fates import GOOD_FATES
from tca_tools.journal.records import Claim
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.text.facts_in_words import by_whom, called, place
from tca_wire.text.measures import duration, listed, percent, run_time

_NOTHING = 1e-9
"""Smaller savings are no advice."""


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


def advice(
    run: Run,
    causes: Causes,
    path: CriticalPath | None,
    overlaps: list[Overlap],
    uses: list[Use],
    kinds: list[FailureKind],
    at_least: float,
    other: CriticalPath | None = None,
) -> list[Advice]:
    """All advice that bears on at least so many seconds: first what shortens the critical path
    most, then what lies beside it, or would only shorten *other*, the path of another task. No
    bound is more than the run is long, and none of what lies on a path more than that is.
    """
    handling, least = span_of(run), max(at_least, _NOTHING)
    found = [_on_overlap(run, path, overlap) for overlap in overlaps]
    found += _on_standing(run, path, handling)
    on_path: list[Advice] = []
    for one in filter(None, (path, other)):
        window = max(one.start, handling[0]), min(one.end, handling[1])
        called = f"critical path of {one.task}" if other else "critical path"
        told = [*_on_failures(one, kinds, window, called)]
        told += _on_waits(run, _held_up(run, causes, one, window, least), one, window, uses, called)
        told = [new for new in told if new.saving >= least]
        if one is not path:
            known = {known.title for known in on_path}
            others = (new for new in told if new.title not in known)
            told = [replace(new, on_path=0.0, sooner=str(one.task)) for new in others]
        on_path += told
    queues = [_on_queue(queue, on_path, handling) for queue in growing(run, *handling)]
    titles = {queue.title for queue in queues}
    found += queues + [one for one in on_path if one.title not in titles]
    found = [one for one in found if one.saving >= least]
    return sorted(found, key=lambda one: (-one.on_path, -one.saving))


def _of_spans(
    said: Words,
    spans: list[Span],
    window: Span,
    told: list[str],
    on_path: float | None = None,
    **known: str,
) -> Advice:
    """Advice about what took some spans of a window, where they overlap once; *told* describes
    each.
    """
    saving = Cover(spans).within(*window)
    longest = max(range(len(spans)), key=lambda place: spans[place][1] - spans[place][0])
    moves_end = saving if on_path is None else min(on_path, saving)
    known["seconds"] = duration(saving)
    example, span = told[longest], spans[longest]
    return said.filled(saving, moves_end, len(spans), example, span, **known)


# --- failures -------------------------------------------------------------------------------------


def _on_failures(
    path: CriticalPath, kinds: list[FailureKind], window: Span, called: str
) -> Iterator[Advice]:
    """The failures of a kind that were overcome, and whose handlers were on the path: what they
    took. A failure that ended something made the run shorter.
    """
    ends = {(step.message_id, step.end) for step in path.steps}
    for kind in kinds:
        spans, told = list[Span](), list[str]()
        for case in kind.cases:
            if case.fate in GOOD_FATES and (case.message_id, case.time) in ends:
                text = f"{case.of}, at {run_time(case.time)}, {duration(case.cost)}"
                told.append(f"{text}: {case.text}" if case.text else text)
                spans.append(case.span)
        failure, message = kind.failure, kind.message
        if spans:
            yield _of_spans(
                words.FAILED, spans, window, told, failure=failure, message=message, path=called
            )


# --- planning while acting ------------------------------------------------------------------------


def _on_overlap(run: Run, path: CriticalPath | None, overlap: Overlap) -> Advice:
    chance, chances = overlap.chances[0], overlap.chances
    on_path = {(id(step.handling), step.start) for step in path.steps} if path else set()
    saved_on_path = 0.0
    for one in chances:
        steps = (step for step in one.steps if (id(step.handling), step.start) in on_path)
        saved_on_path += min(one.saving, sum(step.seconds for step in steps))
    first, second = run.name(chance.first), run.name(chance.second)
    example = (
        f"{run_time(chance.start)} to {run_time(chance.end)}, between {run.describe(chance.first)} and "
        f"{run.describe(chance.second)}: {why_held(run, chance.held)}"
    )
    return words.OVERLAP.filled(
        overlap.saving,
        saved_on_path,
        len(chances),
        example,
        (chance.start, chance.end),
        acting=place(*chance.acting),
        remedy=overlap.remedy,
        pair=f"one '{first}' and the next" if first == second else f"'{first}' and '{second}'",
        seconds=duration(sum(one.end - one.start for one in chances)),
        planning=duration(sum(step.seconds for one in chances for step in one.steps)),
        planners=listed(
            list(dict.fromkeys(place(step.module, step.resource) for step in chance.steps))
        ),
    )


# --- queues that grow -----------------------------------------------------------------------------


def _on_queue(queue: Growing, on_path: list[Advice], run: Span) -> Advice:
    """A queue that only grows; instead of what there is to say of the waits in it that lie on the
    path.
    """
    name = place(*queue.key)
    title = words.QUEUE.title.format(name=name)
    waits = next((one for one in on_path if one.title == title), None)
    example = (
        f"the oldest of the queue had waited {duration(queue.longest)} at {run_time(queue.end)}"
    )
    longest = Cover([(queue.end - queue.longest, queue.end)]).within(*run)
    return words.GROWING.filled(
        max(longest, waits.saving if waits else 0.0),
        waits.on_path if waits else 0.0,
        queue.length,
        example,
        (queue.start, queue.end),
        name=name,
        rate_in=f"{queue.rate_in:.3g}",
        rate_out=f"{queue.rate_out:.3g}",
        start=run_time(queue.start),
        end=run_time(queue.end),
        length=f"{queue.length:,}",
        message=queue.message,
        drain=duration(queue.length / queue.rate_out),
        needed=f"{queue.needed:,}",
        capacity=f"{queue.capacity:,}",
    )


# --- waits on the critical path -------------------------------------------------------------------


def _on_waits(
    run: Run,
    held_up: Iterable[HeldUp],
    path: CriticalPath,
    window: Span,
    uses: list[Use],
    called: str,
) -> Iterator[Advice]:
    """Advice for each kind of wait that lies on a path within a window; *called* is what to call
    the path.
    """
    by_name = {use.name: use for use in uses}
    for held in held_up:
        yield _on_wait(run, held, by_name, window, called)
    delays: dict[str, list[PathStep]] = defaultdict(list)
    for step in path.steps:
        if step.doing is Doing.DELAY:
            delays[run.name(step.message_id)].append(step)
    for name, steps in delays.items():
        spans = [(step.start, step.end) for step in steps]
        told = [run.describe(step.message_id) for step in steps]
        yield _of_spans(words.DELAY, spans, window, told, name=name, path=called)


def _on_wait(run: Run, held: HeldUp, uses: dict[str, Use], window: Span, called: str) -> Advice:
    longest, step = max(held.waits, key=lambda wait: wait[0].seconds)
    saving, busy, but = held.saving, "", ""
    if longest.words is words.QUEUE and (use := uses.get(longest.name)):
        busy = f" It is busy {percent(use.share)} of the time, with {use.capacity} at a time."
        least = use.worked / (use.capacity + 1)
        rest = max(use.window[1] - use.window[0] - least, 0.0)
        if window[1] >= use.window[1] and saving > rest:
            saving = rest
            but = f": what it has to do would still take {duration(least)}"
    return longest.words.filled(
        saving,
        saving,
        len(held.waits),
        _longest(run, longest, step),
        (longest.start, longest.end),
        name=longest.name,
        seconds=duration(held.seconds),
        busy=busy,
        but=but,
        path=called,
        most="that" if duration(saving) == duration(held.seconds) else duration(saving),
    )


def _longest(run: Run, wait: Before, step: PathStep) -> str:
    """The longest of some waits, in words, with what is known of why."""
    asked = step.resumed.awaited if step.resumed else step.message_id
    told = f"{waited(run, step)}{',' * bool(step.resumed)} {duration(wait.seconds)}, until {run_time(wait.end)}"
    if wait.claim:
        told += f"; {wait.claim.sender} had {'it' if wait.claim.granted is not None else 'asked for it'}"
    return told + still_handled(run, asked, wait.end)


# --- standstills, on the critical path or beside it -----------------------------------------------


def _on_standing(run: Run, path: CriticalPath | None, window: Span) -> Iterator[Advice]:
    """Of messages that nobody handled, and of suspended tasks: how long at most one of a name
    stood.
    """
    on_path: dict[tuple[Topic, str], float] = defaultdict(float)
    for step in path.steps if path else ():
        if (topic := _STANDING.get(step.doing)) is not None:
            seconds = Cover([(step.start, step.end)]).within(*window)
            on_path[topic, run.name(step.message_id)] += seconds
    found: dict[tuple[Topic, str], list[tuple[Span, str]]] = defaultdict(list)
    for topic, number, (start, end), who in _stood(run):
        span = start, min(end, run.time)
        told = f"{run.describe(number)}{who}, from {run_time(start)}, {duration(span[1] - start)}"
        found[topic, run.name(number)].append((span, told))
    for (topic, name), alike in found.items():
        spans, texts = [span for span, _ in alike], [text for _, text in alike]
        said = words.SUSPENDED
        if topic is Topic.HANDLER:
            said = words.NOT_HANDLED if run.offers.get(name) else words.NEVER_HANDLED
        yield _of_spans(said, spans, window, texts, on_path[topic, name], name=name)


def _stood(run: Run) -> Iterator[tuple[Topic, int, Span, str]]:
    """The standstills: topic, message, start, end, and who suspended it."""
    for one in run.queueings:
        if not one.module:
            yield Topic.HANDLER, one.message_id, (one.start, one.until), ""
    for suspension in run.suspensions():
        if (since := suspension.standstill) is not None:
            whom = by_whom(suspension.by)
            who = f" suspended{whom}" if whom else ""
            yield Topic.SUSPENDED, suspension.task, (since, suspension.until), who


_STANDING = {Doing.NO_HANDLER: Topic.HANDLER, Doing.SUSPENDED: Topic.SUSPENDED}


# --- how often for what the critical path waits, and by how much sooner it could end --------------

# Waits in one queue overlap: who stands last in it waits for all the others, and no one can win
# more than his own wait. So the path is walked back once more, and wherever a step began after a
# wait of the kind that is looked at, the walk goes on not with what was waited for but with whoever
# began to wait, at the time when he did. All that this walk passes through had to happen before the
# end even if nobody had ever waited so; what it left out, and no more, could have been saved. The
# spans left out do not overlap, so they are never more than the path is long.


def _held_up(
    run: Run, causes: Causes, path: CriticalPath, window: Span, at_least: float
) -> Iterator[HeldUp]:
    """The waits before the steps of a path, where they took *at_least* so many seconds in a
    window.
    """
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
    """The wait of a step in a queue, or of its handler for a reply or a lock; None if it was
    neither.
    """
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
    """The wait before a step, without the time in which nobody handled what was asked: that is told
    of elsewhere.
    """
    if (before := _before(run, step)) is None:
        return
    asked = run.messages.get(step.resumed.awaited) if step.resumed else None
    since = before.start
    for queueing in asked.queueings if asked else ():
        if not queueing.module and queueing.until <= before.end:
            yield since, max(queueing.start, since)
            since = max(queueing.until, since)
    yield since, before.end
