"""Messages that central sends itself, including notices; copies for many handlers; suspension."""

from collections.abc import Callable

from tca_central.model.deliveries import Context, Delivery, MessageType, ModuleResource
from tca_central.model.tasks import Task
from tca_central.needs.texts import why_full
from tca_central.state import State, drop, dropped_fact
from tca_wire.constraints import Constraint, Flags
from tca_wire.journal import facts
from tca_wire.messages.declarations import D
from tca_wire.messages.formats import NIL, NO_DATA
from tca_wire.messages.notices import Notice
from tca_wire.packets.headers import Suspended
from tca_wire.packets.large import held_size
from tca_wire.points import ROOT, TaskId
from tca_wire.rules import RULES
from tca_wire.vocabulary import CENTRAL, Dropping, Role


def received(
    made: Delivery,
    sender: str,
    parent: TaskId,
    constraints: list[Constraint],
    origin: int = 0,
    is_blocking: bool = False,
    about: int = 0,
) -> facts.Received:
    """Return the fact that central accepted a new message, or made one itself."""
    message = made.message
    return facts.Received(
        made.id,
        message.name,
        message.message_class,
        sender,
        parent,
        origin,
        is_blocking,
        made.body,
        constraints,
        made.role,
        about,
    )


def copy_of(central: State, original: Delivery) -> Delivery:
    """Return a new delivery of the same message, for another handler."""
    copy = Delivery(central.new_id(), original.message, original.body, original.sender)
    copy.message_id, copy.priority, copy.origin = original.id, original.priority, original.origin
    copy.role, copy.context, copy.sent_by = original.role, original.context, original.sent_by
    copy.tap_depth = original.tap_depth
    return copy


def copies(central: State, original: Delivery) -> list[tuple[Delivery, ModuleResource]]:
    """Return a new delivery for each handler with a slot, and the handler's resource."""
    return [(copy_of(central, original), target) for target in _targets(original.message)]


def _targets(message: MessageType) -> list[ModuleResource]:
    """Return the resource of each handler with a slot."""
    return [handler.resource for handler in message.handlers if handler.resource.capacity]


def route_one_way(central: State, original: Delivery) -> None:
    """Route an inform to its handler, or a broadcast to all. Drop each copy without room."""
    if not original.message.fans_out:
        _route_or_drop(central, original)
        return
    for_each = copies(central, original)
    for delivery, target in for_each:
        _route_or_drop(central, delivery, target)
    if not for_each:
        central.facts.append(dropped_fact(original, "it has no handler"))


def _route_or_drop(central: State, delivery: Delivery, *targets: ModuleResource) -> None:
    """Route a message (to *targets* only), or drop it if there is no room."""
    if why := reason_to_refuse(central, delivery.message, delivery.body, *targets):
        drop(central, delivery, why, Dropping.OVERLOAD)
    else:
        central.dispatcher.route(delivery, *targets)


def reason_to_refuse(
    central: State, message: MessageType, body: bytes, *targets: ModuleResource
) -> str:
    """Return why a message (for *targets* only) is refused now; "" if there is room."""
    if central.dispatcher.is_full(message, *targets):
        return why_full(central, message, *targets)
    return central.refuse_if_full(held_size(body))


def reason_to_drop(central: State, message: MessageType, body: bytes) -> str:
    """Return why an inform or broadcast would reach no handler; "" if it reaches one."""
    if (message.handlers or not message.fans_out) and (
        why := central.refuse_if_full(held_size(body))
    ):
        return why
    is_full = central.dispatcher.is_full
    if not message.fans_out:
        return why_full(central, message) if is_full(message) else ""
    targets = _targets(message)
    if not targets or not all(is_full(message, target) for target in targets):
        return ""
    return why_full(central, message, targets[0])


