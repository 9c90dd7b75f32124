"""Waits as data for people (``WaitFor``), read from the graph of needs. Changes nothing.

Long lists are cut short: the first few waits are reported, with the number of the other waits.
"""

from collections.abc import Iterable, Iterator
from itertools import chain, islice
from operator import attrgetter

from msgspec.structs import replace

from tca_central.model.clock import Timer
from tca_central.model.contexts import listener_cause
from tca_central.model.deliveries import Connection, Delivery, ModuleClaim, PresenceWait
from tca_central.model.observers import Observation
from tca_central.model.resources import Claim, Resource
from tca_central.model.tasks import Task
from tca_central.needs.graph import (
    Freeing,
    Granting,
    Group,
    Node,
    Releasing,
    Returning,
    Turn,
    TurnAt,
    Waiting,
    is_within,
    needs,
    reached_together,
)
from tca_central.order.cycles import Place
from tca_central.order.holds import PendingDelay
from tca_central.state import Collector, State, TaskWait
from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    STARTS,
)
from tca_wire.vocabulary import Role
from tca_wire.waits import NAMED, WaitFor, WaitKind, first_ones
from tca_wire.waits import ends as walker

_ORDER = {WaitKind.RECOVERY: 0, WaitKind.PARENT: 2}
"""Sort keys: exception handlers that decide are reported first, the parent last (others: 1)."""
_MOST_GROUPS = 10_000
"""The number of groups of needs that are checked per node."""
_GOAL = (START_PLANNING, END_HANDLING, END_PLANNING, START_ACHIEVING)
_OTHERS = (START_ACHIEVING, END_HANDLING, END_ACHIEVING)
"""A task's moments in the order in which they are reached.

``_GOAL`` is for a goal that has not reached its start of achieving, ``_OTHERS`` for all others.
"""


def next_of(task: Task) -> Place:
    """Return the point that a task reaches next."""
    if task.killed:
        return Place(task, END_ACHIEVING)
    if not task.reached & START_HANDLING:
        return Place(task, START_PLANNING if task.is_goal else START_ACHIEVING)
    moments = _GOAL if task.is_goal and not task.reached & START_ACHIEVING else _OTHERS
    return Place(task, next(one for one in moments if not task.reached & one))


def waits_of(central: State, node: Node) -> list[WaitFor]:
    """Return the waits of a node in the order in which tools show them; [] if it needs nothing."""
    found = _compact(_waits_of_node(central, node))
    return sorted(found, key=lambda wait: _ORDER.get(wait.kind, 1))


def _waits_of_node(central: State, node: Node) -> Iterator[WaitFor]:
    """Yield the waits of a node, in any order and with repetitions."""
    match node:
        case Place():
            yield from _waits_of_place(central, node)
        case Waiting(connection, number):
            yield from _waits_of_request(central, connection, number)
        case Returning(delivery):
            yield from _waits_of_handler(central, delivery)
        case Turn(delivery):
            yield _location_of(central, delivery)
        case TurnAt(_, resource) | Freeing(resource):
            yield wait_for_resource(central, resource, node)
        case Granting(claim):
            yield _wait_of_claim(central, claim)
        case Releasing(claim):
            yield from _purpose_of(claim)


def _wait_for(kind: WaitKind, delivery: Delivery, moment: int = 0) -> WaitFor:
    """Return a wait for a message or task."""
    return WaitFor(kind, delivery.message_id, delivery.message.name, moment)


def _wait_at(
    kind: WaitKind, resource: Resource[Connection, Delivery], because: Iterable[WaitFor]
) -> WaitFor:
    """Return a wait for something at a resource."""
    module, name = resource.module, resource.name
    return WaitFor(kind, module=module, resource=name, because=tuple(because))


def _compact(waits: Iterable[WaitFor]) -> list[WaitFor]:
    """Return the first few waits of each kind and moment, with the number of the other waits."""
    groups: dict[object, list[WaitFor]] = {}
    for wait in dict.fromkeys(waits):
        groups.setdefault((wait.kind, wait.moment), []).append(wait)
    return [wait for group in groups.values() for wait in first_ones(group, len(group))]


