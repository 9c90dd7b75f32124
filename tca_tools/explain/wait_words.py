"""Waits for display: with names, with the holders of resources, and with the ends of all waits.

A ``Wait`` becomes a ``WaitFor``. tca_wire/text/waits_in_words.py puts that into words.
``reasons`` describes the current waits of a task, ``in_the_end`` the end of all waits, and
``plans_in_words`` the planned events of a task.
"""

from collections.abc import Callable, Iterable
from math import inf
from typing import NamedTuple, TypeVar

from msgspec.structs import replace

from tca_tools.explain.graph import End, Ends, awaited_nodes, holders_of, next_node, waits_now
from tca_tools.explain.holders import (
    Holders,
    WaitPart,
    holders_for_message,
    parts_in_queue,
    parts_of_claim,
)
from tca_tools.explain.waits import Wait
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.records import (
    OVER,
    Claim,
    HandlerWait,
    Handling,
    Hold,
    Message,
    PlannedEvent,
    Queueing,
    Suspension,
    TaskState,
)
from tca_tools.journal.whole_run import Run
from tca_wire.points import ROOT, describe_moments
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import counted, duration, listed, run_time
from tca_wire.text.waits_in_words import (
    causes_in_words,
    clauses,
    not_answered,
    reached,
    suspended_by,
)
from tca_wire.vocabulary import Scope
from tca_wire.waits import NAMED, WaitFor, WaitKind, first_ones
from tca_wire.waits.ends import MOST

_T = TypeVar("_T")


class Age(NamedTuple):
    """The starts of a wait."""

    since: float
    """The start of the current cause."""
    begun: float
    """The start of the uninterrupted waiting, for any causes."""


# --- a wait, with names ---------------------------------------------------------------------------


def named_waits(at: RunAt, waits: Iterable[Wait], *, any_outcome: bool = False) -> list[WaitFor]:
    """Return waits with names; of many of one kind, the first ones and the number of others.

    Args:
        at: The run at an instant.
        waits: The waits.
        any_outcome: Whether the awaited subtasks may end with any outcome.
    """
    groups: dict[object, list[Wait]] = {}
    for wait in waits:
        is_delayed = isinstance(wait.record, Hold) and wait.record.constraint.delay
        is_alone = is_delayed or wait.kind in _ALONE
        key = id(wait) if is_alone else (wait.kind, wait.on.moment)
        groups.setdefault(key, []).append(wait)
    found = []
    for group in groups.values():
        number = sum(1 + len(wait.others) for wait in group)
        first = [wait_for(at, wait, any_outcome=any_outcome) for wait in group[:NAMED]]
        found += first_ones(first, number)
    return found


_ALONE = {WaitKind.RESOURCE, WaitKind.LOCK, WaitKind.REPLY, WaitKind.DELAY, WaitKind.LISTENER}
"""Kinds that are not grouped, since each wait has its own causes."""


def wait_for(at: RunAt, wait: Wait, *, any_outcome: bool = False) -> WaitFor:
    """Return a wait with names, and with the current holders of its resource or query."""
    number, kind, record = wait.on.number, wait.kind, wait.record
    if isinstance(record, Queueing):
        return of_queueing(at, holders_of(at, wait), record)
    if isinstance(record, Hold):
        return _of_constraint(at, kind, record)
    if kind is WaitKind.REPLY and number in at.run.messages:
        return of_query(at, at.run.messages[number])
    if kind is WaitKind.LOCK:
        return of_claim(at, holders_of(at, wait), at.run.claims[number])
    if kind is WaitKind.CONDITION:
        return _of_condition(at, number)
    moment = 0 if any_outcome and kind is WaitKind.SUBTASK else wait.on.moment
    name = record.name if isinstance(record, HandlerWait) else ""
    if kind is WaitKind.RUNNING and wait.blocks:  # the handler of the waiting message itself
        number, name, moment = 0, "", 0
    elif not name:
        name = at.run.name(number)
    by, since_birth = "", False
    if isinstance(record, Suspension):
        by, since_birth = record.by, record.since_birth
    return WaitFor(kind, number, name, moment, by, since_birth=since_birth)


