"""Invariants of central between two events: the Z schemas of the TCA paper, and our own
bookkeeping.

Each check walks over the whole state. The schemas are from the paper's section "Design and Analysis
Tools". Our copy of the paper contradicts itself on the constraints of a child and its parent. Here,
as in TCA, a child inherits its parent's constraints.
"""

from collections import Counter, defaultdict

from tca_central.control.steering import PendingKill
from tca_central.model.budget import DELIVERY_BYTES, RESOURCE_BYTES, TASK_BYTES
from tca_central.model.deliveries import Delivery, ModuleResource, PresenceWait
from tca_central.model.intervals import delivered_at
from tca_central.model.observers import Observation
from tca_central.model.registry import type_size
from tca_central.model.task_tree import failure_size, first_moments, to_be_fired
from tca_central.model.tasks import Policy, Retention, Scheduled, Task, Watch
from tca_central.order.holds import PendingDelay, held_counts, is_held
from tca_central.state import Collector, State
from tca_wire.packets.large import held_size
from tca_wire.points import (
    ALL_MOMENTS,
    END_ACHIEVING,
    END_PLANNING,
    ROOT,
    START_ACHIEVING,
    START_HANDLING,
    START_PLANNING,
)
from tca_wire.rules import RULES
from tca_wire.vocabulary import Due, Role


def check_invariants(central: State) -> None:
    """Raise AssertionError, naming the task or resource, where an invariant does not hold."""
    _check_constraints(central)
    for task in central.tree.tasks.values():
        _check_place(central, task)
        _check_family(task)
        _check_order(task)
        _check_delivery(central, task)
        _check_suspension(central, task)
        _check_state(task)
        _check_policy(task)
    for check in (
        _check_watches,
        _check_resources,
        _check_lending,
        _check_stranded,
        _check_claims_of_tasks,
        _check_pending_waits,
        _check_connections,
        _check_waits,
        _check_variables,
        _check_retained,
        _check_budget,
        _check_observers,
    ):
        check(central)


def _is_alive(central: State, task: Task | Delivery) -> bool:
    return task is central.tree.root or central.tree.tasks.get(task.id) is task


def _check_waits(central: State) -> None:
    """Check that blocked connections wait for open requests. Requests awaited together are all
    open.
    """
    connections = central.registry.connections.values()
    assert {one for one in connections if one.waits} == set(central.blocked), (
        "blocked connections differ from waiting ones"
    )
    for connection in central.blocked:
        for number, wait in connection.waits.items():
            assert number in connection.outstanding, (
                f"{connection.session} blocks for the answered request {number}"
            )
            others = {connection.waits.get(other) for other in wait.together}
            assert others <= {wait}, (
                f"{connection.session} awaits {wait.together}, of which some are answered"
            )


def _check_watches(central: State) -> None:
    """Check that exactly the monitors that watch, or will watch, are registered."""
    watches = (task.watch for task in central.tree.tasks.values() if task.watch is not None)
    assert central.watches == {
        watch.task.id: watch for watch in watches if not (watch.is_over or watch.task.killed)
    }


def _check_policy(task: Task) -> None:
    """Only an attempt at work has a timer, and only one that is to be replaced a replacement."""
    policy = Policy.of(task)
    if policy is not None:
        assert policy.task is task, task
        at_work = task.reached & START_HANDLING and not task.retry_pending
        assert policy.timer is None or (at_work and not policy.timer.is_cancelled), task
        assert policy.replacement is None or task.retry_pending, task


def _check_state(task: Task) -> None:
    """Check the state of a living task.

    The state is in the life cycle and not final. The state is the initial state until a handler
    gets the task, or the task is killed.
    """
    cycle = task.message.life_cycle
    clients = task.clients
    asked, newest = (clients.asked, clients.newest) if clients is not None else ([], 0)
    assert task.state in cycle.states, f"{task}: its life cycle has no '{task.state}'"
    assert not cycle.is_over(task.state), f"{task}: it is alive, and {task.state}"
    assert task.serial or task.state == cycle.initial, (
        f"{task}: it is {task.state}, and has never changed"
    )
    assert task.reached & START_HANDLING or task.state == cycle.initial or task.killed, (
        f"{task}: it has no handler yet"
    )
    assert [one.serial for one in asked] == sorted({one.serial for one in asked}), (
        f"{task}: the order of requests"
    )
    assert not asked or asked[-1].serial == newest <= task.serial, f"{task}: the newest request"
    is_failing = task.retry_pending or (
        task.recovery is not None and task.recovery.exception_handler is not None
    )
    may_be_asked = task.slot is not None or task.killed or is_failing
    assert not asked or may_be_asked, f"{task}: requests of clients without a handler"