# --- tasks ----------------------------------------------------------------------------------------


def _waits_of_place(central: State, place: Place) -> Iterator[WaitFor]:
    """Yield the waits of a point of a task, and of the task's earlier points."""
    task = place.task
    if task.slot is not None or task.queues is not None:
        yield _location_of(central, task)
        return
    for handler in _deciding(task):
        yield _wait_for(WaitKind.RECOVERY, handler, END_ACHIEVING)
    places = [place]
    for own in places:  # grows while it is walked
        children = 0
        yield from _waits_without_node(central, own)
        for group in islice(needs(central, own), _MOST_GROUPS):
            if group is None:
                continue
            if isinstance(group[0], Place) and group[0].task is task:
                own_places = (one for one in group if isinstance(one, Place))
                places += [one for one in own_places if one not in places]
                continue
            wait = wait_for_group(central, own, group)
            children += wait.kind is WaitKind.SUBTASK
            if children == NAMED:  # the others are only counted
                yield replace(wait, more=max(_count_children(own) - NAMED, 0))
                break
            yield wait


def _count_children(place: Place) -> int:
    """Return the number of subtasks that must end the same interval before a point is reached."""
    task = place.task
    if place.moment == END_PLANNING:
        return task.unplanned
    return len(task.children or ()) - len(task.background_monitors or ())


def _deciding(task: Task) -> list[Task]:
    """Return the exception handlers that a task waits for: they decide, or asked for a retry."""
    if task.recovery is None or task.killed:
        return []
    known = [task.recovery.exception_handler, *task.recovery.retry_requesters]
    return [one for one in known if one is not None and not one.reached & END_ACHIEVING]


def _waits_without_node(central: State, place: Place) -> Iterator[WaitFor]:
    """Yield the waits that the graph does not have: for time, a resume, a monitor's condition."""
    task, moment = place
    if task.killed or task.reached & moment:
        return
    is_to_be_handled = task.retry_pending or (task.slot is None and not task.returned)
    if task.suspended and (moment & STARTS or is_to_be_handled):
        yield _wait_for_resume(central, task)
    for pending, timer in task.scheduled.pending.items() if task.scheduled is not None else ():
        if (
            isinstance(pending, PendingDelay)
            and isinstance(timer, Timer)
            and pending.moment & reached_together(place)
        ):
            yield WaitFor(WaitKind.DELAY, seconds=timer.time)
    if task.watch is not None and task.watch.is_on and moment != START_PLANNING:
        yield condition_of(task)


def _wait_for_resume(central: State, task: Task) -> WaitFor:
    """Return the wait for a resume of a suspended task, or of the ancestor that was suspended."""
    for above in task.lineage():
        if (how := central.tree.suspended.get(above.id)) is not None:
            since, by, since_birth = how
            wait = _wait_for(WaitKind.RESUME, above)
            return replace(wait, module=by, seconds=since, since_birth=since_birth)
    return WaitFor(WaitKind.RESUME)


def condition_of(monitor: Task) -> WaitFor:
    """Return the wait of a monitor for its condition, with the test under way."""
    watch = monitor.watch
    assert watch is not None
    test = watch.condition
    query = watch.parts[0] if monitor.message.message_class.has_condition else None
    number, name = (test.id if test is not None else 0), (query.name if query is not None else "")
    return WaitFor(WaitKind.CONDITION, number, name, holds=watch.last_result)


def wait_for_group(central: State, node: Place, group: Group) -> WaitFor:
    """Return the wait of a point for one group of its needs."""
    match group[0]:
        case Place(other, moment):
            wait = _wait_for(_kind(node, other, moment), other, moment)
            if wait.kind is WaitKind.LISTENER:
                return replace(wait, module=next(iter(listener_cause(other).tap.holders), ""))
            return wait
        case Returning(one) | Turn(one) if one is not node.task:
            return condition_of(node.task)
        case Turn(delivery):
            return _location_of(central, delivery)
        case Freeing(resource) as freeing:
            return wait_for_resource(central, resource, freeing, len(group) - 1)
    raise AssertionError(f"{node} never waits for {group[0]}")