def _of_constraint(at: RunAt, kind: WaitKind, hold: Hold) -> WaitFor:
    before, delay = hold.constraint.before, hold.constraint.delay
    if kind is WaitKind.DELAY:
        met = 0.0 if before.task == ROOT else at.reached_at(before) or hold.added
        return WaitFor(kind, seconds=met + delay)
    by, name = hold.tap.by if hold.tap else "", at.run.name(before.task)
    return WaitFor(kind, before.task, name, int(before.moment), by, seconds=delay or None)


def _of_condition(at: RunAt, monitor: int) -> WaitFor:
    run, last = at.run, None
    for time, holds in run.tests.get(monitor, ()):
        last = holds if time <= at.instant else last
    query, task = run.conditions.get(monitor), run.tasks[monitor]
    condition = query if query and query.received <= at.instant else task
    name = condition.name if task.message_class.has_condition else ""
    return WaitFor(WaitKind.CONDITION, name=name, holds=last)


def of_query(at: RunAt, query: Message) -> WaitFor:
    """Return the wait for a query's reply, with where the query is queued or handled.

    For a multi-query, the wait has the number of answers. It says where the copies are that have
    not been answered.
    """
    reply = WaitFor(WaitKind.REPLY, query.id, query.name)
    if query.answered is not None and query.answered <= at.instant:
        return reply
    answered = 0
    if query.message_class.asks_many:
        handlings, queueings = at.copies_of(query)
        answered = sum(one.until <= at.instant for one in query.handlings)
    else:
        handling, queueing = at.handling_of(query), at.queueing_of(query)
        queueings = [queueing] if queueing else []
        handlings = [handling] if handling and not queueing else []
    kind = WaitKind.RUNNING
    where = [WaitFor(kind, module=one.module, resource=one.resource) for one in handlings]
    for one in queueings:
        by = holders_for_message(at, one.module, one.resource, query) if one.module else Holders()
        where.append(of_queueing(at, by, one))
    return replace(reply, answered=answered, because=tuple(where))


def of_claim(at: RunAt, by: Holders, claim: Claim) -> WaitFor:
    """Return the wait for a lock or reservation."""
    because = _because(at, by)
    return WaitFor(
        WaitKind.LOCK, claim.id, _called(claim), 0, claim.module, claim.resource, because=because
    )


def of_queueing(at: RunAt, by: Holders, queueing: Queueing) -> WaitFor:
    """Return the wait in a queue, with the holders of the resource."""
    module, resource, because = queueing.module, queueing.resource, _because(at, by)
    if not module:
        return WaitFor(WaitKind.HANDLER, name=at.run.name(queueing.message_id))
    if not because and not at.capacity(module, resource):
        because = (WaitFor(WaitKind.HANDLER),)
    return WaitFor(WaitKind.RESOURCE, module=module, resource=resource, because=because)


def in_queue(run: Run, queueing: Queueing, message: Message, until: float = inf) -> str:
    """Return the wait in a queue in words, divided by its causes until a time."""
    return _by_cause(run, parts_in_queue(run, queueing, message), of_queueing, queueing, until)


def for_claim(run: Run, wait: HandlerWait, claim: Claim, until: float = inf) -> str:
    """Return the wait for a lock or reservation in words, divided by its causes until a time."""
    return _by_cause(run, parts_of_claim(run, wait, claim), of_claim, claim, until)


def _by_cause(
    run: Run,
    parts: list[WaitPart],
    wait_of: Callable[[RunAt, Holders, _T], WaitFor],
    record: _T,
    until: float,
) -> str:
    known = [
        (wait_of(RunAt(run, start), by, record), min(end, until, run.time) - start)
        for start, end, by in parts
        if start <= until
    ]
    return causes_in_words(known)


def _because(at: RunAt, by: Holders) -> tuple[WaitFor, ...]:
    running = [_of_message(at, WaitKind.RUNNING, one) for one in by.handlings[:NAMED]]
    found = first_ones(running, len(by.handlings))
    if by.claim is not None:
        found.append(_of_holder(at, by.claim))
    return tuple(found)


