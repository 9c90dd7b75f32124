"""The rules of the tree: which points are reached, and which tasks may start.

All rules are tried on all tasks until no rule changes anything. A task starts planning after its
parent starts planning. A parent ends planning after all its children end planning. The same holds
for achieving. A pair of points holds its second point until its first point is reached. A killed
task waits only for handlers that still run in it or below it.
"""

from collections.abc import Callable, Iterable
from typing import Any

from properties import (
    oracle_failures,
    oracle_lending,
    oracle_locks,
    oracle_monitors,
    oracle_policies,
    oracle_taps,
)
from properties.oracle_records import (
    EA,
    EH,
    EP,
    SA,
    SH,
    SP,
    STARTS,
    Alarm,
    Ending,
    Family,
    Job,
    Node,
    Pair,
    World,
)

from tca_wire.constraints import Flags
from tca_wire.points import Moment
from tca_wire.vocabulary import Role

ORDER = {
    True: {SA: {SP}, EH: {SP}, EP: {EH}, EA: {SA, EH, EP}},
    False: {EH: {SA}, EA: {EH}},
}
"""The direct predecessors of each moment within one task: for goals (True), then for commands. The
first start has no row, because the delivery reaches it.
"""


def after(is_goal: bool, moment: Moment) -> set[Moment]:
    """Return a moment and all later moments of the same task."""
    found = {moment}
    while more := {later for later, befores in ORDER[is_goal].items() if befores & found} - found:
        found |= more
    return found


def place(world: World, task: int, moment: Moment) -> tuple[Node, Moment] | None:
    """Return a point as task and moment. Start handling becomes the task's first start. None if the
    task has ended.
    """
    node = world.nodes.get(task)
    return None if node is None else (node, node.first if moment == SH else moment)


def is_past(point: tuple[Node, Moment] | None) -> bool:
    return point is None or point[1] in point[0].past


def never_begins(world: World, task: int, moment: Moment) -> bool:
    """Whether a point belongs to an interval that a kill has prevented."""
    return (task, {EH: SH, EP: SP, EA: SA}.get(moment, moment)) in world.never_began


# --- constraints ----------------------------------------------------------------------------------


def constrain(
    world: World, one: tuple[Node, Moment] | None, other: tuple[Node, Moment], delay: float
) -> None:
    """Add a pair of points. If the first point is past, the pair holds only for its delay, counted
    from now.
    """
    if not delay and is_past(one):
        return
    node, moment = other
    if one == (node, SA) and moment == SP and not delay:
        node.delayed = True
        return
    if is_past(one):
        world.pairs.append(Pair(None, other, delay, world.time + delay))
        return
    assert one is not None
    world.pairs.append(Pair(one, other, delay))
    if one[0].killed:
        _inherit(world, one, other)


def from_flags(flags: Flags, node: Node, last: Node | None) -> list[tuple[Any, Any]]:
    """Return the pairs that flags stand for."""
    pairs = []
    if last is not None and flags & Flags.SEQ_ACH:
        pairs.append(((last, EA), (node, SA)))
    if last is not None and flags & Flags.SEQ_PLANNING:
        pairs.append(((last, EP), (node, SP)))
    if flags & Flags.DELAY_PLANNING:
        pairs.append(((node, SA), (node, SP)))
    if flags & Flags.PLAN_FIRST:
        pairs.append(((node, EP), (node, SA)))
    return pairs


def pass_on_leaders(world: World, killed: Node) -> None:
    """Let the followers of a killed task wait for the leaders of that task instead."""
    for pair in [
        pair
        for pair in world.pairs
        if pair.before and pair.before[0] is killed and not is_past(pair.before)
    ]:
        assert pair.before
        _inherit(world, pair.before, pair.after)


def _inherit(world: World, one: tuple[Node, Moment], other: tuple[Node, Moment]) -> None:
    killed, moment = one
    for pair in list(world.pairs):
        if pair.after[0] is not killed or is_past(pair.before) or is_past(other):
            continue
        held = SP if killed.delayed and pair.after[1] == SA else pair.after[1]
        if moment in after(killed.is_goal, held):
            world.pairs.append(Pair(pair.before, other))


def _is_void(world: World, pair: Pair) -> bool:
    """Whether a pair's delay would count from a point that a kill has prevented."""
    return pair.before is not None and never_begins(world, pair.before[0].id, pair.before[1])


def held_points(world: World) -> set[tuple[int, Moment]]:
    """Return all points that a pair holds. Drop each pair that holds nothing now, unless a follower
    may still inherit it.
    """
    held, kept = set(), []
    for pair in world.pairs:
        if is_past(pair.before) and pair.due is None:
            pair.due = world.time + pair.delay if pair.delay and not _is_void(world, pair) else -1.0
        if pair.due is not None and pair.due <= world.due_by:
            continue
        node, moment = pair.after
        if not is_past(pair.after) or (node.killed and node.id in world.nodes):
            kept.append(pair)
            held.add((node.id, moment))
    world.pairs = kept
    return held


