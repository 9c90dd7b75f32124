"""Waits in English: the words after "waits". Only this module composes them."""

from collections.abc import Callable, Iterable, Sequence

from tca_wire.points import Moment
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration, listed, numbered, run_time
from tca_wire.waits import Waiter, WaitFor, WaitKind

# For each moment (0: the end, whatever the outcome), the auxiliary verb and the rest.
_REACHED = {
    0: ("has", "ended"),
    Moment.START_HANDLING: ("is", "being handled"),
    Moment.END_HANDLING: ("has", "been handled"),
    Moment.START_PLANNING: ("is", "being planned"),
    Moment.END_PLANNING: ("is", "planned"),
    Moment.START_ACHIEVING: ("is", "being achieved"),
    Moment.END_ACHIEVING: ("is", "achieved"),
}
_PLURALS = {"is": "are", "has": "have"}

_MOST_CAUSES = 3
"""The number of causes that are named for one wait; further causes are only counted."""

Waits = Sequence[WaitFor]


def in_words(wait: WaitFor, now: float | None = None) -> str:
    """Return one wait: ``until move leg {4} is achieved``.

    With *now*, a delay shows the time that is left, and a suspension the time since its start.
    """
    return _WORDS[wait.kind](_WaitGroup([wait], now))


def several_in_words(waits: Iterable[WaitFor], now: float | None = None) -> str:
    """Return several waits, grouped by kind and moment.

    For example ``until a {1} and b {2} are achieved, and for legs``.
    """
    return ", and ".join(clauses(waits, now))


def clauses(waits: Iterable[WaitFor], now: float | None = None) -> list[str]:
    """Return a clause for each group of waits."""
    groups: dict[object, list[WaitFor]] = {}
    for wait in dict.fromkeys(waits):
        is_grouped = wait.kind in _GROUPED_KINDS and not wait.because
        key = (wait.kind, wait.moment, wait.seconds) if is_grouped else wait
        groups.setdefault(key, []).append(wait)
    return [_WORDS[group[0].kind](_WaitGroup(group, now)) for group in groups.values()]


def waiter_in_words(waiter: Waiter) -> str:
    """Return a waiter: ``walk {3} in planner``, ``module panel``, ``step {5} and 2 more``."""
    if not waiter.number:
        return f"module {waiter.module}"
    where = f" in {waiter.module}" if waiter.module else ""
    more = f" and {waiter.more:,} more" if waiter.more else ""
    return f"{numbered(waiter.name, waiter.number)}{where}{more}"


def whereabouts(query: WaitFor) -> str:
    """Return the place of an unanswered query: ``no module handles it``, ``it is queued for arm``.

    For a multi-query: the modules that have not answered.
    """
    if len(query.because) > 1 or query.answered:
        return not_answered(query)
    where = query.because[0]
    if where.kind is WaitKind.HANDLER:
        return "no module handles it"
    if where.kind is WaitKind.RESOURCE:
        return f"it is queued {in_words(where)}"
    waits = f" and waits {several_in_words(where.because)}" if where.because else ""
    return f"{place(where.module, where.resource)} handles it{waits}"


def causes_in_words(causes: Iterable[tuple[WaitFor, float]]) -> str:
    """Return the causes of one wait, with the seconds that each took.

    For example ``for legs, busy with grip {3} (3 s); busy with move {4} (2 s); and 2 more (520
    ms)``. The longest causes are named.
    """
    lengths: dict[WaitFor, float] = {}
    for wait, seconds in causes:
        lengths[wait] = lengths.get(wait, 0.0) + seconds
    if len(lengths) == 1:
        return in_words(next(iter(lengths)))
    longest = sorted(lengths, key=lambda wait: -lengths[wait])[:_MOST_CAUSES]
    named = [wait for wait in lengths if wait in longest]
    parts: list[str] = []
    for wait in named:
        text = in_words(wait)
        if parts and wait.because and wait.kind is named[0].kind in _RESOURCE_KINDS:
            text = _blockers(wait.because)  # words shared with the first are not repeated
        parts.append(f"{text} ({duration(lengths[wait])})")
    if more := [seconds for wait, seconds in lengths.items() if wait not in longest]:
        parts.append(f"and {len(more):,} more ({duration(sum(more))})")
    return "; ".join(parts)