def _of_message(at: RunAt, kind: WaitKind, handling: Handling) -> WaitFor:
    return WaitFor(kind, handling.message_id, at.run.name(handling.message_id))


def _of_holder(at: RunAt, claim: Claim) -> WaitFor:
    """Return the wait that a lock on a resource causes, with the message that requested the lock.

    The lock is in force, or is the first pending one.
    """
    kind = WaitKind.LOCKED if at.is_granted(claim) else WaitKind.LOCK
    because: tuple[WaitFor, ...] = ()
    if claim.by is not None:
        how = WaitKind.RUNNING if claim.by.until > at.instant else WaitKind.TASK
        because = (_of_message(at, how, claim.by),)
    return WaitFor(kind, claim.id, _called(claim), 0, claim.sender, claim.resource, because=because)


def _called(claim: Claim) -> str:
    return "reservation" if claim.is_reserved else "lock"


# --- current waits --------------------------------------------------------------------------------


def reasons(at: RunAt, task: TaskAt) -> list[str]:
    """Return why a task waits, to follow its verb: ``["until take steps {2} is achieved"]``."""
    return clauses(named_waits_now(at, task, shown_waits(at, task)))


def named_waits_now(at: RunAt, task: TaskAt, waits: list[Wait]) -> list[WaitFor]:
    """Return the current waits of a task with names."""
    return named_waits(at, waits, any_outcome=task.state is TaskState.ENDING or task.is_retry_due)


def shown_waits(at: RunAt, task: TaskAt, *, with_children: bool = True) -> list[Wait]:
    """Return the current waits of a task, without the run of its own handler.

    The state of the task shows that run, except in the state *ending*.
    """
    waits = waits_now(at, task.id)
    if task.state is TaskState.ENDING:
        return waits
    others = [one for one in waits if one.kind is not WaitKind.RUNNING or not one.blocks]
    return [one for one in others if with_children or one.kind is not WaitKind.SUBTASK]


def unanswered_queries(at: RunAt, task: TaskAt) -> list[WaitFor]:
    """Return the unanswered queries of a handler that does not wait for them."""
    if task.waits or not task.handling:
        return []
    return [of_query(at, query) for query in task.unanswered[:NAMED]]


def verb_of(task: TaskAt, verb: str = "waits") -> str:
    """Return the word before the reasons of a task: "waits" or "watches"."""
    return "watches" if task.is_watching and task.state is not TaskState.ENDING else verb


def suspension_in_words(one: Suspension) -> str:
    """Return ``suspended by panel``."""
    return suspended_by(one.by, since_birth=one.since_birth)


def age_of(waits: list[Wait]) -> Age | None:
    """Return the starts of a task's waits; None if it does not wait."""
    if not waits:
        return None
    return Age(max(one.start for one in waits), min(one.since for one in waits))


# --- in the end -----------------------------------------------------------------------------------


class Last(NamedTuple):
    """The end of a task's waits: ``for paint {3}, which no module handles, and for 1 other``."""

    thing: str
    number: int
    which: str
    """Why the thing does not wait for another node: "no module handles", "is suspended"."""
    more: int
    """The number of other ends."""

    def __str__(self) -> str:
        text = f"for {self.thing}, which {self.which}"
        if not self.more:
            return text
        at_least = "at least " if self.more >= MOST else ""
        return f"{text}, and for {at_least}{counted(min(self.more, MOST), 'other')}"


def in_the_end(at: RunAt, task: TaskAt, within: int | None = None) -> Last | None:
    """Return the end of a task's waits; None if ``reasons`` already describe it.

    Args:
        at: The run at an instant.
        task: The task.
        within: The most steps to take to find the end (None: any number). If they are not enough,
            None is returned.
    """
    if task.state in OVER:
        return None
    ends = Ends.at(at).of(task.id, within)
    if ends and ends[0].kind is not WaitKind.CIRCLE:
        ends = tuple(end for end in ends if end.number != task.id)
    if not ends or _is_described(at, task, ends):
        return None
    return last_of(at, ends[0], len(ends) - 1)