# --- birth, end -----------------------------------------------------------------------------------


def add(world: World, node: Node, parent: Node) -> None:
    """Add a new task under its parent."""
    node.parent, node.handling_id = parent, node.id
    if not node.is_goal:
        node.past = {SP, EP}
    node.suspended = parent.suspended and node.role not in (Role.TERMINATION, Role.CANCEL)
    world.nodes[node.id] = node
    if (
        parent.killed or (parent.again and not (node.role or node.is_foreign))
    ) and not node.survives:
        oracle_failures.kill(world, node)


def make(
    world: World,
    message: str,
    role: Role,
    parent: Node,
    about: Job,
    tap: int = 0,
    *,
    prepare: Callable[[Node], None] = lambda _: None,
) -> Node:
    """Make a task as central does. The task may start before its parent."""
    task = world.seen.take_made_id(message, role, parent.id, about.id, tap)
    node = Node(task, message, world.kinds[message], module=about.module, role=role, free=True)
    node.about = about
    node.survives = role in (Role.EXCEPTION, Role.TERMINATION, Role.CANCEL)
    node.sent_for_listener = parent.role is Role.LISTENER and role in (
        Role.SET_UP,
        Role.ACTION,
        Role.CANCEL,
    )
    prepare(node)
    add(world, node, parent)
    return node


def family(node: Node) -> Family:
    """Return the key of a task's siblings. Under the root, only tasks from the same run of the same
    module are siblings.
    """
    assert node.parent is not None
    return (node.parent.id, "", 0) if node.parent.id else (0, node.module, node.run)


def _end(world: World, node: Node) -> None:
    del world.nodes[node.id]
    world.ended.add(node.id)
    if node.killed:
        world.killed_tasks.add(node.id)
    oracle_locks.end_for(world, node)
    key = family(node)
    if world.last.get(key) is node:
        del world.last[key]
        older = [
            other for other in world.nodes.values() if other.is_eligible and family(other) == key
        ]
        if node.killed and older:
            world.last[key] = older[-1]
    world.alarms = [alarm for alarm in world.alarms if alarm.node is not node]
    if node.role is Role.EXCEPTION:
        oracle_failures.handler_ended(world, node)


def set_alarm(world: World, seconds: float, node: Node, **fields: Any) -> None:
    world.alarms.append(Alarm(world.time + seconds, world.step, node, **fields))


def pass_time(world: World, settle: Callable[[], None]) -> None:
    """Handle all due timers in order, and settle after each. At equal times, the timer set first
    comes first. The order of timers set in one event is taken from central.
    """
    while (due := _next_due(world)) <= world.time:
        world.due_by = due
        alarms = [alarm for alarm in world.alarms if alarm.due <= due]
        for alarm in sorted(alarms, key=lambda one: (one.step, world.seen.place(one.node.id)))[:1]:
            world.alarms.remove(alarm)
            if alarm.ending is not None:
                oracle_failures.kill_scope(world, alarm.ending)
            elif alarm.watch is not None:
                oracle_monitors.on_alarm(world, alarm)
            elif alarm.is_attempt and not alarm.node.killed:
                oracle_failures.raise_beside(world, alarm.node, ("timeout",))
            elif (
                alarm.moment is not None
                and not alarm.node.killed
                and alarm.moment not in alarm.node.past
            ):
                if alarm.node.policy is not None:
                    alarm.node.policy.is_late = True
                oracle_failures.raise_beside(world, alarm.node, ("timeout",))
        oracle_locks.time_out(world)
        settle()
        world.step += 1
    world.due_by = world.time


def _next_due(world: World) -> float:
    pairs = [pair.due for pair in world.pairs if pair.due is not None and pair.due > world.due_by]
    waits = [claim.due for claim in world.claims if not claim.granted]
    return min([alarm.due for alarm in world.alarms] + pairs + waits, default=float("inf"))


# --- the fixpoint ---------------------------------------------------------------------------------


def settle(world: World) -> None:
    """Reach all points that may be reached."""
    while _pass(world) or _carry_out_due_kills(world) or oracle_monitors.end_due_monitors(world):
        pass


def _pass(world: World) -> bool:
    """Try every rule on every task once. Returns whether anything moved."""
    held = held_points(world)
    children: dict[int, list[Node]] = {}
    for node in world.nodes.values():
        assert node.parent is not None
        children.setdefault(node.parent.id, []).append(node)
    moved = False
    for node in list(world.nodes.values()):
        ours = children.get(node.id, [])
        if _advance(world, node, held, ours) or _consider_start(world, node, held, ours):
            moved = True
        if node.id not in world.nodes or oracle_taps.consume_has_sent(world):
            return True  # the tasks have changed
    return moved