def _check_observers(central: State) -> None:
    """Check that each observer has an open request. An observer of one task observes a living
    task.
    """
    observers, connections = central.observers, central.registry.connections.values()
    found = [one for group in observers.groups.values() for one in group]
    due = [one for connection in connections for one in connection.outstanding.values()]
    assert {one for one in due if isinstance(one, Observation)} == set(found), (
        "observers differ from waiting requests"
    )
    assert observers.count == len(found), "the number of observers"
    named = [number for one in found if (number := one.task_id or one.below)]
    assert all(number in central.tree.tasks for number in named), "an observed task has ended"


def _check_constraints(central: State) -> None:
    """Count the holds of tasks again, from the followers' lists and the timers."""
    tree = central.tree
    held: dict[int, Counter[int]] = defaultdict(Counter)
    leaders: dict[int, set[tuple[int, int, int]]] = defaultdict(set)
    for task in tree.tasks.values():
        for moment, follower, its_moment, _ in task.followers or ():
            is_known = follower.parent is task.parent or task in tree.crossing_leaders
            assert is_known, f"{task}: an unregistered follower outside its siblings: {follower}"
            assert not task.reached & moment, (
                f"{task}: {follower} still waits for a moment that is reached"
            )
            held[follower.id][its_moment] += 1
            leaders[follower.id].add((its_moment, task.id, moment))
    for timer in central.clock.pending():
        if timer.due is Due.RELEASE and isinstance(timer.subject, PendingDelay):
            held[timer.subject.task.id][timer.subject.moment] += 1
    for task in tree.tasks.values():
        assert held_counts(task) == dict(held[task.id]), f"{task}: held by {held_counts(task)}"
        assert {key for key in task.leaders or () if key[1] in tree.tasks} >= leaders[task.id], (
            f"{task}: leaders"
        )
    assert all(tree.tasks.get(one.id) is one for one in tree.crossing_leaders), (
        "an edge begins at a task that has ended"
    )
    assert all(one.followers for one in central.agenda.holds.ended_followers), (
        "followers that ended are still counted"
    )
    for number in tree.never_began:
        assert number in central.memory.outcomes or tree.tasks[number].killed, (
            f"task {number} was not killed"
        )


def _check_place(central: State, task: Task) -> None:
    """Check the task tree schema.

    Every node but the root has one parent, which is a node or the root; the root is not a node.
    """
    parent, children = task.parent, (task.children or {}).values()
    assert task.id != ROOT, "the root is among the tasks"
    assert parent is not None, f"{task}: no parent"
    assert _is_alive(central, parent), f"{task}: its parent is not in the tree"
    assert (parent.children or {}).get(task.id) is task, f"{task}: its parent does not know it"
    assert task.depth == parent.depth + 1, f"{task}: {task.depth} deep"
    assert task.message.message_class.is_task, f"{task}: queries and informs are not tasks"
    assert (task.recovery.foreign_monitors if task.recovery else 0) == sum(
        child.is_foreign_monitor for child in children
    ), f"{task}: foreign_monitors"
    unplanned = sum(child.is_goal and not child.reached & END_PLANNING for child in children)
    assert task.unplanned == unplanned, f"{task}: {task.unplanned} children to plan"


def _check_family(task: Task) -> None:
    """Check that a child starts after its parent and ends before its parent. A killed child may
    start at any time.
    """
    parent = task.parent
    assert parent is not None
    assert task.reached != ALL_MOMENTS, f"{task}: has ended and is still here"
    if not task.killed:
        starts = (START_PLANNING | START_ACHIEVING) if task.is_goal else START_ACHIEVING
        assert task.ignores_parent or not task.reached & starts & ~parent.reached, (
            f"{task}: started before its parent"
        )
        assert not parent.killed or task.role.survives, f"{task}: outlives its killed parent"
        is_own_watch = task.is_background and not task.is_foreign_monitor
        assert not (is_own_watch and parent.retry_pending), f"{task}: keeps {parent} from its retry"
    assert not parent.reached & END_ACHIEVING, f"{task}: not ended, but its parent has"


