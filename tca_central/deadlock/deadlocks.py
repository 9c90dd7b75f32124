"""Deadlocks: waits that can never end. Central ends one of the waits with a failure.

Theory of operation. search.py finds nodes of the graph of needs that can never come about, because
they wait, in the end, for themselves. The newest wait of a handler in such a cycle is refused
("deadlock"), and the handler gets an error that names the cycle. If only tasks wait for each other,
the failure "deadlock" is raised on a task that holds a lock or reservation. If no exception handler
helps, the lock is revoked. The lock is revoked at once if an exception handler, or a message that
leaves things safe, waits in the cycle: such tasks have priority.

Central searches at once from a new wait of a connection and from a queued message. Other changes (a
subtask, a constraint, a lost slot) may close a cycle too. Central finds such a cycle shortly after,
with a search of all waits. That search works in slices, so that central is never held up. Each
cycle contains a waiting handler, a lock or a reservation. A connection that handles and claims
nothing is in no cycle, because nothing waits for the connection.
"""

from contextlib import suppress
from itertools import pairwise
from math import inf

from msgspec.structs import replace

from tca_central.control.revoking import revoke_and_warn, task_holding
from tca_central.deadlock.search import Search, TooLongError
from tca_central.failing.failures import raise_failure
from tca_central.locks.claims import revoke
from tca_central.model.contexts import RaisedFailure, trouble_of
from tca_central.model.deliveries import Connection, Delivery, ModuleClaim
from tca_central.model.resources import Claim
from tca_central.model.tasks import Task
from tca_central.needs.graph import (
    Freeing,
    Granting,
    Node,
    Releasing,
    Returning,
    Turn,
    TurnAt,
    Waiting,
)
from tca_central.needs.waits import claim_noun, wait_for_group, waits_of
from tca_central.order.cycles import Place
from tca_central.order.dispatcher import Suspect
from tca_central.order.lending import MOST_IN_SLOT, may_be_lent
from tca_central.requests.waiting import give_up
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.messages.failures import DEADLOCK
from tca_wire.packets.headers import Refused
from tca_wire.points import END_ACHIEVING
from tca_wire.text.waits_in_words import several_in_words, waiter_in_words
from tca_wire.vocabulary import Dropping, Due, Refusal, Role
from tca_wire.waits import Waiter, WaitFor, WaitKind

PATIENCE = 1000
"""The number of edges visited at most in the event in which a wait begins."""

SLICE = 2000
"""The number of edges visited at most in one slice of a later search.

A slice takes some milliseconds, and there are four slices a second.
"""

_CLOSES_NOTHING = {facts.Queued, facts.Delivered, facts.Answered, facts.Awaited, facts.WaitBegan}
"""Kinds of facts that begin no wait, or whose waits central checks as suspects anyway."""

_CALLS = ((Waiting, Returning), (Returning, Waiting))
"""Neighbours in a cycle: a wait and the handler that answers it, or a handler and its wait."""

_SHOWN = 12  # parts of a cycle that the error names

TaskClaims = dict[ModuleClaim, Task]
"""Claims that no handler releases, each with the task whose end releases it."""


class DeadlockScan:
    """A search of all waits, in slices."""

    def __init__(self, central: State) -> None:
        self.search = Search(central, SLICE, list)
        self.starts: list[Node | Connection] = [*central.blocked]
        """The nodes still to check, the next one last. A connection stands for all its waits."""
        granted = (claim for claim in central.claims.values() if claim.is_granted)
        self.starts.extend(Releasing(claim) for claim in granted)
        self.starts.reverse()


def check_suspects(central: State) -> None:
    """Check whether new waits can ever end. Without searches for deadlocks, only lend slots."""
    search: Search | None = None
    try:
        while central.suspects:
            start = _may_close(central, central.suspects.popleft())
            if start is not None:
                search = search or Search(central, PATIENCE)
                search = _resolve_all(central, search, start)
    except TooLongError:
        central.suspects.clear()
        schedule_search(central)