def make_task(
    central: State,
    message: MessageType,
    body: bytes,
    parent: Task,
    role: Role,
    *,
    about: Delivery | None = None,
    context: Context | None = None,
    prepare: Callable[[Task], None] = lambda _: None,
) -> Task:
    """Make a task under *parent* that waits for no constraint of the tasks above it.

    Args:
        central: The state.
        message: The task's message.
        body: The task's data.
        parent: The task above it.
        role: The reason why central makes the task.
        about: The delivery for which central makes the task (default: *parent*).
        context: The details of the role.
        prepare: Called with the task before the task is added to the tree.
    """
    about = about or parent
    task = Task(TaskId(central.new_id()), message, body, None)
    task.role, task.since = role, central.clock.now
    task.context, task.sent_by = context, about.sent_by
    task.tap_depth = _tap_depth(central, about, role)
    prepare(task)
    index = len(central.facts)  # as in sending.py
    constraints = central.agenda.add(task, parent, Flags.NONE, [])
    central.facts[index:index] = [
        received(task, CENTRAL, parent.id, constraints, about=about.message_id),
        *birth_facts(task),
    ]
    central.report_new_task(task)
    return task


def _tap_depth(central: State, about: Delivery, role: Role) -> int:
    """Return the tap depth of a message for *about*: the number of listeners in its chain.

    Two chains may lead to the message: that of *about*, and that of the handler whose request
    central carries out. The longer one counts.
    """
    return max(about.tap_depth, central.tap_depth) + (role is Role.LISTENER)


def make_delivery(
    central: State,
    message: MessageType,
    body: bytes,
    role: Role,
    *,
    about: Delivery | None,
    context: Context | None = None,
) -> Delivery:
    """Make and record a message that is no task, without routing it yet."""
    delivery = Delivery(central.new_id(), message, body, None)
    delivery.role, delivery.context = role, context
    delivery.sent_by = about.sent_by if about is not None else None
    delivery.tap_depth = _tap_depth(central, about, role) if about is not None else 0
    about_id = about.message_id if about is not None else 0
    central.facts.append(received(delivery, CENTRAL, ROOT, [], about=about_id))
    return delivery


def make_statement(
    central: State,
    message: MessageType,
    body: bytes,
    role: Role,
    *,
    about: Delivery | None,
    context: Context | None = None,
) -> Delivery:
    """Make an inform or broadcast, and route it."""
    delivery = make_delivery(central, message, body, role, about=about, context=context)
    route_one_way(central, delivery)
    return delivery


def broadcast_notice(central: State, notice: Notice[D], data: D) -> None:
    """Send a notice to all its handlers. Without handlers it is not even recorded."""
    message = central.registry.messages.get(notice.name)
    if message is not None and message.serving:
        make_statement(central, message, notice.encode_data(data), Role.NONE, about=None)


def make(
    central: State,
    message: MessageType,
    body: bytes,
    parent: Task,
    role: Role,
    *,
    context: Context | None = None,
) -> Delivery:
    """Make a task under *parent* or, for an inform or broadcast, a delivery about *parent*."""
    if message.message_class.is_task:
        return make_task(central, message, body, parent, role, context=context)
    return make_statement(central, message, body, role, about=parent, context=context)


def data_for(message: MessageType, body: bytes) -> bytes:
    """Return the data for a message: none if the message is declared without data."""
    return NIL if message.format.data == NO_DATA else body


def birth_facts(task: Task) -> list[facts.Fact]:
    """Return ``OutlivesRetry``, ``WaitedFor`` and ``Reached`` of a new task, where they apply."""
    if task.is_goal:
        return []
    found: list[facts.Fact] = [facts.OutlivesRetry(task.id)] if task.is_foreign_monitor else []
    if task.message.is_interval_monitor and not task.is_background:
        found.append(facts.WaitedFor(task.id))
    return [*found, facts.Reached(task.id, RULES[task.message.is_goal].at_birth)]


def suspend(
    central: State, task: Task, *, resume: bool = False, by: str = CENTRAL, is_new: bool = False
) -> None:
    """Suspend or resume a task and all under it. Notify running handlers."""
    changed = central.agenda.suspend(task, resume=resume)
    if changed:
        central.facts.append(facts.SuspendedOrResumed(task.id, not resume, by))
        if not resume:
            central.tree.suspended.setdefault(task.id, (central.clock.now, by, is_new))
    for member in changed:
        if resume:
            central.tree.suspended.pop(member.id, None)
        if member.slot is not None:
            central.notify(member.slot, Suspended(member.handling_id, not resume))
