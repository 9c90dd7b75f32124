"""What would make a run shorter, and by how much at most: from the critical path and from idle resources. Pure.

Each piece of advice has a bound of its own. They may be about the same seconds, so bounds must not be added up.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from tca_tools.analysis.causes import Causes, Doing
from tca_tools.analysis.concurrency import Overlap
from tca_tools.analysis.critical_path import CriticalPath
from tca_tools.analysis.failures import Kind
from tca_tools.analysis.held_up import HeldUp, held_up
from tca_tools.analysis.queues import Growing, growing
from tca_tools.analysis.resources import Use
from tca_tools.analysis.spans import Cover, Span
from tca_tools.analysis.summary import span_of
from tca_tools.analysis.waits import WaitKind
from tca_tools.analysis.words import listed, moment, percent, seconds
from tca_tools.analysis.words import times as say_times
from tca_tools.coping import GOOD_FATES
from tca_tools.past import Past
from tca_tools.story import awaited
from tca_wire.wording import by_whom, place

_NOTHING = 1e-9
"""What saves less is no advice."""


class Topic(StrEnum):
    """What a piece of advice is about."""

    FAILURE = "failures"
    OVERLAP = "plan while acting"
    QUERY = "ask sooner"
    CAPACITY = "more capacity"
    LOCK = "shorter locks"
    HANDLER = "missing handler"
    SUSPENDED = "suspended"
    DELAY = "delays"


@dataclass(slots=True)
class Advice:
    """Something that would make the run shorter."""

    topic: Topic
    title: str
    text: str
    saving: float
    """At most so many seconds."""
    on_path: float
    """How many of them lie on the critical path: only these make the end come sooner."""
    times: int
    """How often it happened."""
    example: str = ""
    """The case with the greatest bound."""
    remedy: str = ""
    window: tuple[float, float] | None = None
    """When the example happened."""


@dataclass(slots=True)
class _Sum:
    """What went on for one reason, at several times."""

    spans: list[Span] = field(default_factory=list)
    words: str = ""
    """Of the longest."""

    def add(self, start: float, end: float, words: str) -> None:
        if not self.spans or end - start > _length(self.longest):
            self.words = words
        self.spans.append((start, end))

    @property
    def times(self) -> int:
        return len(self.spans)

    @property
    def longest(self) -> Span:
        return max(self.spans, key=_length)

    def within(self, start: float, end: float) -> float:
        """Seconds of a window; where they overlap, once."""
        return Cover(self.spans).within(start, end)


def _length(span: Span) -> float:
    return span[1] - span[0]


class _Words(NamedTuple):
    """What a topic has to say: a title, what was found, and what to do."""

    title: str
    text: str
    remedy: str


_Sums = dict[str, _Sum]


def advice(
    past: Past,
    causes: Causes,
    path: CriticalPath | None,
    overlaps: list[Overlap],
    uses: list[Use],
    kinds: list[Kind],
    at_least: float,
) -> list[Advice]:
    """All advice that bears on at least so many seconds; first what shortens the critical path most. No bound is more
    than the run is long, and none of what lies on the path more than the path is.
    """
    run = span_of(past)
    found = [_on_overlap(past, path, overlap) for overlap in overlaps]
    found += _on_standing(past, path, run)
    on_path: list[Advice] = []
    if path:
        window = max(path.start, run[0]), min(path.end, run[1])
        found += [_on_failures(window, path, kind) for kind in kinds]
        on_path += _on_path(past, causes, path, window, uses, at_least)
    queues = [_on_queue(queue, on_path, run) for queue in growing(past, *run)]
    found += [*queues, *(one for one in on_path if one.title not in {queue.title for queue in queues})]
    worth = [one for one in found if one.saving >= max(at_least, _NOTHING)]
    return sorted(worth, key=lambda one: (-one.on_path, -one.saving))


# --- failures ------------------------------------------------------------------------------------------------------


def _on_failures(window: Span, path: CriticalPath, kind: Kind) -> Advice:
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
        f"'{kind.message}' failed {say_times(len(cases))} on the critical path; what it had done until then and what "
        f"was done about it took {seconds(cost)}. Without these failures the run would be shorter by at most that"
    )
    example = f"{longest.of}, at {moment(longest.time)}, {seconds(longest.cost)}" + (
        longest.text and f": {longest.text}"
    )
    return Advice(
        Topic.FAILURE, f"Avoid '{kind.failure}' of '{kind.message}'", text, cost, cost, len(cases), example,
        "find out why it comes about, or let it be noticed sooner", spans[0] if spans else None,
    )  # fmt: skip


# --- planning while acting -----------------------------------------------------------------------------------------


def _on_overlap(past: Past, path: CriticalPath | None, overlap: Overlap) -> Advice:
    chance, times = overlap.example, len(overlap.chances)
    on_path = {(id(step.handling), step.start) for step in path.steps} if path else set()
    saved_on_path = sum(
        min(one.saving, sum(step.seconds for step in one.steps if (id(step.handling), step.start) in on_path))
        for one in overlap.chances
    )
    acting, second = place(*chance.acting), past.name(chance.second)
    planners = list(dict.fromkeys(place(step.module, step.resource) for step in chance.steps))
    first = past.name(chance.first)
    pair = f"one '{first}' and the next" if first == second else f"'{first}' and '{second}'"
    text = (
        f"{acting} stood idle {say_times(times)} between {pair}, {seconds(overlap.idle)} in all. For "
        f"{seconds(overlap.planning)} of that {listed(planners)} planned what comes next. Planning it while the one "
        f"before is executed would save at most {seconds(overlap.saving)}"
    )
    example = (
        f"{moment(chance.start)} to {moment(chance.end)}, between {past.describe(chance.first)} and "
        f"{past.describe(chance.second)}: {chance.reason}"
    )
    title = f"Plan the next while {acting} acts"
    return Advice(
        Topic.OVERLAP, title, text, overlap.saving, saved_on_path, times, example, chance.remedy,
        (chance.start, chance.end),
    )  # fmt: skip


# --- waits on the critical path ------------------------------------------------------------------------------------


def _on_path(
    past: Past, causes: Causes, path: CriticalPath, window: Span, uses: list[Use], at_least: float
) -> Iterator[Advice]:
    by_name = {use.name: use for use in uses}
    for held in held_up(past, causes, path, window, at_least):
        use = by_name.get(held.name) if held.kind is WaitKind.RESOURCE else None
        yield _on_waits(past, held, use, window)
    delays: _Sums = defaultdict(_Sum)
    for step in path.steps:
        if step.doing is Doing.DELAY:
            delays[past.name(step.message_id)].add(step.start, step.end, past.describe(step.message_id))
    for name, total in delays.items():
        yield _put(Topic.DELAY, name, total, total.within(*window))


def _on_waits(past: Past, held: HeldUp, use: Use | None, window: Span) -> Advice:
    saving, busy, but = held.saving, "", ""
    if use:
        busy = f" It is busy {percent(use.share)} of the time, with {use.capacity} at a time."
        least = use.worked / (use.capacity + 1)
        rest = max(_length(use.window) - least, 0.0)
        if window[1] >= use.window[1] and saving > rest:
            saving, but = rest, f": what it has to do would still take {seconds(least)}"
    topic, words = _TOPICS[held.kind], _waited(past, held)
    most = "that" if seconds(saving) == seconds(held.seconds) else seconds(saving)
    known = {"name": held.name, "times": say_times(held.times), "seconds": seconds(held.seconds)}
    title, text, remedy = (one.format(**known, busy=busy, most=most, but=but) for one in _WORDS[topic])
    return Advice(topic, title, text, saving, saving, held.times, words, remedy, (held.longest.start, held.longest.end))


def _waited(past: Past, held: HeldUp) -> str:
    """The longest of some waits, in words."""
    step, longest = held.step, held.longest
    if step.resumed:
        what = f"the handler of {past.describe(step.message_id)} waited {awaited(past, step.resumed)},"
    else:
        what = f"{past.describe(step.message_id)} waited"
    words = f"{what} {seconds(longest.seconds)}, until {moment(longest.end)}"
    return words + (f"; {longest.claim.sender} had it" if longest.claim else "")


def _put(topic: Topic, name: str, sums: _Sum, saving: float) -> Advice:
    """A piece of advice whose words say how often and how long."""
    known = {"name": name, "times": say_times(sums.times), "seconds": seconds(saving)}
    title, text, remedy = (words.format(**known) for words in _WORDS[topic])
    return Advice(topic, title, text, saving, saving, sums.times, sums.words, remedy, sums.longest)


_TOPICS = {WaitKind.RESOURCE: Topic.CAPACITY, WaitKind.LOCK: Topic.LOCK, WaitKind.REPLY: Topic.QUERY}
_WORDS = {
    Topic.QUERY: _Words(
        "'{name}' is asked on the critical path",
        "The critical path waits {times} for the reply to '{name}', {seconds} in all. A reply that is there when it is "
        "needed would save at most {most}",
        "ask before something slow and fetch the reply later (query_send), keep the value as a variable, or answer "
        "faster",
    ),
    Topic.CAPACITY: _Words(
        "{name} is a bottleneck",
        "The critical path stands {times} in the queue for {name}, {seconds} in all.{busy} One more slot, or a second "
        "module in its pool, would save at most {most}{but}",
        "raise its capacity, share its messages in a pool, or split what it handles over two resources",
    ),
    Topic.LOCK: _Words(
        "{name} is locked on the critical path",
        "The critical path waits {times} until {name} is no longer locked or reserved, {seconds} in all. Locks held "
        "only while they are needed would save at most {most}",
        "take the lock later, release it sooner, or lock a smaller resource",
    ),
    Topic.DELAY: _Words(
        "Delays before '{name}'",
        "Constraints with a delay hold '{name}' back {times} on the critical path, {seconds} in all. Shorter ones "
        "would save at most that",
        "shorten the delay, if what it waits for allows that",
    ),
}


def _on_queue(queue: Growing, on_path: list[Advice], run: Span) -> Advice:
    """A queue that only grows; instead of what there is to say of the waits in it that lie on the path."""
    where = place(*queue.key)
    title = _WORDS[Topic.CAPACITY].title.format(name=where)
    waits = next((one for one in on_path if one.title == title), None)
    drain = queue.length / queue.rate_out
    text = (
        f"More comes for {where} than it handles: {queue.rate_in:.3g} messages a second come, {queue.rate_out:.3g} are "
        f"handled. From {moment(queue.start)} to {moment(queue.end)} its queue grew to {queue.length:,}, most of them "
        f"'{queue.message}'; who came last would have to wait for {seconds(drain)}, and whoever comes later longer"
    )
    remedy = (
        f"let it handle {queue.needed:,} at a time instead of {queue.capacity:,} (capacity=), if its handlers do not "
        "get in each other's way, let a second module share its messages in a pool, handle each faster, send fewer, or "
        "let only the newest wait (pending=)"
    )
    example = f"the oldest of the queue had waited {seconds(queue.longest)} at {moment(queue.end)}"
    longest = Cover([(queue.end - queue.longest, queue.end)]).within(*run)
    saving = max(longest, waits.saving if waits else 0.0)
    seconds_on_path = waits.on_path if waits else 0.0
    return Advice(
        Topic.CAPACITY, title, text, saving, seconds_on_path, queue.length, example, remedy, (queue.start, queue.end)
    )


# --- what nobody could work on, on the critical path or beside it ---------------------------------------------------


def _on_standing(past: Past, path: CriticalPath | None, run: Span) -> Iterator[Advice]:
    """Of messages that nobody handled, and of suspended tasks: how long at most one of a name stood."""
    on_path: dict[tuple[Topic, str], float] = defaultdict(float)
    for step in path.steps if path else ():
        if step.doing in _STANDING:
            on_path[_STANDING[step.doing], past.name(step.message_id)] += Cover([(step.start, step.end)]).within(*run)
    for (topic, name), sums in _stood(past).items():
        saving = sums.within(*run)
        known = {"name": name, "times": say_times(sums.times), "seconds": seconds(saving)}
        title, text, remedy = (words.format(**known) for words in _standing_words(past, topic, name))
        moves_end = min(on_path[topic, name], saving)
        yield Advice(topic, title, text, saving, moves_end, sums.times, sums.words, remedy, sums.longest)


def _stood(past: Past) -> dict[tuple[Topic, str], _Sum]:
    """By topic and name: what stood, from when until when."""
    found: dict[tuple[Topic, str], _Sum] = defaultdict(_Sum)

    def add(topic: Topic, message_id: int, since: float, end: float | None, who: str) -> None:
        until = past.time if end is None else end
        words = f"{who}, from {moment(since)}, {seconds(until - since)}"
        found[topic, past.name(message_id)].add(since, until, words)

    for queueing in past.queueings:
        if not queueing.module:
            who = past.describe(queueing.message_id)
            add(Topic.HANDLER, queueing.message_id, queueing.start, queueing.end, who)
    for suspension in past.suspensions():
        if (since := suspension.standstill) is not None:
            who = past.describe(suspension.task) + (f" suspended{by_whom(suspension.by)}" if suspension.by else "")
            add(Topic.SUSPENDED, suspension.task, since, suspension.end, who)
    return found


def _standing_words(past: Past, topic: Topic, name: str) -> _Words:
    """What there is to say; of what nobody ever handled, or nobody at the end, something else."""
    if topic is Topic.HANDLER and all(offer.end is not None for offer in past.offers.get(name, ())):
        return _GONE if past.offers.get(name) else _NEVER
    return _STANDING_WORDS[topic]


_STANDING = {Doing.NO_HANDLER: Topic.HANDLER, Doing.SUSPENDED: Topic.SUSPENDED}
_NEVER = _Words(
    "Nobody handles '{name}'",
    "'{name}' waited {times} for a module that handles it, {seconds} in all, and none ever came",
    "start a module that handles it; if there is one, see whether it calls the message something else",
)
_GONE = _Words(
    "Nobody handles '{name}' any more",
    "'{name}' waited {times} for a module that handles it, {seconds} in all; at the end there was none",
    "find out why the module that handled it left, and start it again",
)
_STANDING_WORDS = {
    Topic.HANDLER: _Words(
        "Nobody handles '{name}' for a while",
        "'{name}' waited {times} for a module that handles it, {seconds} in all",
        "start that module before what needs it (requires=), or find out why it left",
    ),
    Topic.SUSPENDED: _Words(
        "'{name}' is suspended for a while",
        "'{name}' was suspended {times}; it stood still for {seconds} in all, not counting what ran on under it",
        "resume it sooner, or suspend only what has to stand",
    ),
}
