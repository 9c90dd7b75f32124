"""What would make a run shorter, and by how much at most: from the critical path and from idle resources. Pure.

Each piece of advice has a bound of its own. They may be about the same seconds, so bounds must not be added up.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace

from tca_tools.analysis.advised import Advice, Sum, Topic, Words
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import Overlap
from tca_tools.analysis.critical_path import CriticalPath
from tca_tools.analysis.failures import Kind
from tca_tools.analysis.queues import Growing, growing
from tca_tools.analysis.resources import Use
from tca_tools.analysis.slow_waits import bottleneck, on_waits
from tca_tools.analysis.steps import Doing
from tca_tools.analysis.summary import span_of
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_tools.why.coping import GOOD_FATES
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration, listed, run_time, times

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
    yield from on_waits(run, causes, path, window, uses, at_least, called)


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
    text = (
        f"'{kind.message}' failed {times(len(cases))} on the {called}; what it had done until then and what "
        f"was done about it took {duration(cost)}. Without these failures it would be shorter by at most that"
    )
    example = f"{longest.of}, at {run_time(longest.time)}, {duration(longest.cost)}" + (
        longest.text and f": {longest.text}"
    )
    return Advice(
        Topic.FAILURE, f"Avoid '{kind.failure}' of '{kind.message}'", text, cost, cost, len(cases), example,
        "find out why it comes about, or let it be noticed sooner", spans[0] if spans else None,
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
    text = (
        f"{acting} stood idle {times(number)} between {pair}, {duration(overlap.idle)} in all. For "
        f"{duration(overlap.planning)} of that {listed(planners)} planned what comes next. Planning it while the one "
        f"before is executed would save at most {duration(overlap.saving)}"
    )
    example = (
        f"{run_time(chance.start)} to {run_time(chance.end)}, between {run.describe(chance.first)} and "
        f"{run.describe(chance.second)}: {chance.reason}"
    )
    title = f"Plan the next while {acting} acts"
    return Advice(
        Topic.OVERLAP, title, text, overlap.saving, saved_on_path, number, example, chance.remedy,
        (chance.start, chance.end),
    )  # fmt: skip


# --- queues that grow -----------------------------------------------------------------------------------------------


def _on_queue(queue: Growing, on_path: list[Advice], run: Span) -> Advice:
    """A queue that only grows; instead of what there is to say of the waits in it that lie on the path."""
    where = place(*queue.key)
    title = bottleneck(where)
    waits = next((one for one in on_path if one.title == title), None)
    drain = queue.length / queue.rate_out
    text = (
        f"More comes for {where} than it handles: {queue.rate_in:.3g} messages a second come, {queue.rate_out:.3g} are "
        f"handled. From {run_time(queue.start)} to {run_time(queue.end)} its queue grew to {queue.length:,}, most of "
        f"them '{queue.message}'; the last one would have to wait for {duration(drain)}, and later ones longer"
    )
    remedy = (
        f"let it handle {queue.needed:,} at a time instead of {queue.capacity:,} (capacity=), if its handlers do not "
        "get in each other's way, let a second module share its messages in a pool, handle each faster, send fewer, or "
        "let only the newest wait (pending=)"
    )
    example = f"the oldest of the queue had waited {duration(queue.longest)} at {run_time(queue.end)}"
    longest = Cover([(queue.end - queue.longest, queue.end)]).within(*run)
    saving = max(longest, waits.saving if waits else 0.0)
    seconds_on_path = waits.on_path if waits else 0.0
    return Advice(
        Topic.CAPACITY, title, text, saving, seconds_on_path, queue.length, example, remedy, (queue.start, queue.end)
    )


# --- what nobody could work on, on the critical path or beside it ---------------------------------------------------


def _on_standing(run: Run, path: CriticalPath | None, window: Span) -> Iterator[Advice]:
    """Of messages that nobody handled, and of suspended tasks: how long at most one of a name stood."""
    on_path: dict[tuple[Topic, str], float] = defaultdict(float)
    for step in path.steps if path else ():
        if step.doing in _STANDING:
            on_path[_STANDING[step.doing], run.name(step.message_id)] += Cover([(step.start, step.end)]).within(*window)
    for (topic, name), sums in _stood(run).items():
        saving = sums.within(*window)
        known = {"name": name, "times": times(sums.times), "seconds": duration(saving)}
        title, text, remedy = (words.format(**known) for words in _standing_words(run, topic, name, sums))
        moves_end = min(on_path[topic, name], saving)
        yield Advice(topic, title, text, saving, moves_end, sums.times, sums.words, remedy, sums.longest)


def _stood(run: Run) -> dict[tuple[Topic, str], Sum]:
    """By topic and name: what stood, from when until when."""
    found: dict[tuple[Topic, str], Sum] = defaultdict(Sum)

    def add(topic: Topic, message_id: int, since: float, end: float | None, who: str) -> None:
        until = run.time if end is None else end
        words = f"{who}, from {run_time(since)}, {duration(until - since)}"
        found[topic, run.name(message_id)].add(since, until, words)

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
        return _STANDING_WORDS[topic]
    if not (offers := run.offers.get(name, ())):
        return _NEVER
    last = max(end for _, end in sums.spans)
    return _GONE if all(offer.end is not None and offer.end <= last for offer in offers) else _STANDING_WORDS[topic]


_STANDING = {Doing.NO_HANDLER: Topic.HANDLER, Doing.SUSPENDED: Topic.SUSPENDED}
_NEVER = Words(
    "Nobody handles '{name}'",
    "'{name}' waited {times} for a module that handles it, {seconds} in all, and none ever came",
    "start a module that handles it; if there is one, see whether it calls the message something else",
)
_GONE = Words(
    "Nobody handles '{name}' any more",
    "'{name}' waited {times} for a module that handles it, {seconds} in all; at last there was none",
    "find out why the module that handled it left, and start it again",
)
_STANDING_WORDS = {
    Topic.HANDLER: Words(
        "Nobody handles '{name}' for a while",
        "'{name}' waited {times} for a module that handles it, {seconds} in all",
        "start that module before what needs it (requires=), or find out why it left",
    ),
    Topic.SUSPENDED: Words(
        "'{name}' is suspended for a while",
        "'{name}' was suspended {times}; it stood still for {seconds} in all, not counting what ran on under it",
        "resume it sooner, or suspend only what has to stand",
    ),
}
