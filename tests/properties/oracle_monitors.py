"""The rules of monitors: when they ask their condition, what they send, and when they end."""

from dataclasses import dataclass

from properties import oracle_failures, oracle_rules, oracle_slots, oracle_taps
from properties.oracle_records import SH, Alarm, Job, Node, World

from tca_wire.journal import facts
from tca_wire.packets.parts import WatchOptions
from tca_wire.vocabulary import Condition, MessageClass, Role

NO = (b"\xc0", b"\xc2")  # None and False: the condition does not hold
OF_HANDLING = {
    Condition.BEFORE_HANDLING,
    Condition.WHILE_HANDLING,
    Condition.AFTER_HANDLED,
    Condition.AFTER_SUCCESS,
    Condition.AFTER_FAILURE,
    Condition.WHEN_SUCCESS,
    Condition.WHEN_FAILURE,
}
"""The conditions whose wiretaps fire again when a task is retried."""


@dataclass(eq=False)
class Watch:
    """The state of a monitor from its start to its end."""

    options: WatchOptions
    began: float | None = None
    condition: Job | None = None  # the open query
    since: float = 0  # the time from which its periods count
    activations: int = 0  # requests to fire that no test has answered yet
    count: int = 0  # how often its condition held, or a module fired it
    fires: int = 0
    is_over: bool = False

    @property
    def is_on(self) -> bool:
        return self.began is not None and not self.is_over


def init_watch(node: Node, options: WatchOptions | None) -> None:
    """Give a new monitor its watch."""
    node.watch = Watch(options or WatchOptions())
    node.watches_over = (
        node.kind is not MessageClass.POINT_MONITOR and not node.watch.options.waited_for
    )


def is_foreign(world: World, parent: Node, origin: int) -> bool:
    """Whether a new monitor under *parent* is foreign: neither the handler of *parent* nor an
    effect of that handler sent it.
    """
    seen: list[Job] = []
    while not origin or origin != parent.handling_id:
        one = _running_delivery(world, origin)
        while isinstance(one, Node) or (one is not None and one.role):
            cause = _cause(world, one, parent)
            if cause is parent:
                return False
            one = cause
        if one is None or one in seen:
            return True
        seen.append(one)
        origin = one.origin
    return False


def _cause(world: World, one: Job, parent: Node) -> Job | None:
    """Return the task that caused *one*; None for an exception handler and a foreign monitor. A
    listener counts as caused by *parent* only if a retry of *parent* fires its wiretap again.
    """
    if one.role is Role.LISTENER:
        assert one.tap is not None
        taps = oracle_taps.taps_in_force(world)
        is_again = one.tap in taps and one.tap.condition in OF_HANDLING
        is_known = isinstance(one.about, Node) and one.about.id in world.nodes
        return one.about if is_known and (is_again or one.about is not parent) else None
    if one.role in (Role.CONDITION, Role.SET_UP, Role.ACTION, Role.CANCEL):
        return one.about
    assert isinstance(one, Node)
    return None if one.role is Role.EXCEPTION or one.is_foreign else one.parent


def _running_delivery(world: World, delivery: int) -> Job | None:
    return next(
        (one for one in world.everything() if one.slot and one.handling_id == delivery), None
    )


def start_all(world: World) -> bool:
    """Start the queued monitors, which central itself carries out. Return whether there were any.
    The order among several is taken from central.
    """
    monitors = [node for node in world.nodes.values() if node.waiting and node.kind.is_monitor]
    first: list[int] = [
        fact.task
        for fact in world.seen.facts
        if isinstance(fact, facts.Reached) and fact.moments & SH
    ]
    for node in sorted(monitors, key=lambda one: first.index(one.id) if one.id in first else 0):
        oracle_rules.begin_attempts(world, [node])
        node.waiting = node.wanted = False
        _start(world, node)
        oracle_slots.give_messages(world)
    return bool(monitors)


def _start(world: World, node: Node) -> None:
    if node.returned or _has_reached_until(world, node):
        oracle_rules.fire_before_end(world, node)
    oracle_rules.started(world, node)
    if node.returned:
        return
    watch = node.watch = Watch(node.watch.options) if node.watch.is_over else node.watch
    options: WatchOptions = watch.options
    watch.began = watch.since = world.time
    oracle_taps.happened(world, node, {Condition.WHILE_HANDLING})
    if options.duration:
        oracle_rules.set_alarm(world, options.duration, node, watch=watch)
    if _has_reached_until(world, node):
        end(world, node)
    elif node.kind is MessageClass.DEMON_MONITOR:
        _send(world, node, 0, Role.SET_UP)
    elif node.kind is MessageClass.POLLING_MONITOR and options.initial_wait:
        _test_later(world, node)
    else:
        _test(world, node)


def _has_reached_until(world: World, node: Node) -> bool:
    until = node.watch.options.until
    return until is not None and oracle_rules.is_past(
        oracle_rules.place(world, until.task, until.moment)
    )


def _send(world: World, node: Node, part: int, role: Role) -> None:
    """Send one of the messages of a monitor, if the monitor has it."""
    message = world.parts[node.message][part]
    if not message:
        return
    kind = world.kinds[message]
    if kind.is_task:
        oracle_rules.make(world, message, role, node, node)
    else:
        made = world.seen.take_made_id(message, role, 0, node.id)
        job = Job(
            made,
            message,
            kind,
            module=node.module,
            role=role,
            sent_for_listener=node.role is Role.LISTENER,
        )
        job.about = node
        oracle_slots.send_statement(world, job)


# --- testing --------------------------------------------------------------------------------------


