"""The rules of wiretaps: which listeners are sent when, and which points they hold."""

from msgspec.structs import replace
from properties import oracle_monitors, oracle_rules, oracle_slots
from properties.oracle_records import (
    EA,
    EH,
    EP,
    SA,
    SH,
    SP,
    Disagreement,
    Job,
    Node,
    Pair,
    Tap,
    World,
)

from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass, Role

BEFORE = {
    Condition.BEFORE_HANDLING: (SH, EH),
    Condition.BEFORE_PLANNING: (SP, EP),
    Condition.BEFORE_ACHIEVING: (SA, EA),
    Condition.WHEN_PLANNED: (EP, None),
    Condition.WHEN_ACHIEVED: (EA, None),
}
"""For each condition: the moment before which the listener is sent, and the end of the listener for
which this moment waits. With None, the moment waits for the listener as for a child of the task.
"""

AT = {
    SP: Condition.WHILE_PLANNING,
    EP: Condition.AFTER_PLANNED,
    SA: Condition.WHILE_ACHIEVING,
    EA: Condition.AFTER_ACHIEVED,
}
"""The condition that becomes true at each moment. Conditions of handling are missing: they become
true at the delivery and return of any message.
"""

CHILDREN = {*BEFORE, Condition.WHEN_SUCCESS, Condition.WHEN_FAILURE}
"""Conditions whose listeners are children of the tapped task."""

WHILE = {Condition.WHILE_HANDLING: EH, Condition.WHILE_PLANNING: EP, Condition.WHILE_ACHIEVING: EA}
"""Conditions whose listeners are killed with the tapped task. Each stands with the moment at which
a listening monitor ends, if the monitor has no end of its own.
"""

ALIVE = {*WHILE, Condition.WHEN_SENT}
"""Conditions whose polling and demon monitors are children of the tapped task, too. Such monitors
do not hold the task.
"""


def taps_of(world: World, job: Job) -> list[Tap]:
    if job.role is Role.LISTENER or job.sent_for_listener:
        return []
    own = job.taps if isinstance(job, Node) else []
    return [*own, *world.taps.get(job.message, [])]


def taps_in_force(world: World) -> list[Tap]:
    of_tasks = [tap for node in world.nodes.values() for tap in node.taps]
    return [*of_tasks, *(tap for taps in world.taps.values() for tap in taps)]


def fire_before(world: World, node: Node, moments: set[Moment]) -> list[Tap]:
    """Fire the taps before *moments*, and return them."""
    node.fired -= {
        tap.id
        for tap in taps_of(world, node)
        if tap.id in node.unheard and world.handlers.get(tap.listener)
    }
    new = [
        tap
        for tap in taps_of(world, node)
        if tap.condition in BEFORE
        and BEFORE[tap.condition][0] in moments
        and tap.id not in node.fired
    ]
    if node.killed:
        return []
    for tap in new:
        node.fired.add(tap.id)
        node.unheard.discard(tap.id)
        if not is_heard(world, tap):
            node.unheard.add(tap.id)
            continue
        listener = _fire(world, tap, node)
        before, interval = BEFORE[tap.condition]
        moment = node.first if before == SH else before
        if isinstance(listener, Node) and before == SH and SH in node.past:
            node.checks.append(listener)
        elif (
            isinstance(listener, Node)
            and interval
            and moment not in node.past
            and interval not in listener.past
        ):
            world.pairs.append(Pair((listener, interval), (node, moment)))
    return new


def fire_again(world: World, node: Node) -> None:
    """Let the *before* taps of a task that has not started fire again, because it is retried."""
    repeated = taps_to_repeat(world, node)
    if repeated:
        node.fired -= repeated
        if node.waiting:
            node.waiting, node.arrival = False, None


def taps_to_repeat(world: World, node: Node) -> set[int]:
    """Return the taps that fire again at a retry: before handling, and before moments that are not
    reached.
    """
    firsts = [
        (tap.id, BEFORE[tap.condition][0])
        for tap in taps_of(world, node)
        if tap.condition in BEFORE
    ]
    return {tap for tap, first in firsts if first == SH or first not in node.past}


def reached(world: World, node: Node, moments: set[Moment]) -> None:
    """Fire the taps of moments that a task has reached."""
    happened(world, node, {AT[moment] for moment in moments if moment in AT})


def happened(world: World, job: Job, conditions: set[Condition]) -> None:
    """Fire the taps of a message that have one of *conditions*. For messages other than tasks,
    *before handling* becomes true at delivery.
    """
    if Condition.WHILE_HANDLING in conditions and not isinstance(job, Node):
        conditions = conditions | {Condition.BEFORE_HANDLING}
    for tap in taps_of(world, job):
        if tap.condition in conditions:
            world.has_sent = True
            _fire(world, tap, job)


def consume_has_sent(world: World) -> bool:
    """Whether a tap has fired since the last call."""
    has_sent, world.has_sent = world.has_sent, False
    return has_sent


def is_heard(world: World, tap: Tap) -> bool:
    """Whether the listener of a tap has a handler. Central handles monitors."""
    return bool(world.handlers.get(tap.listener)) or world.kinds[tap.listener].is_monitor