def _may_close(central: State, suspect: Suspect) -> Node | None:
    """Return the node at which a suspect may have closed a cycle; None if it can't have."""
    if isinstance(suspect, Claim):
        return Releasing(suspect)
    if isinstance(suspect, Delivery):
        return Turn(suspect)
    connection, number = suspect
    awaited = connection.outstanding.get(number)
    slot = awaited.slot if isinstance(awaited, Delivery) else None
    if awaited is None or (slot is not None and not slot.waits):
        return None  # the request was answered, or a handler that does not block handles it
    claims = central.claims.values()
    if connection.handling or any(claim.slot is connection for claim in claims):
        return Waiting(connection, number)
    return None


def check_event(central: State) -> None:
    """Schedule a search if a fact of the event may have closed a cycle."""
    if not central.may_have_closed:
        for fact in central.facts:
            if type(fact) not in _CLOSES_NOTHING and _may_matter(central, fact):
                schedule_search(central)
                return


def _may_matter(central: State, fact: facts.Fact) -> bool:
    """Whether a fact may close a cycle. Most kinds may; two of them only in some cases.

    The end of a handler may if observers wait for the state of its task. A new message may if it is
    a task.
    """
    if isinstance(fact, facts.Returned):
        return central.observers.count > 0
    return not isinstance(fact, facts.Received) or fact.message_class.is_task


def schedule_search(central: State) -> None:
    """Schedule a search of all waits, because something may have closed a cycle."""
    central.may_have_closed = True
    _set_search_timer(central)


def _set_search_timer(central: State) -> None:
    """Set the timer of the next search, unless the timer is set already."""
    if central.search_delay and central.search_timer is None:
        central.search_timer = central.clock.after(central.search_delay, Due.LOOK, None)


def on_search_due(central: State, _: None) -> None:
    """Begin a search of all waits, or continue a search."""
    central.search_timer, scan = None, central.scan
    if isinstance(scan, DeadlockScan):
        scan.search.resume(SLICE)
    else:
        central.scan = scan = DeadlockScan(central)
        central.may_have_closed = False
    with suppress(TooLongError):
        while scan.starts:
            _check_next(central, scan)
        central.scan = None
    if central.scan is not None or central.may_have_closed:
        _set_search_timer(central)


def _check_next(central: State, scan: DeadlockScan) -> None:
    """Check the next node of a search."""
    start = scan.starts[-1]
    if isinstance(start, Connection):
        scan.search.count_edge()
        scan.starts.pop()
        if start.handling:
            scan.starts.extend(Waiting(start, number) for number in reversed(start.waits))
        return
    if _still_exists(start):
        scan.search = _resolve_all(central, scan.search, start)
    elif scan.search.is_under_way:  # *start* has ended: the rest of its search is not needed
        scan.search = scan.search.restarted()
    scan.starts.pop()


def _still_exists(start: Node) -> bool:
    """Whether a wait or claim from which a search starts still exists."""
    if isinstance(start, Releasing):
        return start.claim.is_granted
    return not isinstance(start, Waiting) or start.number in start.connection.waits


# --- the remedy -----------------------------------------------------------------------------------


def _resolve_all(central: State, search: Search, start: Node) -> Search:
    """End waits as long as *start* leads to a cycle. Return the last search, for reuse."""
    while search.is_stuck(start):
        if not _resolve(central, search.cycle(start), search):
            break
        search = search.restarted()
    return search