def _test_later(world: World, node: Node) -> None:
    """Set an alarm at the next multiple of the period."""
    period = node.watch.options.period
    wait = period - (world.time - node.watch.since) % period
    if wait < period / 1000:  # rounding: now is a multiple of the period
        wait += period
    oracle_rules.set_alarm(world, wait, node, watch=node.watch, is_test=True)


def on_alarm(world: World, alarm: Alarm) -> None:
    """End a monitor whose time is over, or make the test that is due. The test is put off by a
    period if the monitor is suspended or the last test is still open.
    """
    node, watch = alarm.node, alarm.watch
    if not watch.is_on:
        return
    if not alarm.is_test:
        end(world, node)
    elif watch.condition is not None or node.suspended:
        _test_later(world, node)
    elif not _test_as_fired(world, node):
        _test(world, node)


def activate(world: World, node: Node) -> None:
    """Fire a monitor at a module's request. A demon monitor acts at once. Other monitors test
    first, one test at a time.
    """
    if node.kind is MessageClass.DEMON_MONITOR:
        fire(world, node)
        return
    node.watch.activations += 1
    if node.watch.condition is None:
        _test_as_fired(world, node)


def go_on(world: World) -> bool:
    """Continue the resumed monitors. One that was fired while suspended tests, unless the event
    that resumed it has also killed it. Return whether any was resumed.
    """
    resumed, world.resumed = world.resumed, []
    for node in resumed:
        if node.watch.is_on and node.watch.condition is None:
            _test_as_fired(world, node)
    return bool(resumed)


def _test_as_fired(world: World, node: Node) -> bool:
    if not node.watch.activations or (node.kind is MessageClass.POLLING_MONITOR and node.suspended):
        return False
    node.watch.activations -= 1
    node.watch.since = world.time
    _test(world, node)
    return True


def _test(world: World, node: Node) -> None:
    if node.kind is MessageClass.POLLING_MONITOR:
        world.alarms = [
            alarm for alarm in world.alarms if alarm.watch is not node.watch or not alarm.is_test
        ]
        _test_later(world, node)
    query = world.parts[node.message][0]
    made = world.seen.take_made_id(query, Role.CONDITION, 0, node.id)
    is_listener = node.role is Role.LISTENER
    node.watch.condition = Job(
        made,
        query,
        world.kinds[query],
        module=node.module,
        role=Role.CONDITION,
        sent_for_listener=is_listener,
    )
    node.watch.condition.about = node
    oracle_slots.wait(world, node.watch.condition)


def answered(
    world: World, job: Job, body: bytes | None, names: tuple[str, ...] = ("module lost",)
) -> None:
    """Apply the answer to a monitor's condition. If *body* is None, the condition has failed with
    *names*.
    """
    asking = [node for node in world.nodes.values() if node.watch and node.watch.condition is job]
    for node in asking:
        node.watch.condition = None
        is_point = node.kind is MessageClass.POINT_MONITOR
        if body is None and is_point:
            stop(world, node)
            oracle_failures.returned_with_failure(world, node, names)
        elif body is None:
            oracle_failures.raise_beside(world, node, names)
        elif body not in NO:
            fire(world, node)
        if node.watch.is_on and not _test_as_fired(world, node) and is_point:
            end(world, node)


def fire(world: World, node: Node) -> None:
    """Count that the condition held, or that a demon monitor was fired. Send the action every
    ``fire_every`` times.
    """
    watch = node.watch
    watch.count += 1
    if watch.count % watch.options.fire_every:
        return
    watch.fires += 1
    _send(world, node, 1, Role.ACTION)
    if watch.fires == watch.options.maximum:
        end(world, node)


# --- end ------------------------------------------------------------------------------------------


def end(world: World, node: Node) -> None:
    """End a monitor: its task counts as handled."""
    if not node.watch.is_over:
        stop(world, node)
        node.returned = True


def stop(world: World, node: Node) -> None:
    """Stop a monitor and drop its queued condition. Its actions are not affected."""
    watch = node.watch
    if watch is None or watch.is_over:
        return
    watch.is_over = True
    world.alarms = [alarm for alarm in world.alarms if alarm.watch is not watch]
    if watch.condition is not None and watch.condition.waiting:
        world.jobs.remove(watch.condition)
    watch.condition = None
    if watch.began is not None:
        oracle_taps.happened(world, node, {Condition.AFTER_HANDLED})
        if node.kind is MessageClass.DEMON_MONITOR:
            _send(world, node, 2, Role.CANCEL)


def end_due_monitors(world: World) -> bool:
    """End the monitors whose *until* point is reached. Where a parent has only background monitors
    left, end these too; kill those that are held before their start. Return whether there were any.
    """
    to_kill: list[Node] = []
    to_end = [
        node
        for node in world.nodes.values()
        if node.watch and node.watch.is_on and _has_reached_until(world, node)
    ]
    for parent in world.nodes.values():
        children = world.children(parent)
        if parent.returned and all(child.watches_over for child in children):
            to_end += [child for child in children if not child.watch.is_over]
            to_kill += [child for child in children if _is_held_before_start(world, child)]
    for node in to_end:
        if node not in to_kill:
            end(world, node)
    for node in to_kill:
        oracle_failures.kill(world, node)
    return bool(to_end or to_kill)


def _is_held_before_start(world: World, node: Node) -> bool:
    """Whether a monitor is still to begin, and is held or suspended."""
    is_to_begin = not node.killed and (node.again or SH not in node.past)
    is_held = oracle_rules.is_checked(node) or any(
        held == node.id for held, _ in oracle_rules.held_points(world)
    )
    return is_to_begin and (node.suspended or is_held)
