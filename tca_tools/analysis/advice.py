"""Advice on making a run shorter, from the critical path and from idle resources. Pure.

Each piece of advice has its own bound: the most seconds that it could save. Two pieces may concern
the same seconds, so do not add their bounds up.
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
from tca_tools.analysis.resources import GrowingQueue, Use, growing_queues, locked_out
from tca_tools.analysis.step_words import queueing_before, still_handled, wait_in_words
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.analysis.summary import span_of
from tca_tools.journal.fates import GOOD_FATES
from tca_tools.journal.records import Claim
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.text.facts_in_words import by_whom, called, place
from tca_wire.text.measures import duration, listed, percent, run_time

_LEAST_SAVING = 1e-9
"""The least saving that is worth advice, in seconds."""


class PrecedingWait(NamedTuple):
    """The wait that ended when a step started."""

    words: Words
    """The templates of the advice on such a wait."""
    name: str
    """The awaited resource or query."""
    start: float
    end: float
    claim: Claim | None = None
    """The lock or reservation that blocked the queue of the resource."""

    @property
    def seconds(self) -> float:
        """The duration."""
        return self.end - self.start


@dataclass(slots=True)
class WaitGroup:
    """All waits of one kind and name on a path."""

    waits: list[tuple[PrecedingWait, PathStep]]
    """The waits, each with the step that started after it."""
    seconds: float
    """The duration of the waits; overlapping waits count once."""
    saving: float
    """The largest possible saving without these waits, in seconds."""


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
    """Return all advice, sorted by the saving on the critical path, then by the whole saving.

    The saving is at most the duration of the run, or of the path that the advice concerns.

    Args:
        run: The run.
        causes: The causes of the run's events.
        path: The critical path of the task that ended last.
        overlaps: The possible overlaps of planning and acting.
        uses: The uses of the resources.
        kinds: The failures by kind.
        at_least: The least saving of a piece of advice, in seconds.
        other: The critical path of another task. Advice from it ends only that task sooner.
    """
    window_of_run, least = span_of(run), max(at_least, _LEAST_SAVING)
    found = [_on_overlap(run, path, overlap) for overlap in overlaps]
    found += _on_standstills(run, path, window_of_run)
    path_advice: list[Advice] = []
    for one in filter(None, (path, other)):
        window = max(one.start, window_of_run[0]), min(one.end, window_of_run[1])
        name = f"critical path of {one.task}" if other else "critical path"
        groups = _wait_groups(run, causes, one, window, least)
        new = [*_on_failures(one, kinds, window, name)]
        new += _on_waits(run, groups, one, window, uses, name)
        new = [item for item in new if item.saving >= least]
        if one is not path:
            known = {item.title for item in path_advice}
            others = (item for item in new if item.title not in known)
            new = [replace(item, on_path=0.0, sooner=str(one.task)) for item in others]
        path_advice += new
    growing = growing_queues(run, *window_of_run)
    queues = [_on_queue(queue, path_advice, window_of_run) for queue in growing]
    titles = {queue.title for queue in queues}
    found += queues + [one for one in path_advice if one.title not in titles]
    found = [one for one in found if one.saving >= least]
    return sorted(found, key=lambda one: (-one.on_path, -one.saving))


def _advice_on_spans(
    template: Words,
    spans: list[Span],
    window: Span,
    descriptions: list[str],
    on_path: float | None = None,
    **known: str,
) -> Advice:
    """Return advice that could save the spans in a window; overlapping spans count once."""
    saving = Cover(spans).within(*window)
    longest = max(range(len(spans)), key=lambda place: spans[place][1] - spans[place][0])
    moves_end = saving if on_path is None else min(on_path, saving)
    known["seconds"] = duration(saving)
    example, span = descriptions[longest], spans[longest]
    return template.filled(saving, moves_end, len(spans), example, span, **known)


# --- failures -------------------------------------------------------------------------------------


def _on_failures(
    path: CriticalPath, kinds: list[FailureKind], window: Span, path_name: str
) -> Iterator[Advice]:
    """Yield advice on failures whose handlers were on the path and after which the run continued.

    A failure that ended something made the run shorter, so it does not count.
    """
    ends = {(step.message_id, step.end) for step in path.steps}
    for kind in kinds:
        spans, texts = list[Span](), list[str]()
        for case in kind.cases:
            if case.fate in GOOD_FATES and (case.message_id, case.time) in ends:
                text = f"{case.of}, at {run_time(case.time)}, {duration(case.cost)}"
                texts.append(f"{text}: {case.text}" if case.text else text)
                spans.append(case.span)
        failure, message = kind.failure, kind.message
        if spans:
            yield _advice_on_spans(
                words.FAILED, spans, window, texts, failure=failure, message=message, path=path_name
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
    commands = f"{run.describe(chance.first)} and {run.describe(chance.second)}"
    example = (
        f"{run_time(chance.start)} to {run_time(chance.end)}, between {commands}: "
        f"{why_held(run, chance.held)}"
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


def _on_queue(queue: GrowingQueue, path_advice: list[Advice], window: Span) -> Advice:
    """Return advice on a growing queue. It replaces the path's advice on waits in that queue."""
    name = place(*queue.key)
    title = words.QUEUE.title.format(name=name)
    waits = next((one for one in path_advice if one.title == title), None)
    example = (
        f"the oldest of the queue had waited {duration(queue.longest)} at {run_time(queue.end)}"
    )
    longest = Cover([(queue.end - queue.longest, queue.end)]).within(*window)
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
    groups: Iterable[WaitGroup],
    path: CriticalPath,
    window: Span,
    uses: list[Use],
    path_name: str,
) -> Iterator[Advice]:
    """Yield advice for each group of waits on a path, and for its delays."""
    by_name = {use.name: use for use in uses}
    for group in groups:
        yield _on_wait(run, group, by_name, window, path_name)
    delays: dict[str, list[PathStep]] = defaultdict(list)
    for step in path.steps:
        if step.doing is Doing.DELAY:
            delays[run.name(step.message_id)].append(step)
    for name, steps in delays.items():
        spans = [(step.start, step.end) for step in steps]
        texts = [run.describe(step.message_id) for step in steps]
        yield _advice_on_spans(words.DELAY, spans, window, texts, name=name, path=path_name)


