"""The graph of needs: what each handler, message, resource, claim and point of a task waits for.

``needs`` returns the needs of a node as groups of nodes. The node comes about when one node of each
group has come about. A node without groups comes about without help, as far as central knows. For
example, a running handler may return, a suspended task may be resumed, or time passes. The graph
therefore never shows an endless wait where there may be an end.

Groups are yielded one by one, so that a search can stop at any time. A node may need a million
other nodes. For each edge that was checked and holds nothing back, ``None`` is yielded, so that
each step takes little time.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple, Never, cast

from tca_central.model.deliveries import Connection, Delivery, ModuleClaim, ModuleResource
from tca_central.model.intervals import SINGLE_MOMENTS, delivered_at
from tca_central.model.observers import Observation
from tca_central.model.resources import Claim, Resource, rank
from tca_central.model.tasks import Task
from tca_central.model.values import Blocking
from tca_central.order.cycles import Each, Place, predecessors
from tca_central.state import State, TaskWait
from tca_wire.points import (
    END_ACHIEVING,
    END_HANDLING,
    END_PLANNING,
    ENDS,
    ROOT,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
    STARTS,
)

MOST_OBSERVED = 1000
"""Tasks checked per observation. With more, the next change counts as one without needs."""


class Waiting(NamedTuple):
    """The answer to a blocking request of a connection."""

    connection: Connection
    number: int


class Returning(NamedTuple):
    """The return of a delivery's handler."""

    delivery: Delivery


class Turn(NamedTuple):
    """The turn of a delivery in its queues."""

    delivery: Delivery
    kind: str = "turn"  #: makes the tuple differ from a ``Returning`` of the same delivery


class TurnAt(NamedTuple):
    """The turn of a delivery in the queue of one resource."""

    delivery: Delivery
    resource: ModuleResource


class Freeing(NamedTuple):
    """The event that a slot becomes free in a resource whose slots are all busy."""

    resource: ModuleResource


class Granting(NamedTuple):
    """The granting of a claim."""

    claim: ModuleClaim
    kind: str = "granting"  #: makes the tuple differ from a ``Releasing`` of the same claim


class Releasing(NamedTuple):
    """The end of the lock or reservation in force."""

    claim: ModuleClaim


Node = Waiting | Returning | Turn | TurnAt | Freeing | Granting | Releasing | Place
Group = Sequence[Node]
Groups = Iterator[Group | None]


def needs(central: State, node: Node, each: Each = iter) -> Groups:
    """Yield the needs of a node as groups, and None for each edge that holds nothing back.

    Use ``list`` for *each* if central may change during the walk.
    """
    return _NEEDS_OF[type(node)](central, cast("Never", node), each)


def still_needs(central: State, node: Node, group: Group) -> bool:
    """Whether a node still needs *group*, which the node needed before."""
    first, tasks = group[0], central.tree.tasks
    if isinstance(node, Place) and isinstance(first, Place) and first.task.parent is node.task:
        (task, moment), (child, its_moment) = node, first
        # This is a shortcut. There may be a million children: a walk over them takes too long.
        if moment == its_moment and moment in (END_PLANNING, END_ACHIEVING):
            is_there = tasks.get(child.id) is child and tasks.get(task.id) is task
            return is_there and not (task.reached | child.reached) & moment
    return any(one is not None and list(one) == list(group) for one in needs(central, node))


def _needs_of_wait(central: State, node: Waiting, _: Each) -> Groups:
    """Yield the needs of a request for an answer."""
    due = node.connection.outstanding.get(node.number)
    if isinstance(due, Delivery):
        if (answer := _current_node(due)) is not None:
            yield [answer]
    elif isinstance(due, Claim):
        yield [Granting(due)]
    elif isinstance(due, TaskWait):
        if (task := central.tree.tasks.get(due.task_id)) is not None:
            yield [Place(task, due.moment)]
    elif isinstance(due, Observation) and (changes := _next_changes(central, due)):
        yield changes