def reached(moment: int, number: int = 1) -> str:
    """Return the verb for tasks that reach a moment: ``is achieved``, ``have been handled``."""
    verb, rest = _REACHED[moment]
    return f"{verb if number == 1 else _PLURALS[verb]} {rest}"


def suspended_by(module: str, *, since_birth: bool) -> str:
    """Return a suspension: ``suspended by panel``, ``suspended since its creation by planner``."""
    return f"suspended{' since its creation' * since_birth}{by_whom(module)}"


class _WaitGroup:
    """Waits of one kind and moment, shown in one clause."""

    def __init__(self, waits: Waits, now: float | None = None) -> None:
        more = sum(one.more for one in waits)
        self.first, self.now, self.number = waits[0], now, len(waits) + more
        self.messages = listed([one.name for one in waits], more)
        self.names = listed([numbered(one.name, one.number) for one in waits], more)

    @property
    def place(self) -> str:
        """The resource."""
        return place(self.first.module, self.first.resource)

    @property
    def reached(self) -> str:
        """``is achieved``, ``have been handled``."""
        return reached(self.first.moment, self.number)


def _delay(waits: _WaitGroup) -> str:
    end = waits.first.seconds
    if end is None:
        return "until a delay is over"
    if waits.now is None:
        return f"until {run_time(end)}"
    return f"for another {duration(max(end - waits.now, 0.0))}"


def _point(waits: _WaitGroup) -> str:
    delay = waits.first.seconds
    after = f"{duration(delay)} after " if delay else ""
    return f"until {after}{waits.names} {waits.reached}"


def _reply(waits: _WaitGroup) -> str:
    where = f" ({whereabouts(waits.first)})" if waits.first.because else ""
    return f"for the reply to {waits.names}{where}"


def _resource(waits: _WaitGroup) -> str:
    alternatives = f" (or {waits.first.more} more)" if waits.first.more else ""
    return f"for {waits.place}{alternatives}{_blocked_by(waits.first.because)}"


def _lock(waits: _WaitGroup) -> str:
    of = numbered(f"{waits.first.name or 'lock'} of {waits.place}", waits.first.number)
    return f"for the {of}{_blocked_by(waits.first.because)}"


def _blocked_by(because: Waits) -> str:
    """Return a comma and what blocks a resource: ``, which panel has locked``; "" for nothing."""
    return f", {_blockers(because)}" if because else ""


def _blockers(because: Waits) -> str:
    """Return what blocks a resource: ``busy with walk {3} and 2 more``."""
    running = [one for one in because if one.kind is WaitKind.RUNNING]
    parts = [f"busy with {_WaitGroup(running).names}"] if running else []
    parts += [
        f"which {_blocker(one, ' first' if running else '')}"
        for one in because
        if one not in running
    ]
    return ", and ".join(parts)


def _blocker(wait: WaitFor, order: str) -> str:
    """Return a claim of the resource: ``panel has locked for stop {3}``; or its missing handler."""
    if wait.kind is WaitKind.HANDLER:
        return "has no handler now"
    purpose = ""
    if wait.because:
        message = wait.because[0]
        while_or_for = "while handling" if message.kind is WaitKind.RUNNING else "for"
        purpose = f" {while_or_for} {numbered(message.name, message.number)}"
    is_reservation = wait.name == "reservation"
    if wait.kind is WaitKind.LOCKED:
        claim = "has reserved" if is_reservation else "has locked"
    else:
        claim = f"waits to {'reserve' if is_reservation else 'lock'}{order}"
    return f"{wait.module} {claim}{purpose}"