def _check_order(task: Task) -> None:
    """Check the node schema.

    A command is held until it may be achieved; a goal is handled as soon as it may be planned.
    """
    for moment, needed in RULES[task.message.is_goal].order:
        assert not task.reached & moment or task.reached & needed == needed, (
            f"{task}: {moment} too early"
        )
    start = delivered_at(task.is_goal)
    assert bool(task.reached & start) == bool(task.reached & START_HANDLING), (
        f"{task}: started in part"
    )
    if task.planning_delayed and not task.killed:
        together = bool(task.reached & START_PLANNING) == bool(task.reached & START_ACHIEVING)
        assert together, f"{task}: its planning did not start with its achieving"
    for moment in held_counts(task):
        # START_HANDLING comes again in a retry.
        is_past = task.reached & moment and moment != START_HANDLING
        assert task.killed or not is_past, f"{task}: moment {moment} is reached, and still held"


def _check_delivery(central: State, task: Task) -> None:
    """Check that a task is held by constraints, queued, with a handler, or returned."""
    parent = task.parent
    assert parent is not None
    is_running = task.handling_id in central.dispatcher.running
    assert is_running == task.is_running, f"{task}: the dispatcher does not know if a handler runs"
    assert is_running or not task.nested, f"{task}: nested in a handler that is done"
    is_elsewhere = task.returned or task.queues is not None
    assert not (is_running and is_elsewhere), f"{task}: with a handler, and in a queue or returned"
    if task.killed:
        return
    unsent = to_be_fired(task, first_moments(task)) if task.queues is not None else []
    assert not unsent, (
        f"{task}: waits for its handler, and {unsent[0].listener.name} was not sent before"
    )
    if task.reached & START_HANDLING:
        watch, recovery = task.watch, task.recovery
        recovering = recovery.exception_handler if recovery is not None else None
        is_accounted_for = (
            (watch is not None and watch.is_on)
            or (recovering is not None and recovering.id in central.tree.tasks)
            or task.returned
            or is_running
            or task.retry_pending
            or task.suspended
            or task.queues is not None
            or is_held(task, START_HANDLING)
        )
        assert is_accounted_for, f"{task}: no handler has it"
        return
    start = delivered_at(task.is_goal)
    starts = (start, START_ACHIEVING) if task.planning_delayed else (start,)
    is_stopped = task.suspended or any(is_held(task, moment) for moment in starts)
    may_start = not is_stopped and all(
        task.ignores_parent or parent.reached & moment for moment in starts
    )
    assert may_start == task.start_granted == (task.queues is not None), (
        f"{task}: may start and is not queued, or the other way round"
    )


def _check_suspension(central: State, task: Task) -> None:
    is_noted = task.id in central.tree.suspended
    assert task.suspended or not is_noted, f"{task}: noted as suspended"
    above = task.parent is not None and task.parent.suspended
    assert is_noted or above or not task.suspended, f"{task}: suspended, and not noted"


def _check_stranded(central: State) -> None:
    """Check that no exception handler waits for a handler, unless a module is leaving."""
    modules = central.registry.modules.values()
    if all(module.handlers for module in modules if module.has_slots):
        for message in central.registry.messages.values():
            waits = [one for one in message.waiting.values() if one.role is Role.EXCEPTION]
            assert not waits, (
                f"{waits}: no handler of '{message.name}', and the search does not continue"
            )


def _check_claims_of_tasks(central: State) -> None:
    """Check that claims end with their task or message."""
    for holder, claims in central.claimed_for.items():
        assert claims, f"{holder}: no claims"
        has_not_ended = holder.handling_id in central.dispatcher.running
        assert has_not_ended or _is_alive(central, holder), (
            f"{holder.message.name} {holder.id}: has ended, and has {len(claims)} claims"
        )