def _on_wait(
    run: Run, group: WaitGroup, uses: dict[str, Use], window: Span, path_name: str
) -> Advice:
    longest, step = max(group.waits, key=lambda wait: wait[0].seconds)
    saving, busy, but = group.saving, "", ""
    if longest.words is words.QUEUE and (use := uses.get(longest.name)):
        busy = f" It is busy {percent(use.share)} of the time, with {use.capacity} at a time."
        least = use.worked / (use.capacity + 1)
        rest = max(use.window[1] - use.window[0] - least, 0.0)
        if window[1] >= use.window[1] and saving > rest:
            saving = rest
            but = f": its work would still take {duration(least)}"
    return longest.words.filled(
        saving,
        saving,
        len(group.waits),
        _longest_in_words(run, longest, step),
        (longest.start, longest.end),
        name=longest.name,
        seconds=duration(group.seconds),
        busy=busy,
        but=but,
        path=path_name,
        most="that" if duration(saving) == duration(group.seconds) else duration(saving),
    )


def _longest_in_words(run: Run, wait: PrecedingWait, step: PathStep) -> str:
    """Return the longest wait of a group in words, with its reason if that is known."""
    asked = step.resumed.awaited if step.resumed else step.message_id
    comma = "," if step.resumed else ""
    text = f"{wait_in_words(run, step)}{comma} {duration(wait.seconds)}, until {run_time(wait.end)}"
    if claim := wait.claim:
        verb = "held" if claim.granted is not None else "had requested"
        text += f"; {claim.sender} {verb} it"
    return text + still_handled(run, asked, wait.end)


# --- standstills, on the critical path or beside it -----------------------------------------------


def _on_standstills(run: Run, path: CriticalPath | None, window: Span) -> Iterator[Advice]:
    """Yield advice on messages without a handler and on suspended tasks, by name."""
    on_path: dict[tuple[Topic, str], float] = defaultdict(float)
    for step in path.steps if path else ():
        if (topic := _TOPICS.get(step.doing)) is not None:
            seconds = Cover([(step.start, step.end)]).within(*window)
            on_path[topic, run.name(step.message_id)] += seconds
    found: dict[tuple[Topic, str], list[tuple[Span, str]]] = defaultdict(list)
    for topic, number, (start, end), who in _standstills(run):
        span = start, min(end, run.time)
        text = f"{run.describe(number)}{who}, from {run_time(start)}, {duration(span[1] - start)}"
        found[topic, run.name(number)].append((span, text))
    for (topic, name), alike in found.items():
        spans, texts = [span for span, _ in alike], [text for _, text in alike]
        template = words.SUSPENDED
        if topic is Topic.HANDLER:
            template = words.NOT_HANDLED if run.offers.get(name) else words.NEVER_HANDLED
        yield _advice_on_spans(template, spans, window, texts, on_path[topic, name], name=name)


