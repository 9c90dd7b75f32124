"""Waits in English: the words after "waits". No other place has them."""

from collections.abc import Callable, Iterable, Sequence

from tca_wire.points import Moment
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration, listed, numbered, run_time
from tca_wire.waits import Waiter, WaitFor, WaitKind

_REACHED = {
    0: ("has", "ended"),
    Moment.START_HANDLING: ("is", "being handled"),
    Moment.END_HANDLING: ("has", "been handled"),
    Moment.START_PLANNING: ("is", "being planned"),
    Moment.END_PLANNING: ("is", "planned"),
    Moment.START_ACHIEVING: ("is", "being achieved"),
    Moment.END_ACHIEVING: ("is", "achieved"),
}
_OF_SEVERAL = {"is": "are", "has": "have"}

_CAUSES = 3
"""The number of causes named for one wait."""

Waits = Sequence[WaitFor]


def in_words(wait: WaitFor, now: float | None = None) -> str:
    """One wait: ``until move leg {4} is achieved``. With *now* a delay is told as how long it still takes,
    and of a suspension how long it has lasted.
    """
    return _clause([wait], now)


def several_in_words(waits: Iterable[WaitFor], now: float | None = None) -> str:
    """Several waits, grouped by kind and moment: ``until a {1} and b {2} are achieved, and for legs``."""
    return ", and ".join(clauses(waits, now))


def clauses(waits: Iterable[WaitFor], now: float | None = None) -> list[str]:
    """A clause for each group of waits."""
    groups: dict[object, list[WaitFor]] = {}
    for wait in dict.fromkeys(waits):
        is_plain = wait.kind in _TOGETHER and not wait.because
        groups.setdefault((wait.kind, wait.moment, wait.seconds) if is_plain else wait, []).append(wait)
    return [_clause(group, now) for group in groups.values()]


def waiter_in_words(waiter: Waiter) -> str:
    """The waiter: ``walk {3}``, ``walk {3} in planner``, ``module panel``, ``step {5} and 2 more``."""
    if not waiter.number:
        return f"module {waiter.module}"
    where = f" in {waiter.module}" if waiter.module else ""
    return f"{numbered(waiter.name, waiter.number)}{where}" + (f" and {waiter.more:,} more" if waiter.more else "")


def whereabouts(query: WaitFor) -> str:
    """The place of a query without an answer: ``no module handles it``, ``it is queued for arm``."""
    if len(query.because) > 1 or query.answered:
        return not_answered(query)
    where = query.because[0]
    if where.kind is WaitKind.HANDLER:
        return "no module handles it"
    if where.kind is WaitKind.RESOURCE:
        return f"it is queued {_resource([where])}"
    waits = f" and waits {several_in_words(where.because)}" if where.because else ""
    return f"{place(where.module, where.resource)} handles it{waits}"


def causes_in_words(causes: Iterable[tuple[WaitFor, float]]) -> str:
    """The causes of one wait, one after the other or at once, with how many seconds each took: ``for legs, busy with
    grip {3} (3 s); busy with move {4} (2 s); and 2 more (520 ms)``. Those that took longest are named.
    """
    lengths: dict[WaitFor, float] = {}
    for wait, seconds in causes:
        lengths[wait] = lengths.get(wait, 0.0) + seconds
    if len(lengths) == 1:
        return in_words(next(iter(lengths)))
    longest = sorted(lengths, key=lambda wait: -lengths[wait])[:_CAUSES]
    named = [wait for wait in lengths if wait in longest]
    told = [f"{in_words(named[0])} ({duration(lengths[named[0]])})"]
    for wait in named[1:]:  # words shared with the first are not repeated
        is_same = wait.kind in (WaitKind.RESOURCE, WaitKind.LOCK) and wait.because and named[0].kind is wait.kind
        told.append(f"{_keepers(wait.because) if is_same else in_words(wait)} ({duration(lengths[wait])})")
    if more := [seconds for wait, seconds in lengths.items() if wait not in longest]:
        told.append(f"and {len(more):,} more ({duration(sum(more))})")
    return "; ".join(told)


