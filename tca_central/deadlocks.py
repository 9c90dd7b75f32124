"""Deadlocks: waits that can never end, found when they begin and ended with a failure that names the circle.

Theory of operation. A node of the graph in needs.py is *live* if of each group that it needs one node is live; the
least fixpoint, found forwards from the wait that has just begun, or the message that was just queued. What is not
live waits, in the end, for itself. The newest handler's wait in the circle is refused ("deadlock"), and its handler
gets an error; where only tasks wait for each other the failure is raised on one that keeps a lock or reservation. That
is taken from it where its exception handler does not help, or where an exception handler, or what leaves things safe,
waits in the circle: those go first. Whatever else may close a circle (a subtask, a constraint, a slot that is lost) is
found shortly after, by a look at all that blocks. A search that would take long gives up, and is repeated later with
more patience.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from tca_central.claims import take
from tca_central.clock import Due
from tca_central.cycles import Place
from tca_central.failures import raise_failure
from tca_central.giving_up import give_up
from tca_central.needs import Granting, Node, Releasing, Returning, Turn, TurnAt, Waiting, needs
from tca_central.registry import Connection, Delivery
from tca_central.resources import Claim
from tca_central.state import Failure, State
from tca_central.taking import is_kept, take_away
from tca_central.task_tree import Task
from tca_wire import facts
from tca_wire.failures import DEADLOCK
from tca_wire.headers import Refused
from tca_wire.points import END_ACHIEVING, describe_moments
from tca_wire.vocabulary import Refusal, Role

PATIENCE = 1000
"""Nodes that are looked at when a wait begins."""

MOST_EFFORT = 16
"""How many times longer than usual a later look may take, so that central is not held up: some 32 000 nodes, a tenth of
a second."""

_SHOWN = 12  # parts of a circle that the error names


def look(central: State) -> None:
    """See whether what has just begun to wait will ever get what it waits for."""
    if not central.look_after:
        central.suspects.clear()
    while central.suspects:
        start = central.suspects.popleft()
        with suppress(_TooLongError):
            if isinstance(start, Claim):
                _resolve_all(central, Releasing(start), PATIENCE)
            elif isinstance(start, Delivery):
                _resolve_all(central, Turn(start), PATIENCE)
            elif not _is_answered_soon(*start):
                _resolve_all(central, Waiting(*start), PATIENCE)


def look_later(central: State) -> None:
    """Something has happened while somebody blocks."""
    if central.look_after and central.next_look is None:
        central.next_look = central.clock.after(central.look_after * central.look_effort, Due.LOOK, None)


def on_look(central: State, _: None) -> None:
    """Look at all that blocks."""
    central.next_look = None
    patience = 2 * PATIENCE * central.look_effort
    try:
        for node in list(_all_that_block(central)):
            _resolve_all(central, node, patience)
        central.look_effort = 1
    except _TooLongError:
        central.look_effort = min(2 * central.look_effort, MOST_EFFORT)
        look_later(central)


def _all_that_block(central: State) -> Iterator[Node]:
    for connection in central.blocked:
        yield from (Waiting(connection, number) for number in connection.waits)
    yield from (Releasing(claim) for claim in central.claims.values() if claim.is_granted)


def _is_answered_soon(connection: Connection, number: int) -> bool:
    """Whether it is plain that a request will be answered: it was, or a handler that nothing blocks is about to."""
    due = connection.outstanding.get(number)
    return due is None or (isinstance(due, Delivery) and due.slot is not None and not due.slot.waits)


# --- the search ------------------------------------------------------------------------------------------------------


class _TooLongError(Exception):
    """The search would take longer than it may."""


Stuck = dict[Node, list[Sequence[Node]]]
"""Nodes that are not live, and what they need."""


def _stuck(central: State, start: Node, patience: int) -> Stuck:
    """All that *start* waits for and that is not live; nothing if *start* is live."""
    needed: Stuck = {}
    waiting: dict[Node, int] = {}  # by node that was looked at, the number of groups without a live node
    wanted_by: dict[Node, list[tuple[Node, int]]] = {}
    met: set[tuple[Node, int]] = set()
    frontier, seen = [start], {start}
    while frontier and waiting.get(start, 1):
        if len(waiting) >= patience:
            raise _TooLongError
        node = frontier.pop()
        needed[node] = [group for group in needs(central, node) if all(waiting.get(other, 1) for other in group)]
        waiting[node] = len(needed[node])
        for index, group in enumerate(needed[node]):
            for other in group:
                wanted_by.setdefault(other, []).append((node, index))
            new = [other for other in group if other not in seen]
            seen.update(new)
            frontier += new
        newly_live = [] if waiting[node] else [node]
        for live in newly_live:  # grows while it is walked
            for user in wanted_by.get(live, ()):
                if user not in met:
                    met.add(user)
                    waiting[user[0]] -= 1
                    if not waiting[user[0]]:
                        newly_live.append(user[0])
    return {node: groups for node, groups in needed.items() if waiting[node]} if waiting[start] else {}


def _circle(start: Node, stuck: Stuck) -> list[Node]:
    """A circle that *start* waits for, in its order."""
    trail: dict[Node, int] = {}
    node = start
    while node not in trail:
        trail[node] = len(trail)
        node = next(group[0] for group in stuck[node] if all(other in stuck for other in group))
    return list(trail)[trail[node] :]


# --- what is done about it -------------------------------------------------------------------------------------------


def _resolve_all(central: State, start: Node, patience: int) -> None:
    """End waits as long as *start* waits for a circle."""
    while stuck := _stuck(central, start, patience):
        if not _resolve(central, _circle(start, stuck), stuck):
            return


def _resolve(central: State, circle: list[Node], stuck: Stuck) -> bool:
    """End a wait or a claim of a circle, or raise a failure for it; False if what was raised is being seen to."""
    text = describe(central, circle)
    waits = [node for node in circle if isinstance(node, Waiting)]
    kept = [node.claim for node in circle if isinstance(node, Releasing) and is_kept(node.claim)]
    goes_first = _of_recovery(central, circle)
    if kept and goes_first:
        _take_from_others(central, kept, text)
    elif waits:
        refused = [wait for wait in waits if wait not in goes_first] or waits
        connection, number = max(refused, key=lambda node: node.connection.waits[node.number].since)
        _refuse(central, connection, number, text)
    else:
        return _raise_or_take(central, kept, stuck, text)
    return True


def _raise_or_take(central: State, kept: list[Claim[Connection]], stuck: Stuck, text: str) -> bool:
    """Nobody blocks: who keeps what others need is told and, if no exception handler helps, loses it."""
    if not kept or any(_is_seen_to(claim.holder, stuck) for claim in kept):
        return False
    told = next((claim.holder for claim in kept if not _was_told(claim.holder)), None)
    if told is not None:
        raise_failure(central, told, Failure(DEADLOCK, text))
    else:
        take(central, kept[0], f"{DEADLOCK}: {text}", f"{DEADLOCK}: {text}")
    return True


def _take_from_others(central: State, kept: list[Claim[Connection]], text: str) -> None:
    """Recovery and safe ends go first: somebody loses what they need. Who knows of no trouble is told."""
    claim = min(kept, key=lambda claim: any(above.role.survives for above in claim.holder.lineage()))
    take_away(central, claim, f"{DEADLOCK}: {text}", DEADLOCK, text)


def _was_told(task: Task) -> bool:
    return task.failure is not None and task.failure[0] == DEADLOCK


def _is_seen_to(task: Task, stuck: Stuck) -> bool:
    """Whether an exception handler that is not stuck itself is about a deadlock of a task."""
    return any(
        child.role is Role.EXCEPTION
        and child.context.failure.name == DEADLOCK
        and Place(child, END_ACHIEVING) not in stuck
        for child in (task.children or {}).values()
    )


def _of_recovery(central: State, circle: list[Node]) -> set[Node]:
    """What of a circle belongs to an exception handler or to what leaves things safe: such tasks and all under them,
    their waits, and the waits of whoever answers their questions.
    """
    found: set[Node] = set()
    known: dict[Task, bool] = {}
    before = circle[-1]
    for node in circle + circle:
        is_asked = isinstance(before, Waiting) and isinstance(node, Returning)
        asks_on = isinstance(before, Returning) and isinstance(node, Waiting)
        if (before in found and (is_asked or asks_on)) or _recovers(_whose(central, node), known):
            found.add(node)
        before = node
    return found


def _whose(central: State, node: Node) -> Delivery | None:
    match node:
        case Place(task, _):
            return task
        case Returning(delivery) | Turn(delivery):
            return delivery
        case Waiting(connection, number):
            return central.dispatcher.attended.get(connection.waits[number].origin)
    return None


def _recovers(delivery: Delivery | None, known: dict[Task, bool]) -> bool:
    """Whether a task handles a failure, leaves things safe, or is under one that does."""
    passed: list[Task] = []
    does = False
    for above in delivery.lineage() if isinstance(delivery, Task) else ():
        passed.append(above)
        does = known.get(above, above.role.survives)
        if does or above in known:
            break
    known.update(dict.fromkeys(passed, does))
    return does


def _refuse(central: State, connection: Connection, number: int, text: str) -> None:
    central.facts.append(facts.RequestRefused(connection.module.name, Refusal.DEADLOCK, text))
    give_up(central, connection, number, DEADLOCK)
    central.send(connection, number, Refused(number, Refusal.DEADLOCK, text))


# --- words -----------------------------------------------------------------------------------------------------------


def describe(central: State, circle: list[Node]) -> str:
    """The circle in words, from the first handler that waits."""
    first = next((index for index, node in enumerate(circle) if isinstance(node, Waiting)), 0)
    circle = circle[first:] + circle[:first]
    said = [_words(central, node, circle[(index + 1) % len(circle)]) for index, node in enumerate(circle)]
    parts = list(dict.fromkeys(filter(None, said)))
    more = f"; and {len(parts) - _SHOWN} more" if len(parts) > _SHOWN else ""
    return f"each waits for the next, in a circle: {'; '.join(parts[:_SHOWN])}{more}"


def _words(central: State, node: Node, following: Node) -> str:
    match node:
        case Waiting(connection, number):
            return f"{_who(central, connection, number)} waits {_for_what(following)}"
        case TurnAt(delivery, resource):
            return f"{_name(delivery)} waits for resource '{resource.name}'"
        case Releasing(claim):
            kind = "reserved" if claim.admits_owner else "locked"
            until = f" until {_name(claim.holder)} has ended" if claim.holder is not None else ""
            if isinstance(following, Place) and following.task is not claim.holder:
                until = f" until {_name(claim.holder)} is handled again, after {_name(following.task)} has ended"
            return f"'{claim.resource.name}' is {kind} by module '{claim.slot.module.name}'{until}"
        case Place(task, _) if isinstance(following, Place) and following.task is not task:
            return f"{_name(task)} waits until {_point(following)}"
        case Place(task, _) if isinstance(following, Returning | Turn) and following.delivery is not task:
            return f"{_name(task)} waits for the reply to its condition {_name(following.delivery)}"
    return ""


def _who(central: State, connection: Connection, number: int) -> str:
    delivery = central.dispatcher.attended.get(connection.waits[number].origin)
    return f"module '{connection.module.name}'" + (f" in {_name(delivery)}" if delivery is not None else "")


def _for_what(following: Node) -> str:
    match following:
        case Returning(delivery) | Turn(delivery):
            return f"for the reply to {_name(delivery)}"
        case Granting(claim):
            return f"to {'reserve' if claim.admits_owner else 'lock'} '{claim.resource.name}'"
        case Place():
            return f"until {_point(following)}"
    return "for what is to come"


def _name(delivery: Delivery) -> str:
    return f"'{delivery.message.name}' {{{delivery.id}}}"


def _point(place: Place) -> str:
    return f"{_name(place.task)} has reached {describe_moments(place.moment)[0]}"