def _check_resources(central: State) -> None:
    """Check that no resource is over its capacity, and nothing waits while a slot is free."""
    handled: Counter[ModuleResource] = Counter()
    slots = set()
    for delivery in central.dispatcher.running.values():
        assert delivery.slot is not None, f"delivery {delivery.id}: without a slot"
        assert delivery.slot.resource is not None
        if not delivery.nested:
            assert delivery.slot not in slots, (
                f"delivery {delivery.id}: its slot handles two messages"
            )
            slots.add(delivery.slot)
            handled[delivery.slot.resource] += 1
    for resource in (
        one for module in central.registry.modules.values() for one in module.resources.values()
    ):
        name = f"resource '{resource.name}' of '{resource.module}'"
        assert handled[resource] + resource.free == resource.capacity, (
            f"{name}: {handled[resource]} handled"
        )
        assert resource.slots.keys() == resource.numbers.keys(), f"{name}: slots without a number"
        assert resource.waiting == len({delivery.id for delivery in resource.queued()}), (
            f"{name}: waiting"
        )
        following = central.dispatcher.next_in(resource)
        is_message = isinstance(following, Delivery)
        assert following is None or (is_message and not resource.free), (
            f"{name}: {following} waits, but could be delivered"
        )
        _check_prefetched(resource, name)
        _check_limits(resource, name)
        _check_claims(central, resource, name)
    for message in central.registry.messages.values():
        serving = sum(bool(handler.resource.capacity) for handler in message.handlers)
        assert message.serving == serving, (
            f"message '{message.name}': {message.serving} serving, counted {serving}"
        )
        assert not (message.waiting and message.handlers), (
            f"message '{message.name}': waits for a handler it has"
        )
        for wait in message.awaited_by:
            _check_handled_wait(wait)


def _check_lending(central: State) -> None:
    """Check who has each slot, and that each queued task is noted at the slot that is lent to it.

    A slot without a delivery that counts for the capacity has only deliveries that have freed it,
    and answers to its own queries.
    """
    lending, running = central.dispatcher.lending, central.dispatcher.running
    assert not lending.to_lend, "slots to be lent"
    for delivery, frees_slot in lending.postponed.items():
        assert running.get(delivery.handling_id) is delivery, f"{delivery}: replies never"
        assert delivery.nested or not frees_slot, f"{delivery}: has freed its slot, and counts"
    for delivery in running.values():
        slot = delivery.slot
        assert slot is not None
        if isinstance(delivery, Task) and slot.has_room:
            assert lending.postponed.get(delivery), f"{delivery}: its slot is free"
    for module in central.registry.modules.values():
        for resource in module.resources.values():
            for task, slot in resource.lendable.items():
                assert resource in (task.queues or ()), f"{task}: noted at {resource.name}"
                assert slot.resource is resource, f"{task}: noted at a slot of another resource"
    for task in central.tree.tasks.values():
        resources = task.queues or ()
        above = [one.slot.resource for one in task.lineage() if one.slot is not None]
        assert set(above).isdisjoint(resources) or any(task in one.lendable for one in resources), (
            f"{task}: not noted at a slot above it"
        )


def _check_prefetched(resource: ModuleResource, name: str) -> None:
    """Check prefetched messages: they are in order, wait for nothing else, and their slot is busy.

    A recalled slot need not be busy, and its messages need no order. Messages that have left their
    queue are not compared. A slot may return a message, and keep later messages that it has
    started.
    """
    line = [one for one in resource.in_line() if one in resource.prefetched or not one.ticket]
    assert (
        line == sorted(line, key=lambda one: (-one.priority, one.arrival)) or resource.is_recalling
    ), f"{name}: order"
    for delivery in resource.prefetched:
        slot = resource.prefetching_slot
        assert not delivery.is_task, f"{name}: task {delivery} is prefetched"
        assert delivery.queues == (resource,), f"{name}: prefetched {delivery} waits elsewhere"
        assert slot in resource.slots, f"{name}: {delivery} is prefetched to a lost slot"
        is_free = slot is not None and resource.is_free(slot)
        assert resource.is_recalling or not is_free, f"{name}: {delivery} waits for a free slot"