def _kind(node: Place, other: Task, moment: int) -> WaitKind:
    """Return the kind of wait of a point for a moment of another task."""
    task, above = node.task, other.parent
    if other is task.parent and moment & reached_together(node):
        return WaitKind.PARENT
    if other.role is Role.EXCEPTION and (above is task or other in _deciding(task)):
        return WaitKind.RECOVERY
    if other.role is Role.LISTENER:
        return WaitKind.LISTENER
    is_under = above is not None and above.is_background and other.find_above(task.id)
    if above is task or is_under:
        return WaitKind.SUBTASK
    return WaitKind.CONSTRAINT


# --- requests and handlers ------------------------------------------------------------------------


def _waits_of_handler(central: State, delivery: Delivery) -> Iterator[WaitFor]:
    """Yield the waits in which a delivery's handler blocks, and those of handlers nested in it."""
    slot = delivery.slot
    if slot is None or delivery in central.dispatcher.lending.postponed:
        return
    for number, wait in chain(slot.waits.items(), slot.unchecked_waits.items()):
        is_nested = is_within(central, wait, delivery)
        if wait.origin == delivery.handling_id if wait.is_coroutine else is_nested:
            yield from _waits_of_request(central, slot, number, is_first=False)


def _waits_of_request(
    central: State, connection: Connection, number: int, *, is_first: bool = True
) -> Iterator[WaitFor]:
    """Yield the wait for the answer to a request.

    With *is_first*, the wait for a reply includes the place where the message waits.
    """
    due = connection.outstanding.get(number)
    match due:
        case Delivery():
            because = (_location_of(central, due),) if is_first else ()
            yield replace(_wait_for(WaitKind.REPLY, due), because=because)
        case Collector():
            yield replies_to(central, due)
        case Claim():
            yield _wait_of_claim(central, due)
        case TaskWait() if (task := central.tree.tasks.get(due.task_id)) is not None:
            yield _wait_for(WaitKind.TASK, task, due.moment)
        case Observation():
            observed = central.tree.tasks.get(due.task_id)
            name = observed.message.name if observed else ""
            yield WaitFor(WaitKind.CHANGE, due.task_id, due.subject or name)
        case PresenceWait():
            missing = [one.name for one in due.messages if not one.serving]
            waits = [WaitFor(WaitKind.PRESENCE, name=name) for name in missing]
            yield from _compact(waits)


def replies_to(central: State, collector: Collector) -> WaitFor:
    """Return the wait of a multi-query for the replies to its unanswered copies."""
    copies, name = collector.pending.values(), collector.message.name
    because = tuple(_location_of(central, one, is_first=False) for one in copies)
    reply = WaitFor(WaitKind.REPLY, collector.id, name, because=because)
    return replace(reply, answered=collector.answered)


def _location_of(central: State, delivery: Delivery, *, is_first: bool = True) -> WaitFor:
    """Return where a message waits: with a handler, in a queue, or for want of a handler.

    With *is_first*, the waits of its handler are included.
    """
    if delivery.slot is not None and (resource := delivery.slot.resource) is not None:
        waits = _waits_of_handler(central, delivery) if is_first else ()
        is_owed = delivery in central.dispatcher.lending.postponed
        return replace(_wait_at(WaitKind.RUNNING, resource, waits), is_owed=is_owed)
    if not delivery.queues:
        return WaitFor(WaitKind.HANDLER, name=delivery.message.name)
    resource, *others = delivery.queues
    return wait_for_resource(central, resource, TurnAt(delivery, resource), len(others))


# --- resources ------------------------------------------------------------------------------------


def wait_for_resource(
    central: State, resource: Resource[Connection, Delivery], node: Node, more: int = 0
) -> WaitFor:
    """Return the wait of a node for a resource. *more* other resources would do as well."""
    because = _blockers(central, node) if resource.slots else [WaitFor(WaitKind.HANDLER)]
    return replace(_wait_at(WaitKind.RESOURCE, resource, because), more=more)