def _fire(world: World, tap: Tap, job: Job) -> Job | None:
    kind = world.kinds[tap.listener]
    if not is_heard(world, tap):
        return None
    tap.has_fired = True
    if not kind.is_task:
        made = world.seen.take_made_id(tap.listener, Role.LISTENER, 0, job.id, tap.id)
        heard = Job(
            made, tap.listener, kind, module=job.module, role=Role.LISTENER, about=job, tap=tap
        )
        oracle_slots.send_statement(world, heard)
        return None
    is_alive = isinstance(job, Node) and job.id in world.nodes and not _ends_first(world, tap, job)
    is_beside = (
        kind in (MessageClass.POLLING_MONITOR, MessageClass.DEMON_MONITOR)
        and tap.condition not in CHILDREN
    )
    watches_it = is_beside and tap.condition in ALIVE and isinstance(job, Node)
    is_child = is_alive and (tap.condition in CHILDREN or watches_it)
    options = tap.watch or WatchOptions()
    if isinstance(job, Node) and tap.condition in WHILE:
        for other in job.listeners:
            if other.tap is tap and other.watch and other.id in world.nodes:
                oracle_monitors.end(world, other)
    is_bounded = options.maximum or options.duration or options.until or options.waited_for
    if watches_it and (not is_alive or (tap.condition in WHILE and not is_bounded)):
        options = replace(options, until=Point(TaskId(job.id), WHILE.get(tap.condition, EA)))

    def prepare(listener: Node) -> None:
        listener.tap = tap
        if kind.is_monitor:
            oracle_monitors.init_watch(listener, options)
        listener.watches_over = listener.watches_over and is_beside
        listener.is_foreign = (
            is_child and is_beside and tap.condition not in oracle_monitors.OF_HANDLING
        )

    parent = job if is_child and isinstance(job, Node) else world.root
    listener = oracle_rules.make(
        world, tap.listener, Role.LISTENER, parent, job, tap.id, prepare=prepare
    )
    if isinstance(job, Node) and tap.condition in WHILE:
        job.listeners.append(listener)
    return listener


def _ends_first(world: World, tap: Tap, node: Node) -> bool:
    """Whether central recorded the end of a task before this tap fired. A task may reach earlier
    points together with its end. The taps of those points fire after the end.
    """
    for fact in world.seen.facts:
        if isinstance(fact, facts.TapFired) and (fact.tap, fact.tapped) == (tap.id, node.id):
            return False
        if isinstance(fact, facts.Reached) and fact.task == node.id and fact.moments & EA:
            return True
    return False


def tap(world: World, module: str, header: headers.Tap) -> None:
    """Add a wiretap. Modules share equal taps. Another tap of the same module with this condition
    and listener is replaced.
    """
    if not header.message and header.task not in world.nodes:
        _tap_ended(world, header)
        return
    taps = (
        world.taps.setdefault(header.message, [])
        if header.message
        else world.nodes[header.task].taps
    )
    same = [
        one for one in taps if (one.condition, one.listener) == (header.condition, header.listener)
    ]
    ours = next((one for one in same if one.watch == header.watch), None)
    if ours is None:
        added = next(fact for fact in world.seen.facts if isinstance(fact, facts.TapAdded))
        ours = Tap(added.id, header.condition, header.listener, header.watch)
        taps.append(ours)
    ours.holders.add(module)
    for other in same:
        if other is not ours and module in other.holders:
            remove_holder(world, other.id, module)
    if (
        header.at_once
        and not ours.has_fired
        and _has_happened(world.nodes[header.task], header.condition)
    ):
        world.has_sent = True
        _fire(world, ours, world.nodes[header.task])


def _has_happened(node: Node, condition: Condition) -> bool:
    """Whether a condition has become true for a task. A *while* condition must still be true."""
    if condition is Condition.WHEN_SENT:
        return True
    if node.killed or condition is Condition.WHEN_KILLED:
        return node.killed and condition is Condition.WHEN_KILLED
    if condition is Condition.WHILE_HANDLING:
        return bool(node.slot) and not node.again
    moment = {
        Condition.AFTER_HANDLED: EH,
        Condition.WHEN_PLANNED: EP,
        Condition.WHEN_ACHIEVED: EA,
    }.get(condition)
    moment = moment or next(one for one, at in AT.items() if at is condition)
    return moment in node.past and WHILE.get(condition) not in node.past


def _tap_ended(world: World, header: headers.Tap) -> None:
    """Tap an ended task: send the listener once, now, for a past event."""
    killed, condition = header.task in world.killed_tasks, header.condition
    is_so = condition is Condition.WHEN_SENT or killed is (condition is Condition.WHEN_KILLED)
    if header.task not in world.ended or not is_so or condition in WHILE:
        raise Disagreement(f"central takes {header}, which never comes")
    added = next(fact for fact in world.seen.facts if isinstance(fact, facts.TapAdded))
    node = Node(header.task, header.of, world.kinds[header.of])
    _fire(world, Tap(added.id, header.condition, header.listener, header.watch), node)


def remove_holder(world: World, tap_id: int, module: str, *, for_all: bool = False) -> None:
    """Remove a module from a tap. The tap ends with its last module, or now if *for_all*."""
    for taps in [*world.taps.values(), *(node.taps for node in world.nodes.values())]:
        for tap in taps:
            if tap.id == tap_id:
                tap.holders.discard(module)
        taps[:] = [tap for tap in taps if tap.id != tap_id or (tap.holders and not for_all)]


def after_handler(kind: MessageClass, *, failed: bool, reissued: bool = False) -> set[Condition]:
    """Return the conditions that become true when a handler has returned."""
    conditions = {Condition.AFTER_HANDLED}
    if not reissued:
        conditions |= (
            {Condition.AFTER_FAILURE, Condition.WHEN_FAILURE}
            if failed
            else {Condition.AFTER_SUCCESS, Condition.WHEN_SUCCESS}
        )
    if kind.has_reply and not failed:
        conditions.add(Condition.AFTER_REPLIED)
    return conditions


def left(world: World, job: Job, *, lost: bool) -> None:
    """Fire the taps of a message whose handling module has left. The departure counts as a failure,
    unless another handler continues.
    """
    if lost or (job.killed if isinstance(job, Node) else job.target and job.kind.has_reply):
        happened(world, job, after_handler(job.kind, failed=True))