def _resolve(central: State, cycle: list[Node], search: Search) -> bool:
    """End a wait or a claim of a cycle, or raise a failure for the cycle.

    Returns False if nothing was done (see ``_raise_or_revoke``).
    """
    if (lent := _find_to_lend(central, cycle)) is not None:
        queued, slot = lent
        # Another handler within the wait may go on. Its own wait or end starts the next search.
        # After a restart, tasks may be paused. Then their release starts it.
        can_lend = not central.dispatcher.are_tasks_paused and any(
            search.is_stuck(Waiting(slot, number))
            for number in central.dispatcher.lending.waits_of(slot)
        )
        if can_lend:
            central.dispatcher.lend(queued, slot)
        return can_lend
    if not central.search_delay:
        return False
    text = describe(central, cycle)
    waits = [node for node in cycle if isinstance(node, Waiting)]
    claims = (node.claim for node in cycle if isinstance(node, Releasing))
    task_claims = {claim: task for claim in claims if (task := task_holding(claim)) is not None}
    in_recovery = _nodes_in_recovery(central, cycle)
    if task_claims and in_recovery:  # recovery has priority: claims of recovery are revoked last
        known: dict[Task, bool] = {}
        claim = min(task_claims, key=lambda claim: _is_recovery(task_claims[claim], known))
        revoke_and_warn(central, claim, f"{DEADLOCK}: {text}", DEADLOCK, text)
    elif waits:
        refused = [wait for wait in waits if wait not in in_recovery] or waits
        connection, number = max(refused, key=_since)
        fact = facts.RequestRefused(connection.module.name, Refusal.DEADLOCK, text)
        central.facts.append(fact)
        give_up(central, connection, number, Dropping.DEADLOCK)
        central.answer(connection, number, Refused(number, Refusal.DEADLOCK, text))
    else:
        return _raise_or_revoke(central, task_claims, search, text)
    return True


def _find_to_lend(
    central: State, cycle: list[Node], most: float = MOST_IN_SLOT
) -> tuple[Task, Connection] | None:
    """Return a task that waits for a slot of a cycle, and this slot; None if there is no such task.

    The slot can handle the task within its handler's wait. It does so for no other message: a
    handler expects no message of others during its wait.
    """
    queued: Delivery | None = None
    for node, following in pairwise([*cycle, *cycle, cycle[0]]):
        match node:
            case Turn() | TurnAt() | Place():
                queued = _delivery_of(central, node)
            case Returning(handler) if isinstance(following, Waiting):
                slot = following.connection
                resource = slot.resource
                if (
                    isinstance(queued, Task)
                    and handler.slot is slot
                    and resource is not None
                    and resource in (queued.queues or ())
                    and may_be_lent(slot, resource, most)
                ):
                    return queued, slot
                queued = None
            case Freeing() | Granting():
                pass
            case _:
                queued = None
    return None


def _since(wait: Waiting) -> int:
    """Return the event in which a wait began."""
    return wait.connection.waits[wait.number].since


def _raise_or_revoke(central: State, task_claims: TaskClaims, search: Search, text: str) -> bool:
    """Resolve a cycle in which no handler blocks: raise the failure on a claim's holder.

    If the failure was raised on all holders before, revoke a claim. Returns False if the failure is
    already being handled, or if no task of the cycle holds a claim.
    """
    if not task_claims or any(_is_being_handled(task, search) for task in task_claims.values()):
        return False
    for task in task_claims.values():
        if task.failure is None or task.failure[0] != DEADLOCK:
            raise_failure(central, task, RaisedFailure(DEADLOCK, text))
            return True
    revoke(central, next(iter(task_claims)), f"{DEADLOCK}: {text}", f"{DEADLOCK}: {text}")
    return True


def _is_being_handled(task: Task, search: Search) -> bool:
    """Whether an exception handler handles a deadlock of a task, and is not stuck itself."""
    return any(
        child.role is Role.EXCEPTION
        and trouble_of(child).failure.name == DEADLOCK
        and not search.is_stuck(Place(child, END_ACHIEVING))
        for child in (task.children or {}).values()
    )


def _nodes_in_recovery(central: State, cycle: list[Node]) -> set[Node]:
    """Return the nodes of a cycle that belong to recovery.

    Recovery means the tasks that handle failures or leave things safe, and their descendants. Their
    waits belong to recovery too, and so do the handlers that answer these waits.
    """
    found: set[Node] = set()
    known: dict[Task, bool] = {}
    previous = cycle[-1]
    for node in cycle + cycle:  # twice, since the last node may decide about the first
        is_call = (type(previous), type(node)) in _CALLS
        if (previous in found and is_call) or _is_recovery(_delivery_of(central, node), known):
            found.add(node)
        previous = node
    return found