def _wait_of_claim(central: State, claim: ModuleClaim) -> WaitFor:
    """Return the wait of a claim for its resource."""
    lock = _wait_at(WaitKind.LOCK, claim.resource, _blockers(central, Granting(claim)))
    return replace(lock, number=claim.id, name=claim_noun(claim))


def _blockers(central: State, node: Node) -> list[WaitFor]:
    """Return the waits for a resource's messages, its lock or reservation, and earlier claims."""
    found = []
    groups = islice(needs(central, node), _MOST_GROUPS)
    for needed in chain.from_iterable(group or () for group in groups):
        match needed:
            case Freeing():
                found += _blockers(central, needed)
            case Returning(delivery):
                found.append(_wait_for(WaitKind.RUNNING, delivery))
            case Granting(claim):
                found.append(_claim_wait(claim, WaitKind.LOCK))
            case Releasing(claim):
                found.append(_claim_wait(claim, WaitKind.LOCKED))
    return _compact(found)


def _claim_wait(claim: ModuleClaim, kind: WaitKind) -> WaitFor:
    """Return the wait of a message or later claim for *claim*."""
    module = claim.slot.module.name
    return WaitFor(kind, 0, claim_noun(claim), module=module, because=_purpose_of(claim))


def _purpose_of(claim: ModuleClaim) -> tuple[WaitFor, ...]:
    """Return the message for which a claim was made, if any, as a wait."""
    holder = claim.holder
    if holder is None:
        return ()
    kind = WaitKind.RUNNING if holder.slot is not None else WaitKind.TASK
    return (_wait_for(kind, holder),)


def claim_noun(claim: ModuleClaim) -> str:
    """Return the word for a claim."""
    return "reservation" if claim.admits_owner else "lock"


# --- final waits ----------------------------------------------------------------------------------


def _start_of(node: Node) -> Node:
    """Return the task's start for a point of a task that has not started; else the node itself."""
    if not isinstance(node, Place) or node.task.reached & START_HANDLING or node.task.killed:
        return node
    return next_of(node.task)


class Ends:
    """Final waits, found by following the first wait of each node.

    All searches of one ``Ends`` object together visit at most *edges* edges.
    """

    def __init__(self, central: State, edges: int) -> None:
        self.edges = edges
        self._central = central
        self._walk: walker.Ends[Node, WaitFor] = walker.Ends(self)

    def end_of(self, node: Node) -> WaitFor | None:
        """Return the final wait of a node; None if it is too far away."""
        try:
            return self._walk.of(node)[0]
        except walker.TooFarError:
            return None

    def steps(self, node: Node) -> tuple[list[Node], list[WaitFor]]:
        """Return the node that *node* needs first. If there is none, return its final wait."""
        for group in needs(self._central, node):
            self._count_edge()
            if group is not None:
                return [_start_of(group[0])], []
        self._count_edge()
        return [], [self._final_wait(node)]

    def _count_edge(self) -> None:
        if self.edges <= 0:
            raise walker.TooFarError
        self.edges -= 1

    def circle(self, nodes: list[Node]) -> WaitFor:
        """Return the wait for a cycle of nodes, named after the oldest task in the cycle."""
        tasks = [one.task for one in nodes if isinstance(one, Place)]
        first = min(tasks, key=attrgetter("id"), default=None)
        return _wait_for(WaitKind.CIRCLE, first) if first else WaitFor(WaitKind.CIRCLE)

    def _final_wait(self, node: Node) -> WaitFor:
        """Return the final wait at a node that needs nothing."""
        match node:
            case Returning(delivery):
                where, message = _location_of(self._central, delivery), delivery.message
                return replace(where, number=delivery.message_id, name=message.name)
            case Releasing(claim):
                locked = _claim_wait(claim, WaitKind.LOCKED)
                return replace(locked, resource=claim.resource.name)
            case Place(task, _) if task.queues is not None:
                return _location_of(self._central, task)
            case Place(task, moment):
                reached = _wait_for(WaitKind.CONSTRAINT, task, moment)
                return next(_waits_without_node(self._central, node), reached)
            case _:
                return [*waits_of(self._central, node), WaitFor(WaitKind.RUNNING)][0]