def _may_reach(
    node: Node, moment: Moment, held: set[tuple[int, Moment]], children: list[Node]
) -> bool:
    """Whether a moment may be reached as far as pairs, parent, children and handler allow.
    ``ORDER`` is not checked here.
    """
    assert node.parent is not None
    if not node.killed and (node.id, moment) in held:
        return False
    if moment in STARTS:
        return not node.slot if node.killed else node.free or moment in node.parent.past
    if not node.returned:
        return False
    if moment == EP:
        return all(EP in child.past for child in children)
    return moment != EA or not children


def is_checked(node: Node) -> bool:
    """Whether a task still waits for a listener to be handled before the task's retry."""
    return any(EH not in check.past for check in node.checks)


def _is_ready(
    world: World, node: Node, held: set[tuple[int, Moment]], children: list[Node]
) -> bool:
    if not node.wanted or node.killed or node.suspended:
        return False
    if node.again and (
        node.slot
        or node.asking & set(world.nodes.values())
        or not all(child.is_foreign for child in children)
    ):
        return False
    if is_checked(node) or oracle_policies.is_paused(world, node):
        return False
    firsts = [SP, SA] if node.delayed else [node.first]
    return all(_may_reach(node, moment, held, children) for moment in firsts)


def _consider_start(
    world: World, node: Node, held: set[tuple[int, Moment]], children: list[Node]
) -> bool:
    """Queue a task that is ready, or take a task that is not ready out of the queue. *Before* taps
    may fire while a task is queued. If one has a listener, the task is queued again in its place.
    """
    is_ready = _is_ready(world, node, held, children)
    if node.waiting and not is_ready:
        node.waiting = False
        if not (node.suspended or node.again):
            node.arrival = None
        return True
    if not is_ready:
        return False
    starts = {SH} if SH in node.past else start_moments(node)
    if fired := oracle_taps.fire_before(world, node, starts):
        node.waiting &= not any(oracle_taps.is_heard(world, tap) for tap in fired)
        return True
    if node.waiting or _due_kills(world):  # a kill precedes a start
        return False
    world.spared.discard(node)  # the task has been queued again
    node.waiting = True
    node.since = (world.step, world.round)
    node.arrival = node.arrival or node.since
    oracle_lending.note(world, node)
    return True


def begin_attempts(world: World, nodes: Iterable[Node] | None = None) -> bool:
    """Begin the next attempts of retried tasks (by default, of all) that are queued. Until then, a
    failure below such a task is one of its last attempt. Return whether there were any.
    """
    due = [
        node
        for node in (world.nodes.values() if nodes is None else nodes)
        if node.waiting and node.again
    ]
    for node in due:
        node.again = False
        oracle_locks.end_for(world, node)
        if oracle_policies.send_fallback(world, node):
            node.waiting = node.wanted = False
            continue
        node.recovering, node.handling_id = None, world.seen.handling_id(node.id)
        if node.policy is not None:
            node.policy.attempts += 1
    return bool(due)


def start_moments(node: Node) -> set[Moment]:
    """Return the moments that the first delivery of a task reaches."""
    return STARTS if node.delayed else {SH, node.first}


def started(world: World, node: Node) -> None:
    """Reach the first moments of a task that is delivered."""
    oracle_policies.begin_attempt(world, node)
    if SH not in node.past:
        reach(world, node, start_moments(node) - node.past)


def fire_before_end(world: World, node: Node) -> None:
    """Fire the taps before the end of a monitor that ends as it starts."""
    held = held_points(world)
    if not ({(node.id, EH), (node.id, EA)} & held or world.children(node)):
        oracle_taps.fire_before(world, node, {EA})


def _advance(world: World, node: Node, held: set[tuple[int, Moment]], children: list[Node]) -> bool:
    """Reach all moments of a task that may be reached now. Taps before a moment fire first. A task
    that ends is removed before its ancestors move.
    """
    if node.killed and not node.slot and STARTS - node.past:
        reach(world, node, STARTS - node.past)
        return True
    before, is_tapped = node.past, False
    for moment, befores in ORDER[node.is_goal].items():
        if (
            moment in node.past
            or not befores <= node.past
            or not _may_reach(node, moment, held, children)
        ):
            continue
        if is_tapped := bool(oracle_taps.fire_before(world, node, {moment})):
            break
        node.past = node.past | {moment}
    if node.past == before:
        return is_tapped
    reach(world, node, node.past - before)
    if len(node.past) == 6:
        _end(world, node)
    return True


def reach(world: World, node: Node, moments: set[Moment]) -> None:
    node.past = node.past | moments
    if not node.killed:
        oracle_taps.reached(world, node, moments)


def _carry_out_due_kills(world: World) -> bool:
    """Carry out the kills whose point is reached."""
    due = _due_kills(world)
    for ending in due:
        world.endings.remove(ending)
        oracle_failures.end(world, ending)
    return bool(due)


def _due_kills(world: World) -> list[Ending]:
    """Return the planned kills whose point is reached."""
    return [ending for ending in world.endings if is_past(ending.after)]