def _current_node(delivery: Delivery) -> Returning | Turn | None:
    """Return the node that a delivery needs next: its handler's return, or its turn in a queue.

    Returns None if the delivery is with no handler and in no queue.
    """
    if delivery.slot is not None:
        return Returning(delivery)
    return Turn(delivery) if delivery.queues else None


def _next_changes(central: State, observation: Observation) -> list[Node]:
    """Return the nodes that may bring the next change of observed tasks.

    Returns [] if a new task, a monitor's timer or a retry may bring the change, since these are not
    nodes. Kills and requests of clients are ignored, because they may never come.
    """
    tree, number = central.tree, observation.task_id or observation.below
    top = tree.tasks.get(number)
    if top is None:
        return []
    below = tree.subtree(top) if not observation.task_id else [top]
    found = list(islice(below, MOST_OBSERVED + 1))
    may_change = any(one.retry_pending or one.message.message_class.is_monitor for one in found)
    if len(found) > MOST_OBSERVED or may_change:
        return []
    return [_next_change(task) for task in found]


def _next_change(task: Task) -> Node:
    """Return the node that may bring the next change of a task."""
    moment = END_ACHIEVING if task.reached & START_HANDLING else START_HANDLING
    return _current_node(task) or Place(task, moment)


def _needs_of_handler(central: State, node: Returning, each: Each) -> Groups:
    """Yield the needs of a handler: its own waits, and the waits of handlers nested in it.

    A coroutine needs only one of the answers that it waits for. A callback of the slot may wait
    too. Its wait does not hold back a prefetched delivery that may not have begun.
    """
    delivery, slot = node.delivery, node.delivery.slot
    if slot is None or delivery in central.dispatcher.lending.postponed:
        return
    awaited: tuple[int, ...] = ()
    for number, wait in each(slot.waits.items()):
        group = wait.together or (number,)
        if wait.is_coroutine:
            awaited = wait.together if wait.origin == delivery.handling_id else awaited
            yield None
        elif is_within(central, wait, delivery) and (
            wait.origin or slot.maybe_unstarted is not delivery
        ):
            yield [Waiting(slot, one) for one in group] if group[0] == number else None
    if awaited:
        yield [Waiting(slot, number) for number in awaited]


def is_within(central: State, wait: Blocking, delivery: Delivery) -> bool:
    """Whether a thread's wait holds back a delivery's handler: its own, or one within its waits.

    An older handler of the slot may wait again before a delivery within its earlier wait begins.
    When a coroutine's thread blocks, no handler of the slot that has begun goes on.
    """
    slot = delivery.slot
    if slot is None or wait.since <= slot.handling[delivery]:
        return False
    older = central.dispatcher.running.get(wait.origin)
    began_later = older is None or slot.handling.get(older, wait.since) >= slot.handling[delivery]
    return delivery.has_begun or began_later


def _needs_of_turn(_: State, node: Turn, __: Each) -> Groups:
    """Yield the needs of a queued delivery: its turn at one of its resources."""
    if node.delivery.queues:
        yield [TurnAt(node.delivery, resource) for resource in node.delivery.queues]


def _needs_of_turn_at(_: State, node: TurnAt, each: Each) -> Groups:
    """Yield the needs of a delivery in the queue of one resource."""
    delivery, resource = node
    held_by = resource.held_by
    if held_by is not None and not resource.admits(delivery):
        yield [Releasing(held_by)]
    if held_by is None and resource.claims:
        yield from _claims_before(delivery, resource, each)
    # A query that a slot of this resource waits for needs no free slot: that slot handles it.
    if resource.slots and not resource.free and delivery not in resource.locked_out_queries:
        yield [Freeing(resource)]


def _needs_of_freeing(_: State, node: Freeing, __: Each) -> Groups:
    """Yield the needs of a resource for a free slot: the return of any of its handlers."""
    resource = node.resource
    if resource.slots and not resource.free:
        yield [_emptied(slot) for slot in resource.slots if slot.handling]