def reached(moment: int, number: int = 1) -> str:
    """The verb of so many tasks that reach a moment: ``is achieved``, ``have been handled``."""
    verb, rest = _REACHED[moment]
    return f"{verb if number == 1 else _OF_SEVERAL[verb]} {rest}"


def suspended_by(module: str, *, since_birth: bool) -> str:
    """A suspension: ``suspended by panel``, ``suspended since its birth by planner``."""
    return f"suspended{' since its birth' * since_birth}{by_whom(module)}"


def _clause(waits: Waits, now: float | None) -> str:
    if waits[0].kind is WaitKind.DELAY:
        return _delay(waits[0].seconds, now)
    if waits[0].kind is WaitKind.RESUME:
        return _resume(waits[0], now)
    return _WORDS[waits[0].kind](waits)


def _names(waits: Waits) -> str:
    return listed([numbered(one.name, one.number) for one in waits], sum(one.more for one in waits))


def _number(waits: Waits) -> int:
    return len(waits) + sum(one.more for one in waits)


def _delay(end: float | None, now: float | None) -> str:
    if end is None:
        return "until a delay is over"
    return f"until {run_time(end)}" if now is None else f"for another {duration(max(end - now, 0.0))}"


def _point(waits: Waits) -> str:
    after = f"{duration(waits[0].seconds)} after " if waits[0].seconds else ""
    return f"until {after}{_names(waits)} {reached(waits[0].moment, _number(waits))}"


def _handler(waits: Waits) -> str:
    names = listed([one.name for one in waits], sum(one.more for one in waits))
    return f"for a module that handles {names}" if _number(waits) == 1 else f"for modules that handle {names}"


def _resource(waits: Waits) -> str:
    wait = waits[0]
    others = f" (or {wait.more} more)" if wait.more else ""
    return f"for {place(wait.module, wait.resource)}{others}{_kept(wait.because)}"


def _lock(waits: Waits) -> str:
    wait = waits[0]
    of = numbered(f"{wait.name or 'lock'} of {place(wait.module, wait.resource)}", wait.number)
    return f"for the {of}{_kept(wait.because)}"


def _kept(because: Waits) -> str:
    """The users that block a resource: ``, busy with walk {3} and 2 more``, ``, which panel has locked``."""
    return f", {_keepers(because)}" if because else ""


def _keepers(because: Waits) -> str:
    running = [one for one in because if one.kind is WaitKind.RUNNING]
    parts = [f"busy with {_names(running)}"] if running else []
    parts += [f"which {_keeper(one, is_first=not running)}" for one in because if one.kind is not WaitKind.RUNNING]
    return ", and ".join(parts)


def _keeper(wait: WaitFor, *, is_first: bool) -> str:
    verb = "reserve" if wait.name == "reservation" else "lock"
    whose = ""
    if wait.because:
        message = wait.because[0]
        how = "while handling" if message.kind is WaitKind.RUNNING else "for"
        whose = f" {how} {numbered(message.name, message.number)}"
    if wait.kind is WaitKind.HANDLER:
        return "has no handler now"
    if wait.kind is WaitKind.LOCKED:
        return f"{wait.module} has {verb}{'d' if verb == 'reserve' else 'ed'}{whose}"
    return f"{wait.module} waits to {verb}{'' if is_first else ' first'}{whose}"


def _whereabouts(query: WaitFor) -> str:
    """The place of a query, ``, which no module handles``, or the missing answers to a multi-query."""
    if not query.because:
        return ""
    if len(query.because) > 1 or query.answered:
        return f", which {not_answered(query)}"
    where = query.because[0]
    if where.kind is WaitKind.HANDLER:
        return ", which no module handles"
    if where.kind is WaitKind.RESOURCE:
        return f", which is queued {_resource([where])}"
    return f", which {whereabouts(query).replace(' handles it', ' handles', 1)}"


