"""What would make a run shorter, and by how much at most: from the critical path and from idle resources. Pure.

Each piece of advice has a bound of its own. They may be about the same seconds, so bounds must not be added up.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from tca_tools.analysis.causes import Doing, Step
from tca_tools.analysis.concurrency import Overlap
from tca_tools.analysis.critical_path import CriticalPath, queueing_before
from tca_tools.analysis.failures import Kind
from tca_tools.analysis.queues import Growing, growing
from tca_tools.analysis.resources import Use
from tca_tools.analysis.spans import Cover
from tca_tools.analysis.summary import span_of
from tca_tools.analysis.waits import locked_during
from tca_tools.analysis.words import listed, moment, percent, seconds
from tca_tools.analysis.words import times as say_times
from tca_tools.coping import GOOD_FATES
from tca_tools.past import Past
from tca_tools.story import awaited
from tca_wire.wording import by_whom, place


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
    """Waits of one kind on the path."""

    seconds: float = 0.0
    times: int = 0
    longest: float = 0.0
    window: tuple[float, float] | None = None
    """When the longest was."""
    words: str = ""

    def add(self, length: float, end: float, words: str) -> None:
        self.seconds += length
        self.times += 1
        if length > self.longest:
            self.longest, self.window, self.words = length, (end - length, end), words


class _Words(NamedTuple):
    """What a topic has to say: a title, what was found, and what to do."""

    title: str
    text: str
    remedy: str


_Sums = dict[tuple[Topic, str], _Sum]


def advice(
    past: Past, path: CriticalPath | None, overlaps: list[Overlap], uses: list[Use], kinds: list[Kind], at_least: float
) -> list[Advice]:
    """All advice that bears on at least so many seconds; first what shortens the critical path most."""
    found = [_on_overlap(past, path, overlap) for overlap in overlaps]
    found += _on_standing(past, path)
    on_path: list[Advice] = []
    if path:
        found += [_on_failures(path, kind) for kind in kinds]
        on_path += _on_path(past, path, uses)
    queues = [_on_queue(queue, on_path) for queue in growing(past, *span_of(past))]
    found += [*queues, *(one for one in on_path if one.title not in {queue.title for queue in queues})]
    worth = [one for one in found if one.saving >= at_least]
    return sorted(worth, key=lambda one: (-one.on_path, -one.saving))


# --- failures ------------------------------------------------------------------------------------------------------


def _on_failures(path: CriticalPath, kind: Kind) -> Advice:
    """The failures of a kind that were overcome, and whose handlers were on the path: what they took. A failure that
    ended something made the run shorter.
    """
    ends = {(step.message_id, step.end) for step in path.steps}
    overcome = [case for case in kind.cases if case.fate in GOOD_FATES]
    cases = [case for case in overcome if (case.message_id, case.time) in ends]
    spans = [(case.time - case.lost, case.time + case.recovery) for case in cases]
    cost = Cover(spans).within(path.start, path.end)
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


def _on_path(past: Past, path: CriticalPath, uses: list[Use]) -> Iterator[Advice]:
    sums: _Sums = defaultdict(_Sum)
    missing: list[Step] = []
    for step in path.steps:
        _add_queue(past, sums, step)
        _add_wait(past, sums, step, missing)
        if step.doing in _TOPICS:
            sums[_TOPICS[step.doing], past.name(step.message_id)].add(
                step.seconds, step.end, past.describe(step.message_id)
            )
        if step.doing is Doing.NO_HANDLER:
            missing.append(step)
    by_name = {use.name: use for use in uses}
    for (topic, name), total in sums.items():
        use = by_name.get(name)
        busy = f" It is busy {percent(use.share)} of the time, with {use.capacity} at a time." if use else ""
        known = {"name": name, "times": say_times(total.times), "seconds": seconds(total.seconds), "busy": busy}
        title, text, remedy = (words.format(**known) for words in _WORDS[topic])
        yield Advice(topic, title, text, total.seconds, total.seconds, total.times, total.words, remedy, total.window)


def _add_queue(past: Past, sums: _Sums, step: Step) -> None:
    queueing = queueing_before(past, step)
    if queueing is None or not queueing.module:
        return
    length = step.start - queueing.start
    claim = locked_during(past, queueing.module, queueing.resource, queueing.start, queueing.end)
    words = f"{past.describe(step.message_id)} waited {seconds(length)}, until {moment(step.start)}"
    words += f"; {claim.sender} had it" if claim else ""
    topic = Topic.LOCK if claim else Topic.CAPACITY
    sums[topic, place(queueing.module, queueing.resource)].add(length, step.start, words)


def _add_wait(past: Past, sums: _Sums, step: Step, missing: list[Step]) -> None:
    """What the handler of a task had waited for before it went on, but for the time in which nobody handled that. The
    questions that a reply needs itself are part of it.
    """
    wait, asker = step.resumed, past.messages.get(step.message_id)
    if wait is None or wait.moment or asker is None or asker.message_class.has_reply or step.doing is not Doing.WORK:
        return
    length = step.start - wait.start
    words = f"the handler of {asker} waited {awaited(past, wait)}, {seconds(length)}, until {moment(step.start)}"
    if (claim := past.claims.get(wait.awaited)) is not None:
        sums[Topic.LOCK, place(claim.module, claim.resource)].add(length, step.start, words)
        return
    while missing and missing[-1].start >= wait.start:
        length -= missing.pop().seconds
    sums[Topic.QUERY, past.name(wait.awaited)].add(length, step.start, words)


_TOPICS = {Doing.DELAY: Topic.DELAY}
_WORDS = {
    Topic.QUERY: _Words(
        "'{name}' is asked on the critical path",
        "The critical path waits {times} for the reply to '{name}', {seconds} in all. A reply that is there when it is "
        "needed would save at most that",
        "ask before something slow and fetch the reply later (query_send), keep the value as a variable, or answer "
        "faster",
    ),
    Topic.CAPACITY: _Words(
        "{name} is a bottleneck",
        "The critical path stands {times} in the queue for {name}, {seconds} in all.{busy} One more slot, or a second "
        "module in its pool, would save at most that",
        "raise its capacity, share its messages in a pool, or split what it handles over two resources",
    ),
    Topic.LOCK: _Words(
        "{name} is locked on the critical path",
        "The critical path waits {times} until {name} is no longer locked or reserved, {seconds} in all. Locks held "
        "only while they are needed would save at most that",
        "take the lock later, release it sooner, or lock a smaller resource",
    ),
    Topic.DELAY: _Words(
        "Delays before '{name}'",
        "Constraints with a delay hold '{name}' back {times} on the critical path, {seconds} in all. Shorter ones "
        "would save at most that",
        "shorten the delay, if what it waits for allows that",
    ),
}


def _on_queue(queue: Growing, on_path: list[Advice]) -> Advice:
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
    saving = max(queue.longest, waits.saving if waits else 0.0)
    seconds_on_path = waits.on_path if waits else 0.0
    return Advice(
        Topic.CAPACITY, title, text, saving, seconds_on_path, queue.length, example, remedy, (queue.start, queue.end)
    )


# --- what nobody could work on, on the critical path or beside it ---------------------------------------------------


def _on_standing(past: Past, path: CriticalPath | None) -> Iterator[Advice]:
    """Of messages that nobody handled, and of suspended tasks: how long at most one of a name stood."""
    on_path: dict[tuple[Topic, str], float] = defaultdict(float)
    for step in path.steps if path else ():
        if step.doing in _STANDING:
            on_path[_STANDING[step.doing], past.name(step.message_id)] += step.seconds
    start, end = span_of(past)
    for (topic, name), stood in _stood(past).items():
        sums = _Sum()
        for who, since, until in stood:
            sums.add(until - since, until, f"{who}, from {moment(since)}, {seconds(until - since)}")
        saving = Cover((since, until) for _, since, until in stood).within(start, end)
        known = {"name": name, "times": say_times(sums.times), "seconds": seconds(saving)}
        title, text, remedy = (words.format(**known) for words in _STANDING_WORDS[topic])
        yield Advice(
            topic, title, text, saving, min(on_path[topic, name], saving), sums.times, sums.words, remedy, sums.window
        )


def _stood(past: Past) -> dict[tuple[Topic, str], list[tuple[str, float, float]]]:
    """By topic and name: what stood, from when until when."""
    found = defaultdict(list)
    for queueing in past.queueings:
        if not queueing.module:
            until = past.time if queueing.end is None else queueing.end
            who = past.describe(queueing.message_id)
            found[Topic.HANDLER, past.name(queueing.message_id)].append((who, queueing.start, until))
    for suspension in past.suspensions():
        if (since := suspension.standstill) is not None:
            until = past.time if suspension.end is None else suspension.end
            who = past.describe(suspension.task) + (f" suspended{by_whom(suspension.by)}" if suspension.by else "")
            found[Topic.SUSPENDED, past.name(suspension.task)].append((who, since, until))
    return found


_STANDING = {Doing.NO_HANDLER: Topic.HANDLER, Doing.SUSPENDED: Topic.SUSPENDED}
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