def _delivery_of(central: State, node: Node) -> Delivery | None:
    """Return the delivery of a node; None for resources and claims."""
    match node:
        case Place(task, _):
            return task
        case Returning(delivery) | Turn(delivery) | TurnAt(delivery, _):
            return delivery
        case Waiting(connection, number):
            return central.dispatcher.running.get(connection.waits[number].origin)
    return None


def _is_recovery(delivery: Delivery | None, known: dict[Task, bool]) -> bool:
    """Whether a task handles a failure or leaves things safe, or whether an ancestor does.

    *known* stores the results for the task and its ancestors.
    """
    walked: list[Task] = []
    result = False
    for above in delivery.lineage() if isinstance(delivery, Task) else ():
        walked.append(above)
        result = known.get(above, above.role.survives)
        if result or above in known:
            break
    known.update(dict.fromkeys(walked, result))
    return result


# --- words ----------------------------------------------------------------------------------------


def describe(central: State, cycle: list[Node]) -> str:
    """Describe a cycle in words, from the first handler that waits."""
    first = next((at for at, node in enumerate(cycle) if isinstance(node, Waiting)), 0)
    cycle = cycle[first:] + cycle[:first]
    sentences: dict[str, None] = {}
    for node, following in pairwise([*cycle, cycle[0]]):
        waits = _waits(central, node, following)
        if waits is not None:
            sentences[
                f"{waiter_in_words(_waiter(central, node))} waits {several_in_words(waits)}"
            ] = None
    more = f"; and {len(sentences) - _SHOWN} more" if len(sentences) > _SHOWN else ""
    shown = "; ".join([*sentences][:_SHOWN])
    if _find_to_lend(central, cycle, inf) is not None:  # only the limit keeps the task out
        how = f"the waits are nested deeper than {MOST_IN_SLOT} in one slot"
        return f"{how}: {shown}{more}. Handle some of these messages in another resource"
    return f"each waits for the next, in a cycle: {shown}{more}. {_remedy(cycle)}"


def _remedy(cycle: list[Node]) -> str:
    """Return what a programmer can do about a cycle."""
    for node in cycle:
        if isinstance(node, Releasing | Granting):
            return f"Release the {claim_noun(node.claim)} before the wait"
    for node in cycle:
        if isinstance(node, Freeing | TurnAt):
            where = f"resource '{node.resource.name}' of '{node.resource.module}'"
            return f"Give {where} one more slot, or move a handler to another resource"
    return "Remove one of these waits or constraints"


def _waits(central: State, node: Node, following: Node) -> list[WaitFor] | None:
    """Return the waits of a node of a cycle; None if the text for another node includes them."""
    match node, following:
        case Waiting(), _:
            waits = waits_of(central, node)
            if waits and waits[0].kind is WaitKind.REPLY:
                return [replace(waits[0], because=())]  # the next node says where the query is
            return waits
        case ((Granting() | TurnAt()), _):
            return waits_of(central, node)
        case Releasing(claim), Place(task, _) if task is not claim.holder:
            # The claim ends when its holder is retried. The retry waits for the subtask *task*.
            return [WaitFor(WaitKind.SUBTASK, task.id, task.message.name)]
        case Place(task, _), _ if _delivery_of(central, following) is not task:
            return [wait_for_group(central, node, [following])]
    return None


def _waiter(central: State, node: Node) -> Waiter:
    """Return the task, message or module that waits at a node."""
    subject, module = _delivery_of(central, node), ""
    match node:
        case Waiting(connection, _):
            module = connection.module.name
        case Granting(claim):
            subject, module = claim.holder, claim.slot.module.name
        case Releasing(claim):
            subject = claim.holder
        case TurnAt(delivery, _):
            subject = delivery
    number, name = (subject.message_id, subject.message.name) if subject is not None else (0, "")
    return Waiter(number, name, module)