def _check_claims(central: State, resource: ModuleResource, name: str) -> None:
    """Check that in a locked resource only its holder's own slot is busy, and that a reserved
    resource has only its owner's messages.
    """
    assert resource.is_locked or not resource.locked_out_queries, (
        f"{name}: is not locked, but slots of it wait for themselves"
    )
    for claim in resource.claims:
        assert central.claims.get((claim.slot, claim.number)) is claim, (
            f"{name}: claim {claim.id} is not known"
        )
        assert claim.slot.outstanding.get(claim.number) is claim, (
            f"{name}: claim {claim.id} has no waiting request"
        )
    for copy in resource.copies:
        assert copy.held_by is resource.held_by, f"{name}: its copies have different holders"
        assert set(copy.claims) == set(resource.claims), f"{name}: its copies have different claims"
    if (held_by := resource.held_by) is None:
        return
    assert central.claims.get((held_by.slot, held_by.number)) is held_by, (
        f"{name}: held by an unknown claim"
    )
    assert central.registry.connections.get(held_by.slot.id) is held_by.slot, (
        f"{name}: its holder is disconnected"
    )
    for delivery in central.dispatcher.running.values():
        is_from_outside = delivery.slot is not held_by.slot and not delivery.nested
        if delivery.slot in resource.slots and is_from_outside:
            # A task, or a query to oneself, may have begun within a wait that has ended.
            is_own = delivery.is_task or (delivery.sender and delivery.sender.resource is resource)
            is_let_in = held_by.admits_owner and (delivery.sent_by is held_by.owner or is_own)
            assert is_let_in, (
                f"{name}: handles {delivery.message.name} {delivery.id} despite the claim"
            )


def _check_pending_waits(central: State) -> None:
    """Check that every wait for a time or a point belongs to a living task, which knows it."""
    timers = set(central.clock.pending())
    for task in (central.tree.root, *central.tree.tasks.values()):
        for plan, waits_for in task.scheduled.pending.items() if task.scheduled is not None else ():
            if isinstance(waits_for, Task):
                is_known = plan in (waits_for.waiters or ())
            else:
                is_known = waits_for in timers and waits_for.subject is plan
            assert is_known, f"{task}: {plan} will never happen"
        for waiter in task.waiters or ():
            if isinstance(waiter, PendingKill):
                assert Scheduled.of(waiter.task).pending[waiter] is task, (
                    f"{task}: an unregistered kill waits for it"
                )
            if isinstance(waiter, Watch):
                assert waiter.is_on, f"{task}: a monitor that is over waits for it"
                assert waiter.waits_for is task, f"{task}: a monitor waits for it and knows nothing"
    for timer in timers:
        if isinstance(timer.subject, Policy):
            assert timer.subject.timer is timer, f"{timer.subject.task}: two times for an attempt"
        due_for = getattr(timer.subject, "task", None)
        assert due_for is None or _is_alive(central, due_for), (
            f"{due_for}: has ended, and is due for '{timer.due}'"
        )


def _check_handled_wait(wait: PresenceWait) -> None:
    """Check that a module waiting for handlers is connected, and lacks one."""
    missing = [message.name for message in wait.messages if not message.serving]
    assert wait.missing == len(missing) > 0, (
        f"'{wait.connection.module.name}' waits for {wait.missing} of {missing}"
    )
    assert all(wait in message.awaited_by for message in wait.messages), (
        "a wait is known to some of its messages"
    )
    assert wait.connection.outstanding.get(wait.number) is wait, "a wait without an open request"


def _check_limits(resource: ModuleResource, name: str) -> None:
    """Check that the pending limit counts the waiting messages, and is not exceeded."""
    for message, limit in resource.limits.items():
        queued = (delivery for delivery in resource.queued() if delivery not in resource.prefetched)
        waiting = {delivery for delivery in queued if delivery.message.name == message}
        assert limit.waiting.keys() == waiting, (
            f"{name}: counts {len(limit.waiting)} of '{message}'"
        )
        assert len(waiting) <= limit.most, f"{name}: {len(waiting)} of '{message}' wait"


def _check_connections(central: State) -> None:
    registry = central.registry
    known = {one for module in registry.modules.values() for one in module.connections.values()}
    assert known == set(registry.connections.values()), "connections without a module"
    assert all(registry.modules.get(one.module.incarnation) is one.module for one in known), (
        "a module that was removed"
    )


