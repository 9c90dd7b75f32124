"""What would make a run shorter, and by how much at most: from the critical path and from idle resources. Pure.

Each piece of advice has a bound of its own. They may be about the same seconds, so bounds must not be added up.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace

from tca_tools.analysis import advice_words as words
from tca_tools.analysis.advice_words import Advice, Sum, Topic, Words, length
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import Overlap, why_held
from tca_tools.analysis.critical_path import CriticalPath
from tca_tools.analysis.failures import Kind
from tca_tools.analysis.given_up import still_handled_in_words
from tca_tools.analysis.held_up import HeldUp, Reason, held_up
from tca_tools.analysis.long_waits import handler_wait_in_words
from tca_tools.analysis.queues import Growing, growing
from tca_tools.analysis.resources import Use
from tca_tools.analysis.steps import Doing
from tca_tools.analysis.summary import span_of
from tca_tools.run.fates import GOOD_FATES
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration, listed, percent, run_time

_NOTHING = 1e-9
"""What saves less is no advice."""


def advice(
    run: Run,
    causes: Causes,
    path: CriticalPath | None,
    overlaps: list[Overlap],
    uses: list[Use],
    kinds: list[Kind],
    at_least: float,
    other: CriticalPath | None = None,
) -> list[Advice]:
    """All advice that bears on at least so many seconds: first what shortens the critical path most, then what lies
    beside it, or would only shorten *other*, the path of another task. No bound is more than the run is long, and none
    of what lies on a path more than that is.
    """
    handling, least = span_of(run), max(at_least, _NOTHING)
    found = [_on_overlap(run, path, overlap) for overlap in overlaps]
    found += _on_standing(run, path, handling)
    on_path: list[Advice] = []
    for one in filter(None, (path, other)):
        called = f"critical path of {one.task}" if other else "critical path"
        told = [new for new in _on_path(run, causes, one, handling, uses, kinds, least, called) if new.saving >= least]
        if one is not path:
            known = {known.title for known in on_path}
            told = [replace(new, on_path=0.0, sooner=str(one.task)) for new in told if new.title not in known]
        on_path += told
    queues = [_on_queue(queue, on_path, handling) for queue in growing(run, *handling)]
    found += [*queues, *(one for one in on_path if one.title not in {queue.title for queue in queues})]
    return sorted((one for one in found if one.saving >= least), key=lambda one: (-one.on_path, -one.saving))


def _on_path(
    run: Run, causes: Causes, path: CriticalPath, handling: Span, uses: list[Use], kinds: list[Kind], at_least: float,
    called: str,
) -> Iterator[Advice]:  # fmt: skip
    """What there is to say of one path."""
    window = max(path.start, handling[0]), min(path.end, handling[1])
    for kind in kinds:
        yield _on_failures(window, path, kind, called)
    yield from _on_waits(run, causes, path, window, uses, at_least, called)


# --- failures ------------------------------------------------------------------------------------------------------


def _on_failures(window: Span, path: CriticalPath, kind: Kind, called: str) -> Advice:
    """The failures of a kind that were overcome, and whose handlers were on the path: what they took. A failure that
    ended something made the run shorter.
    """
    ends = {(step.message_id, step.end) for step in path.steps}
    overcome = [case for case in kind.cases if case.fate in GOOD_FATES]
    cases = [case for case in overcome if (case.message_id, case.time) in ends]
    spans = [(case.time - case.lost, case.time + case.recovery) for case in cases]
    cost = Cover(spans).within(*window)
    longest = max(cases, key=lambda case: case.cost, default=kind.cases[0])
    example = f"{longest.of}, at {run_time(longest.time)}, {duration(longest.cost)}" + (
        longest.text and f": {longest.text}"
    )
    return words.FAILED.filled(
        cost, cost, len(cases), example, spans[0] if spans else None,
        failure=kind.failure, message=kind.message, path=called, seconds=duration(cost),
    )  # fmt: skip


# --- planning while acting -----------------------------------------------------------------------------------------


def _on_overlap(run: Run, path: CriticalPath | None, overlap: Overlap) -> Advice:
    chance, number = overlap.example, len(overlap.chances)
    on_path = {(id(step.handling), step.start) for step in path.steps} if path else set()
    saved_on_path = sum(
        min(one.saving, sum(step.seconds for step in one.steps if (id(step.handling), step.start) in on_path))
        for one in overlap.chances
    )
    acting, second = place(*chance.acting), run.name(chance.second)
    planners = list(dict.fromkeys(place(step.module, step.resource) for step in chance.steps))
    first = run.name(chance.first)
    pair = f"one '{first}' and the next" if first == second else f"'{first}' and '{second}'"
    example = (
        f"{run_time(chance.start)} to {run_time(chance.end)}, between {run.describe(chance.first)} and "
        f"{run.describe(chance.second)}: {why_held(run, chance.held)}"
    )
    return words.OVERLAP.filled(
        overlap.saving, saved_on_path, number, example, (chance.start, chance.end),
        acting=acting, pair=pair, seconds=duration(overlap.idle), remedy=chance.remedy,
        planning=duration(overlap.planning), planners=listed(planners), most=duration(overlap.saving),
    )  # fmt: skip


# --- queues that grow -----------------------------------------------------------------------------------------------


def _on_queue(queue: Growing, on_path: list[Advice], run: Span) -> Advice:
    """A queue that only grows; instead of what there is to say of the waits in it that lie on the path."""
    where = place(*queue.key)
    waits = next((one for one in on_path if one.title == _title_of(queue)), None)
    example = f"the oldest of the queue had waited {duration(queue.longest)} at {run_time(queue.end)}"
    longest = Cover([(queue.end - queue.longest, queue.end)]).within(*run)
    return words.GROWING.filled(
        max(longest, waits.saving if waits else 0.0), waits.on_path if waits else 0.0,
        queue.length, example, (queue.start, queue.end),
        name=where, rate_in=f"{queue.rate_in:.3g}", rate_out=f"{queue.rate_out:.3g}", start=run_time(queue.start),
        end=run_time(queue.end), length=f"{queue.length:,}", message=queue.message,
        drain=duration(queue.length / queue.rate_out), needed=f"{queue.needed:,}", capacity=f"{queue.capacity:,}",
    )  # fmt: skip


def _title_of(queue: Growing) -> str:
    """What advice about the waits in a queue is called, whether it grows or not."""
    return words.QUEUE.title.format(name=place(*queue.key))


# --- waits on the critical path -------------------------------------------------------------------------------------


def _on_waits(
    run: Run, causes: Causes, path: CriticalPath, window: Span, uses: list[Use], at_least: float, called: str
) -> Iterator[Advice]:
    """Advice for each kind of wait that lies on a path within a window; *called* is what to call the path."""
    by_name = {use.name: use for use in uses}
    for held in held_up(run, causes, path, window, at_least):
        use = by_name.get(held.name) if held.reason is Reason.QUEUE else None
        yield _on_wait(run, held, use, window, called)
    delays: dict[str, Sum] = defaultdict(Sum)
    for step in path.steps:
        if step.doing is Doing.DELAY:
            delays[run.name(step.message_id)].add(step.start, step.end, run.describe(step.message_id))
    for name, total in delays.items():
        saving, often = total.within(*window), len(total.spans)
        yield words.DELAY.filled(
            saving, saving, often, total.words, total.longest,
            name=name, path=called, seconds=duration(saving),
        )  # fmt: skip


def _on_wait(run: Run, held: HeldUp, use: Use | None, window: Span, called: str) -> Advice:
    saving, busy, but = held.saving, "", ""
    if use:
        busy = f" It is busy {percent(use.share)} of the time, with {use.capacity} at a time."
        least = use.worked / (use.capacity + 1)
        rest = max(length(use.window) - least, 0.0)
        if window[1] >= use.window[1] and saving > rest:
            saving, but = rest, f": what it has to do would still take {duration(least)}"
    return _WORDS[held.reason].filled(
        saving, saving, held.times, _longest(run, held), (held.longest.start, held.longest.end),
        name=held.name, seconds=duration(held.seconds), busy=busy, but=but, path=called,
        most="that" if duration(saving) == duration(held.seconds) else duration(saving),
    )  # fmt: skip


def _longest(run: Run, held: HeldUp) -> str:
    """The longest of some waits, in words, with what is known of why."""
    step, longest = held.step, held.longest
    asked = step.message_id
    if longest.queueing is None and step.resumed:
        what = f"the handler of {run.describe(asked)} waited {handler_wait_in_words(run, step.resumed)},"
        asked = step.resumed.awaited
    else:
        what = f"{run.describe(asked)} waited"
    told = f"{what} {duration(longest.seconds)}, until {run_time(longest.end)}"
    if longest.claim:
        told += f"; {longest.claim.sender} had {'it' if longest.claim.granted is not None else 'asked for it'}"
    return told + still_handled_in_words(run, asked, longest.end)


# --- what nobody could work on, on the critical path or beside it ---------------------------------------------------


def _on_standing(run: Run, path: CriticalPath | None, window: Span) -> Iterator[Advice]:
    """Of messages that nobody handled, and of suspended tasks: how long at most one of a name stood."""
    on_path: dict[tuple[Topic, str], float] = defaultdict(float)
    for step in path.steps if path else ():
        if step.doing in _STANDING:
            on_path[_STANDING[step.doing], run.name(step.message_id)] += Cover([(step.start, step.end)]).within(*window)
    for (topic, name), sums in _stood(run).items():
        saving = sums.within(*window)
        moves_end, often = min(on_path[topic, name], saving), len(sums.spans)
        yield _standing_words(run, topic, name, sums).filled(
            saving, moves_end, often, sums.words, sums.longest,
            name=name, seconds=duration(saving),
        )  # fmt: skip


def _stood(run: Run) -> dict[tuple[Topic, str], Sum]:
    """By topic and name: what stood, from when until when."""
    found: dict[tuple[Topic, str], Sum] = defaultdict(Sum)

    def add(topic: Topic, message_id: int, since: float, end: float | None, who: str) -> None:
        until = run.time if end is None else end
        told = f"{who}, from {run_time(since)}, {duration(until - since)}"
        found[topic, run.name(message_id)].add(since, until, told)

    for queueing in run.queueings:
        if not queueing.module:
            who = run.describe(queueing.message_id)
            add(Topic.HANDLER, queueing.message_id, queueing.start, queueing.end, who)
    for suspension in run.suspensions():
        if (since := suspension.standstill) is not None:
            whom = by_whom(suspension.by)
            who = run.describe(suspension.task) + (f" suspended{whom}" if whom else "")
            add(Topic.SUSPENDED, suspension.task, since, suspension.end, who)
    return found


def _standing_words(run: Run, topic: Topic, name: str, sums: Sum) -> Words:
    """What there is to say; of what nobody ever handled, or nobody any more when it was last needed, something else."""
    if topic is not Topic.HANDLER:
        return words.SUSPENDED
    if not (offers := run.offers.get(name, ())):
        return words.NEVER_HANDLED
    last = max(end for _, end in sums.spans)
    has_gone = all(offer.end is not None and offer.end <= last for offer in offers)
    return words.NOT_HANDLED_ANY_MORE if has_gone else words.NOT_HANDLED


_STANDING = {Doing.NO_HANDLER: Topic.HANDLER, Doing.SUSPENDED: Topic.SUSPENDED}
_WORDS = {
    Reason.QUEUE: words.QUEUE,
    Reason.LOCK: words.LOCK,
    Reason.CLAIM: words.CLAIM,
    Reason.REPLY: words.REPLY,
    Reason.IN_VAIN: words.IN_VAIN,
}