def not_answered(query: WaitFor) -> str:
    """Return a multi-query's wait: ``arm and legs (queued, busy with walk {3}) have not answered``.

    If some modules have answered, ``(1 of 3 answered)`` follows.
    """
    missing, answered = len(query.because), query.answered
    counts = f" ({answered} of {answered + missing} answered)" if answered else ""
    verb = "has" if missing == 1 else "have"
    return f"{listed([_handler_of(one) for one in query.because])} {verb} not answered{counts}"


def _handler_of(where: WaitFor) -> str:
    """Return the handler that has a query: ``arm`` or ``legs (queued, busy with walk {3})``."""
    handler = place(where.module, where.resource)
    if where.kind is WaitKind.RESOURCE:
        return f"{handler} (queued{_blocked_by(where.because)})"
    return handler


def _resume(waits: _WaitGroup) -> str:
    wait, ago = waits.first, ""
    if waits.now is not None and wait.seconds is not None:
        ago = f" {duration(max(waits.now - wait.seconds, 0.0))} ago"
    by = f"{suspended_by(wait.module, since_birth=wait.since_birth)}{ago}"
    shown = f" ({by})" if by_whom(wait.module) or ago else ""
    return f"until {waits.names if wait.number else 'it'} is resumed{shown}"


def _condition(waits: _WaitGroup) -> str:
    if not waits.first.name:
        return "until it is fired"
    last_test = {None: "not tested yet", False: "did not hold last time", True: "held last time"}
    return f"for its condition {waits.names} ({last_test[waits.first.holds]})"


def _running(waits: _WaitGroup) -> str:
    first = waits.first
    handler = f"the handler of {waits.names}" if first.number else "its handler"
    where = f" in {waits.place}" if first.module and waits.number == 1 else ""
    waiting = f", which waits {several_in_words(first.because)}" if first.because else ""
    ends = "sends its later reply" if first.is_owed else "returns"
    return f"until {handler}{where} {ends}{waiting}"


_RESOURCE_KINDS = (WaitKind.RESOURCE, WaitKind.LOCK)
_GROUPED_KINDS = frozenset(
    (
        WaitKind.CONSTRAINT,
        WaitKind.SUBTASK,
        WaitKind.TASK,
        WaitKind.HANDLER,
        WaitKind.PRESENCE,
        WaitKind.REPLY,
        WaitKind.RUNNING,
        WaitKind.CHANGE,
    )
)
"""Waits of one of these kinds share one clause."""

_WORDS: dict[WaitKind, Callable[[_WaitGroup], str]] = {
    WaitKind.CONSTRAINT: _point,
    WaitKind.SUBTASK: _point,
    WaitKind.TASK: _point,
    WaitKind.PARENT: lambda waits: f"until its parent {waits.names} {waits.reached}",
    WaitKind.LISTENER: lambda waits: (
        f"until {waits.names}, the listener of a wiretap{by_whom(waits.first.module)},"
        f" {waits.reached}"
    ),
    WaitKind.DELAY: _delay,
    WaitKind.RESOURCE: _resource,
    WaitKind.HANDLER: lambda waits: f"for a module that handles {waits.messages}",
    WaitKind.PRESENCE: lambda waits: f"for a module that handles {waits.messages}",
    WaitKind.REPLY: _reply,
    WaitKind.LOCK: _lock,
    WaitKind.RESUME: _resume,
    WaitKind.RECOVERY: lambda waits: (
        f"until {waits.names} has dealt with its failure"
        if waits.first.number
        else "until its failure is dealt with"
    ),
    WaitKind.CHANGE: lambda waits: f"for a change of {waits.names}",
    WaitKind.CONDITION: _condition,
    WaitKind.RUNNING: _running,
    WaitKind.LOCKED: lambda waits: f"until {waits.first.module} releases {waits.first.resource}",
    WaitKind.CIRCLE: lambda waits: f"for itself, by way of {waits.names}",
}
"""The words of each kind."""