def _is_described(at: RunAt, task: TaskAt, ends: tuple[End, ...]) -> bool:
    """Whether the current waits of a task describe all ends of its waits."""
    nexts, _ = awaited_nodes(at, next_node(at, task.id))
    described = {one.number for one in nexts}
    for number in described & at.run.claims.keys():
        claim = at.run.claims[number]
        # The description of a claim names its holder
        if at.is_granted(claim) or claim.by is task.handling:
            described |= {one.number for one in awaited_nodes(at, next_node(at, number))[0]}
    return all(end.number in described and _is_plain(at, task, end) for end in ends)


def _is_plain(at: RunAt, task: TaskAt, end: End) -> bool:
    """Whether the name of an end is its whole description."""
    if end.kind is WaitKind.RESUME:
        return task.state is TaskState.SUSPENDED
    is_plain = end.kind in (None, WaitKind.RUNNING, WaitKind.LOCKED)
    return is_plain or end.number not in at.tasks


def last_of(at: RunAt, end: End, more: int = 0) -> Last:
    """Return the description of an end, with the number of other ends."""
    claim = at.run.claims.get(end.number)
    if claim:
        verb = "has" if at.is_granted(claim) else "waits for"
        return Last(f"the {claim}", end.number, f"{claim.sender} {verb}", more)
    query, task = at.run.messages.get(end.number), at.tasks.get(end.number)
    which = _why_last(at, end, query) if query else ""
    if not which:
        which = _why_standing(at, end, task) if task else "has not been answered"
    return Last(at.describe(end.number), end.number, which, more)


def _why_last(at: RunAt, end: End, query: Message) -> str:
    """Return why a message is the end of its waits; "" if that is unknown."""
    if end.kind is WaitKind.CIRCLE:
        others = (one for one in Ends.at(at).members(end) if one != end.number)
        return f"waits for itself by way of {listed([*map(at.describe, others)])}"
    if query.message_class.asks_many:
        asked_of = of_query(at, query)
        return not_answered(asked_of) if asked_of.because else ""
    handling = at.handling_of(query) if end.kind is WaitKind.RUNNING else None
    if handling:
        return f"{place(handling.module, handling.resource)} handles"
    return "no module handles" if end.kind is WaitKind.HANDLER else ""


def _why_standing(at: RunAt, end: End, task: TaskAt) -> str:
    if end.kind is WaitKind.RESUME and task.suspension:
        return f"is {suspension_in_words(task.suspension)}"
    found = reasons(at, task)
    return f"{verb_of(task)} {', and '.join(found)}" if found else f"is {task.standing}"


# --- future events --------------------------------------------------------------------------------


def plans_in_words(at: RunAt, task: TaskAt) -> list[str]:
    """Return the planned events of a task in words: ``deadline: end achieving by 9.500 s``."""
    return list(filter(None, (describe_event(at, task, one) for one in task.plans)))


def describe_event(at: RunAt, task: TaskAt, event: PlannedEvent) -> str:
    """Return a planned event in words; "" if it is no longer pending."""
    after, due = event.after, event.set_at + event.seconds
    if event.moment is not None:
        if event.moment in task.reached or due <= at.time:
            return ""
        return f"deadline: {describe_moments(event.moment)[0]} by {run_time(due)}"
    who = f"{_SCOPES[event.scope]}will be killed{by_whom(event.by)}"
    if after is not None:
        if not at.has_reached(after):
            later = f"{duration(event.seconds)} after" if event.seconds else "when"
            return f"{who} {later} {at.describe(after.task)} {reached(after.moment)}"
        due = max(due, (at.reached_at(after) or 0.0) + event.seconds)
    return f"{who} at {run_time(due)}" if due > at.time else ""


_SCOPES = {
    Scope.TASK: "",
    Scope.DESCENDANTS: "its descendants ",
    Scope.SIBLINGS: "its siblings ",
}