def not_answered(query: WaitFor) -> str:
    """A multi-query's wait: ``arm and legs (queued, busy with walk {3}) have not answered (1 of 3 has)``."""
    number = len(query.because)
    told = f" ({query.answered} of {query.answered + number} {_has(query.answered)})" if query.answered else ""
    return f"{listed([_who(one) for one in query.because])} {_has(number)} not answered{told}"


def _who(where: WaitFor) -> str:
    at = place(where.module, where.resource)
    return f"{at} (queued{_kept(where.because)})" if where.kind is WaitKind.RESOURCE else at


def _has(number: int) -> str:
    return "has" if number == 1 else "have"


def _resume(wait: WaitFor, now: float | None) -> str:
    ago = f" {duration(max(now - wait.seconds, 0.0))} ago" if now is not None and wait.seconds is not None else ""
    by = f"{suspended_by(wait.module, since_birth=wait.since_birth)}{ago}" if by_whom(wait.module) or ago else ""
    if not wait.number:
        return f"until it is resumed ({by})" if by else "until it is resumed"
    return f"until {numbered(wait.name, wait.number)}{by and f', {by},'} is resumed"


def _condition(waits: Waits) -> str:
    wait = waits[0]
    if not wait.name:
        return "until it is fired"
    last = {None: "has not been tested", False: "did not hold", True: "held"}[wait.holds]
    return f"for its condition {_names(waits)}, which {last}"


def _running(waits: Waits) -> str:
    number = _number(waits)
    whose = f"the handler{'s' * (number > 1)} of {_names(waits)}" if waits[0].number else "its handler"
    whose += f" in {place(waits[0].module, waits[0].resource)}" if waits[0].module and number == 1 else ""
    on = f", which waits {several_in_words(waits[0].because)}" if waits[0].because else ""
    return f"until {whose} return{'s' * (number == 1)}{on}"


_TOGETHER = frozenset((
    WaitKind.CONSTRAINT, WaitKind.SUBTASK, WaitKind.TASK, WaitKind.HANDLER, WaitKind.PRESENCE, WaitKind.REPLY,
    WaitKind.RUNNING, WaitKind.CHANGE,
))  # fmt: skip
"""Kinds of which several are told in one clause."""

_WORDS: dict[WaitKind, Callable[[Waits], str]] = {
    WaitKind.CONSTRAINT: _point,
    WaitKind.PARENT: lambda waits: f"until its parent {_names(waits)} {reached(waits[0].moment)}",
    WaitKind.LISTENER: lambda waits: (
        f"until {_names(waits)}, the listener of a wiretap{by_whom(waits[0].module)}, {reached(waits[0].moment)}"
    ),
    WaitKind.SUBTASK: _point,
    WaitKind.RESOURCE: _resource,
    WaitKind.HANDLER: _handler,
    WaitKind.REPLY: lambda waits: (
        f"for the {'reply' if _number(waits) == 1 else 'replies'} to {_names(waits)}{_whereabouts(waits[0])}"
    ),
    WaitKind.TASK: _point,
    WaitKind.LOCK: _lock,
    WaitKind.RECOVERY: lambda waits: (
        f"until {_names(waits) if waits[0].number else 'somebody'} has dealt with its failure"
    ),
    WaitKind.CHANGE: lambda waits: f"for a change of {_names(waits)}",
    WaitKind.PRESENCE: _handler,
    WaitKind.CONDITION: _condition,
    WaitKind.RUNNING: _running,
    WaitKind.LOCKED: lambda waits: f"until {waits[0].module} releases {waits[0].resource}",
    WaitKind.CIRCLE: lambda waits: f"for itself, by way of {_names(waits)}",
}
"""One row per kind that needs no clock."""