def _emptied(slot: Connection) -> Returning:
    """Return the node at which a slot becomes free: its oldest delivery returns."""
    oldest = next(iter(slot.handling))
    return Returning(next((one for one in slot.handling if not one.nested), oldest))


def _needs_of_claim(_: State, node: Granting, each: Each) -> Groups:
    """Yield the needs of a claim that is not granted."""
    claim = node.claim
    resource = claim.resource
    if claim.is_granted:
        return
    if resource.held_by is not None:
        yield [Releasing(resource.held_by)]
    for slot in (slot for copy in each(resource.copies) for slot in each(copy.slots)):
        yield [_emptied(slot)] if not slot.has_room and slot is not claim.slot else None
    yield from _claims_before(claim, resource, each)


def _claims_before(
    waiting: Delivery | ModuleClaim, resource: Resource[Connection, Delivery], each: Each
) -> Groups:
    """Yield the claims that go before a delivery or claim in a resource's queue."""
    key = rank(waiting)
    for claim in each(resource.claims):
        yield [Granting(claim)] if rank(claim) < key else None


def _needs_of_release(central: State, node: Releasing, each: Each) -> Groups:
    """Yield the needs of a granted claim's end.

    The claim's handler may release the claim. If that handler has returned, the claim ends with the
    handler's task, or when that task is retried.
    """
    claim = node.claim
    holder = claim.holder
    if not claim.is_granted:
        return
    if holder is None:
        waits = claim.slot.waits.items()
        for group in dict.fromkeys(wait.together or (number,) for number, wait in waits):
            yield [Waiting(claim.slot, number) for number in group]
    elif holder.slot is not None:
        yield [Returning(holder)]
    elif isinstance(holder, Task) and holder.retry_pending:
        children = (holder.children or {}).values() if not holder.suspended else ()
        for child in each(children):
            yield None if child.is_foreign_monitor else [Place(child, END_ACHIEVING)]
    elif isinstance(holder, Task) and central.tree.tasks.get(holder.id) is holder:
        yield [Place(holder, END_ACHIEVING)]


def _needs_of_point(central: State, place: Place, each: Each) -> Groups:
    """Yield the needs of a point of a task."""
    task, moment = place
    if task.reached & moment or (task.suspended and moment & STARTS):
        return
    if task.killed:
        yield from _needs_of_killed(central, task, moment, each)
        return
    if task.queues and is_only_queued(task):
        is_plain = all(one.held_by is None and not one.claims for one in task.queues)
        yield [Freeing(one) for one in task.queues] if is_plain else [Turn(task)]
        return
    yield from _needs_of_execution(task, moment)
    has_begun = task.reached & START_HANDLING and moment == END_HANDLING
    if has_begun and task.message.message_class.is_monitor:
        yield from _needs_of_test(task)
    yield from _needs_by_order(central, task, moment, each)


def is_only_queued(task: Task) -> bool:
    """Whether a task is in a queue, and nothing else holds any of its points.

    The graph has a shortcut for such tasks, since most subtasks of a large goal are in this state.
    """
    has_more = task.leaders or task.children or task.retry_pending or task.has_parts
    if not task.queues or has_more or task.reached & START_HANDLING or task.suspended:
        return False
    parent = task.parent
    return task.ignores_parent or parent is None or bool(parent.reached & START_ACHIEVING)


def _needs_of_test(monitor: Task) -> Groups:
    """Yield the needs of a monitor that ends after its next test or action.

    Other monitors end by time or by request, and have no needs here. A background monitor also ends
    when only such monitors are left under its parent. The oldest of the parent's other children
    stands for all other children.
    """
    watch = monitor.watch
    if watch is None or watch.condition is None or watch.options.duration:
        return
    answer, is_point = _current_node(watch.condition), not monitor.message.is_interval_monitor
    if answer is None or not (is_point or watch.options.maximum):
        return
    ends: list[Node] = [answer]
    if watch.waits_for is not None and watch.options.until is not None:
        ends.append(Place(watch.waits_for, int(watch.options.until.moment)))
    parent = monitor.parent
    if parent is not None and monitor.is_background and parent.id != ROOT:
        others = (one for one in (parent.children or {}).values() if not one.is_background)
        other = next(others, None) if parent.returned else None
        ends.append(Place(parent, END_HANDLING) if other is None else Place(other, END_ACHIEVING))
    yield ends