def _check_retained(central: State) -> None:
    """Check that records are of ended tasks under existing parents, for connected modules."""
    tree, kept, modules = central.tree, central.memory.records, central.registry.modules.values()
    for record in kept.values():
        parent = record.parent
        assert record.id not in tree.tasks, f"record {record.id}: its task lives"
        has_parent = parent is tree.root or (
            parent and (kept.get(parent.id) or tree.tasks.get(parent.id)) is parent
        )
        assert has_parent, f"record {record.id}: its parent is removed"
        assert record.siblings.get(record.id) is record, (
            f"record {record.id}: its parent does not know it"
        )
        assert record.retention.by, f"record {record.id}: no module retains it"
        assert record.retention.by.keys() <= {*modules}, (
            f"record {record.id}: retained by a removed module"
        )
    retentions = [(module, number) for module in modules for number in module.retained]
    for module, number in retentions:
        assert module in Retention.of(kept.get(number) or tree.tasks[number]).by, (
            f"'{module.name}' keeps {number}, which does not know it"
        )
    assert central.memory.retentions == len(retentions), (
        f"{central.memory.retentions} retentions, counted {len(retentions)}"
    )
    assert central.memory.record_bytes == sum(record.size for record in kept.values()), (
        "size of the records"
    )


def _check_variables(central: State) -> None:
    """Check that values belong to variables, their size is known, and only the newest waits."""
    held = central.variables
    assert held.bytes == sum(held_size(value.body) for value in held.values.values()), (
        f"variables: {held.bytes} bytes are counted wrongly"
    )
    for name in held.values:
        message = central.registry.messages[name]
        assert message.message_class.keeps_value, f"'{name}' has a value and is not a variable"
        assert not message.waiting, f"variable '{name}': waits for a handler"
        limits = {handler.resource.limits[name].most for handler in message.handlers}
        assert limits <= {1}, f"variable '{name}': older values may wait"


def _check_budget(central: State) -> None:
    """Check that the counted bytes and objects are the real ones."""
    tasks, registry = central.tree.tasks.values(), central.registry
    running = central.dispatcher.running.values()
    assert central.tree.bytes == sum(map(_task_size, tasks)), "bytes of tasks"
    assert central.agenda.holds.edge_count == sum(len(task.followers or ()) for task in tasks), (
        "constraints"
    )
    waiters = sum(len(task.waiters or ()) for task in (*tasks, central.tree.root))
    assert central.agenda.wait_count == waiters, "waits for tasks"
    resources = [one for module in registry.modules.values() for one in module.resources.values()]
    queued = {one for resource in resources for one in resource.queued()}
    queued |= {one for message in registry.messages.values() for one in message.waiting.values()}
    messages = [one for one in (*running, *queued) if not isinstance(one, Task)]
    assert central.dispatcher.bytes == sum(
        DELIVERY_BYTES + held_size(one.body) for one in messages
    ), "bytes of messages"
    connections = [*registry.connections.values(), *registry.lost.values()]
    due = [one for connection in connections for one in connection.outstanding.values()]
    assert central.budget.collector_bytes == sum(
        one.size for one in due if isinstance(one, Collector)
    ), "failures"
    assert central.budget.presence_bytes == sum(
        one.size for one in due if isinstance(one, PresenceWait)
    ), "presence"
    types = sum(type_size(message.format) for message in registry.messages.values())
    assert registry.bytes == types + RESOURCE_BYTES * len(resources), "bytes of declarations"
    handlers = sum(len(module.handlers) for module in registry.modules.values())
    assert central.dispatcher.handler_count == handlers, "handlers"
    answers = sum(one.answer_bytes for one in connections)
    assert central.answers.bytes == answers == central.answers.walked_bytes(), "bytes of answers"
    assert answers <= central.budget.answers, "too many answers"


def _task_size(task: Task) -> int:
    termination_messages = task.scheduled.termination_messages if task.scheduled is not None else ()
    planned = sum(DELIVERY_BYTES + held_size(body) for _, body in termination_messages)
    if task.clients is not None:
        planned += sum(DELIVERY_BYTES + held_size(one.body) for one in task.clients.asked)
        planned += held_size(task.clients.progress)
    if (policy := Policy.of(task)) is not None:
        planned += len(policy.declared.data)
    return (
        TASK_BYTES
        + held_size(task.body)
        + held_size(task.result)
        + failure_size(task.failure)
        + planned
    )