def _standstills(run: Run) -> Iterator[tuple[Topic, int, Span, str]]:
    """Yield each standstill: its topic, its message, its span, and words for who suspended it."""
    for one in run.queueings:
        if not one.module:
            yield Topic.HANDLER, one.message_id, (one.start, one.until), ""
    for suspension in run.suspensions():
        if (since := suspension.standstill) is not None:
            whom = by_whom(suspension.by)
            who = f" suspended{whom}" if whom else ""
            yield Topic.SUSPENDED, suspension.task, (since, suspension.until), who


_TOPICS = {Doing.NO_HANDLER: Topic.HANDLER, Doing.SUSPENDED: Topic.SUSPENDED}


# --- the waits on the critical path, and the largest possible savings -----------------------------

# Waits in one queue overlap: the last of five messages waits for the other four. The sum of the
# waits is therefore more than could be saved. To find the saving for one kind of wait, the path is
# walked back a second time, as if such waits took no time. From the end of such a wait, this walk
# jumps to its start and continues with the waiting message, not with the awaited one. Everything on
# this walk had to happen even without such waits. Only the spans that the walk jumped over could
# have been saved. These spans do not overlap, so their sum is at most the duration of the path.


def _wait_groups(
    run: Run, causes: Causes, path: CriticalPath, window: Span, at_least: float
) -> Iterator[WaitGroup]:
    """Group the waits before the steps of a path by kind and name.

    Yield each group that lasts at least *at_least* seconds in the window.
    """
    found: dict[tuple[Words, str], list[tuple[PrecedingWait, PathStep]]] = {}
    for step in path.steps:
        if wait := _preceding_wait(run, step):
            found.setdefault((wait.words, wait.name), []).append((wait, step))
    for alike in found.values():
        seconds = Cover((wait.start, wait.end) for wait, _ in alike).within(*window)
        if seconds >= at_least:
            saving = Cover(_avoidable_spans(run, causes, alike[-1][1])).within(*window)
            yield WaitGroup(alike, seconds, saving)


def _preceding_wait(run: Run, step: PathStep) -> PrecedingWait | None:
    """Return the wait that ended when a step started; None if there was none.

    The message waited in a queue, or its handler waited for a reply or a lock.
    """
    message = run.messages.get(step.message_id)
    if message and (queueing := queueing_before(run, step)):
        module, resource = queueing.module, queueing.resource
        span = queueing.start, step.start
        locked, holder = locked_out(run, (module, resource), *span, sender=message.sender)
        if locked * 2 > span[1] - span[0]:
            return PrecedingWait(words.LOCK, place(called(module), resource), *span, holder)
        return PrecedingWait(words.QUEUE, place(module, resource), *span) if module else None
    wait = step.resumed
    if wait is None or wait.moment or not wait.awaited or step.doing is not Doing.WORK:
        return None
    if message is None or message.message_class.has_reply:
        return None  # the wait for the outer query's reply contains this wait
    template, span = words.REPLY, (wait.start, step.start)
    if (wanted := run.claims.get(wait.awaited)) is not None:
        name = place(called(wanted.module), wanted.resource)
        locked, _ = locked_out(run, (wanted.module, wanted.resource), *span, but=wanted)
        template = words.LOCK if locked * 2 > span[1] - span[0] else words.CLAIM
        return PrecedingWait(template, name, *span)
    if is_in_vain(run, wait):
        template = words.IN_VAIN
    return PrecedingWait(template, run.name(wait.awaited), *span)


def _avoidable_spans(run: Run, causes: Causes, last: PathStep) -> Iterator[Span]:
    """Walk back from *last*. Yield the waits that this walk skips.

    They have the same kind and name as the wait before *last*.
    """
    like = _preceding_wait(run, last)

    def since(step: PathStep) -> float | None:
        found = _preceding_wait(run, step)
        return found.start if found and like and found[:2] == like[:2] else None

    yield from _handled_spans(run, last)
    for step in causes.back_before(last, since):
        if since(step) is not None:
            yield from _handled_spans(run, step)


def _handled_spans(run: Run, step: PathStep) -> Iterator[Span]:
    """Yield the wait before a step, without the time in which the awaited query had no handler.

    That time has advice of its own.
    """
    if (wait := _preceding_wait(run, step)) is None:
        return
    asked = run.messages.get(step.resumed.awaited) if step.resumed else None
    since = wait.start
    for queueing in asked.queueings if asked else ():
        if not queueing.module and queueing.until <= wait.end:
            yield since, max(queueing.start, since)
            since = max(queueing.until, since)
    yield since, wait.end