def _needs_of_execution(task: Task, moment: int) -> Groups:
    """Yield the needs of a point that concern the handler, queue or delivery of its task."""
    starts = STARTS if task.planning_delayed else START_HANDLING | delivered_at(task.is_goal)
    if task.slot is not None and moment & ENDS:
        yield [Returning(task)]
    elif task.queues and (moment & starts or task.reached & START_HANDLING):
        yield [Turn(task)]  # also if the task is handled again
    elif moment == START_HANDLING:
        yield [Place(task, delivered_at(task.is_goal))]


def reached_together(place: Place) -> int:
    """Return a point's moment and the moments that are reached with it, as bits.

    If planning is delayed, planning and achieving start together.
    """
    if place.task.planning_delayed and place.moment & STARTS:
        return START_PLANNING | START_ACHIEVING
    return place.moment


def _needs_by_order(central: State, task: Task, moment: int, each: Each) -> Groups:
    """Yield the points that must come before a point.

    Reasons are constraints, the order within a task, and the rules for parents and children.

    Starts that are reached together count as one point.
    """
    same = reached_together(Place(task, moment))
    for own_moment in (single for single in SINGLE_MOMENTS if single & same):
        for before in predecessors(central.tree, Place(task, own_moment), each):
            other = before.task
            is_past = other.reached & before.moment or (other is task and before.moment & same)
            is_child = other.parent is task and before.moment == END_ACHIEVING
            is_its_end = moment == END_ACHIEVING or task.retry_pending
            if is_child and is_its_end and only_watches(central, other):
                yield from _needs_of_actions(central, other)
            else:
                yield None if is_past else [before]


def only_watches(central: State, child: Task) -> bool:
    """Whether a monitor ends when only background monitors are left under its parent.

    If so, the parent waits for the tasks that the monitor has sent, but not for the monitor.
    """
    if not child.is_background or child.parent is None or child.parent.id == ROOT:
        return False
    ahead = (END_HANDLING | END_ACHIEVING) & ~child.reached if not child.killed else 0
    for moment, number, its in child.leaders or ():
        leader = central.tree.tasks.get(number) if moment & ahead else None
        if leader is None or leader is child or leader.reached & its:
            continue
        if leader.parent is not child or moment != its:  # it waits for its children's ends anyway
            return False
    return True


def _needs_of_actions(central: State, monitor: Task) -> Groups:
    """Yield the ends of the tasks that a monitor has sent, oldest first.

    If one of these tasks is a monitor that ``only_watches``, the tasks that it has sent replace it.
    """
    rest = [monitor]
    while rest:
        open_monitor = rest.pop()
        if only_watches(central, open_monitor):
            rest += reversed((open_monitor.children or {}).values())
            yield None
        else:
            yield [Place(open_monitor, END_ACHIEVING)]


def _needs_of_killed(central: State, task: Task, moment: int, each: Each) -> Groups:
    """Yield the needs of a killed task's end: its running handler, and the children not ended."""
    if task.slot is not None:
        yield [Returning(task)]
    if moment in (END_PLANNING, END_ACHIEVING):
        for child in each((task.children or {}).values()):
            if moment == END_ACHIEVING and only_watches(central, child):
                yield from _needs_of_actions(central, child)
            else:
                yield None if child.reached & moment else [Place(child, moment)]


_NEEDS_OF: dict[type, Callable[[State, Never, Each], Groups]] = {
    Place: _needs_of_point,
    Waiting: _needs_of_wait,
    Returning: _needs_of_handler,
    Turn: _needs_of_turn,
    TurnAt: _needs_of_turn_at,
    Freeing: _needs_of_freeing,
    Granting: _needs_of_claim,
    Releasing: _needs_of_release,
}
"""One row per kind of node."""
