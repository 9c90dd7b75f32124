"""Carries out modules' requests to send messages, and to add constraints between tasks.

``on_send`` checks each message. Then the function for the message's class (``SENDERS``) records the
message, and sends it to handlers or adds a task to the tree. A function that raises RequestError
has changed nothing.
"""

from tca_central.control.keeping import check_retained_room, keep
from tca_central.control.steering import (
    check_termination_message,
    set_deadline,
    store_termination_message,
)
from tca_central.errors import RequestError
from tca_central.failing.attaching import attach, check_attachments
from tca_central.failing.policies import adopt, check_policy, check_policy_room
from tca_central.model.budget import ATTACHED_BYTES, EDGE_BYTES, TIMER_BYTES
from tca_central.model.clock import checked_seconds
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import Connection, Delivery, MessageType
from tca_central.model.tasks import Task
from tca_central.model.values import Refusals
from tca_central.needs.texts import why_full
from tca_central.outgoing.central_messages import (
    birth_facts,
    copies,
    reason_to_drop,
    received,
    route_one_way,
    suspend,
)
from tca_central.requests.replying import end_if_complete, fail_delivery
from tca_central.state import Collector, State
from tca_central.watching.taps import fire_after
from tca_central.watching.watches import become_monitor, check_options, enlist_monitor, is_foreign
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.messages.failures import OVERLOAD
from tca_wire.packets import headers
from tca_wire.packets.headers import Send
from tca_wire.packets.large import held_size
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import END_ACHIEVING, ROOT, Moment, TaskId
from tca_wire.rules import SENT
from tca_wire.vocabulary import MessageClass, Refusal

MOST_CONSTRAINTS = 1000
"""Constraints in one request. More would make all other modules wait too long."""


def on_send(central: State, connection: Connection, header: Send, body: bytes) -> None:
    """Check a message that a module sends, and send it in the way of its class."""
    message = central.registry.messages.get(header.message)
    if message is None:
        text = f"no module has declared message '{header.message}': register it before you send it"
        raise RequestError(Refusal.UNKNOWN, text)
    _check_message(central, header, message)
    if header.when_killed:
        check_termination_message(message, header.parent)
    if header.if_handled and not message.serving:
        if header.number:
            central.accept(connection, header.number)
        return
    SENDERS[message.message_class](central, connection, header, message, body)


def _check_message(central: State, header: Send, message: MessageType) -> None:
    """Raise RequestError if messages of this type cannot be sent, or not now."""
    if message.message_class.keeps_value:
        raise RequestError(Refusal.PROTOCOL, f"'{message.name}' is a variable: it is set, not sent")
    if message.is_notice:
        raise RequestError(Refusal.PROTOCOL, f"'{message.name}' is a notice: only central sends it")
    if not header.number and message.message_class.has_reply:
        raise RequestError(Refusal.PROTOCOL, f"{message.title} needs a request number")
    central.check_tap_depth(message)
    if central.is_disk_low and message.message_class.is_task:
        text = (
            f"the disk of central's journal is nearly full: no {message.message_class} is accepted "
            "before it has room"
        )
        raise RequestError(Refusal.OVERLOAD, text)


def _create(
    central: State, connection: Connection, header: Send, message: MessageType, body: bytes
) -> Delivery:
    """Create and record a message that is not a task."""
    delivery = Delivery(central.new_id(), message, body, connection)
    delivery.priority, delivery.origin, delivery.tap_depth = (
        header.priority,
        header.origin,
        central.tap_depth,
    )
    central.facts.append(
        received(delivery, connection.module.name, ROOT, [], header.origin, header.blocking)
    )
    fire_after(central, delivery, SENT)
    return delivery


def _send_one_way(
    central: State, connection: Connection, header: Send, message: MessageType, body: bytes
) -> None:
    """Send an inform or a broadcast to its handlers."""
    if header.number and (why := reason_to_drop(central, message, body)):
        raise RequestError(Refusal.OVERLOAD, f"{why}: try later")
    delivery = _create(central, connection, header, message, body)
    route_one_way(central, delivery)
    if header.number:
        central.accept(connection, header.number, delivery.id)


def _send_query(
    central: State, connection: Connection, header: Send, message: MessageType, body: bytes
) -> None:
    """Send a query to a handler. The sender gets the reply as the answer to the request."""
    if central.dispatcher.is_full(message):
        raise RequestError(Refusal.OVERLOAD, f"{why_full(central, message)}: try later")
    central.check_room(held_size(body))
    delivery = _create(central, connection, header, message, body)
    delivery.number = header.number
    connection.outstanding[header.number] = delivery
    central.dispatcher.route(delivery)
    if header.blocking:
        central.block(connection, header.number, header.origin, brief=header.brief)


def _send_multi_query(
    central: State, connection: Connection, header: Send, message: MessageType, body: bytes
) -> None:
    """Send a copy of the query to every handler, and collect the replies."""
    central.check_room(held_size(body) * len(message.handlers))
    original = _create(central, connection, header, message, body)
    for_each = copies(central, original)
    wanted = min(header.maximum, len(for_each)) if header.maximum > 0 else len(for_each)
    collector = Collector(connection, header.number, original, wanted)
    connection.outstanding[header.number] = collector
    for copy, resource in for_each:
        collector.pending[copy.id], collector.module_of[copy.id] = copy, resource.module
        central.collectors[copy.id] = collector
    for copy, resource in for_each:
        if central.dispatcher.is_full(message, resource):
            fail_delivery(
                central, copy, RaisedFailure(OVERLOAD, why_full(central, message, resource))
            )
        else:
            central.dispatcher.route(copy, resource)
    if header.blocking and header.number in connection.outstanding:
        central.block(connection, header.number, header.origin, brief=True)
    end_if_complete(central, collector)


def _send_task(
    central: State, connection: Connection, header: Send, message: MessageType, body: bytes
) -> None:
    """Add a goal, command or monitor to the tree."""
    has_extras = (
        header.constraints
        or header.attachments
        or header.deadline
        or header.keep
        or header.suspended
        or header.retry
        or message.format.retry
    )
    if has_extras:
        _check_extras(central, header)
    parent = central.tree.root if header.parent == ROOT else central.tree.task(header.parent)
    if parent is None:
        text = f"task {{{header.parent}}} has ended: nothing can be added under it"
        raise RequestError(Refusal.TOO_LATE, text)
    central.check_task_depth(message, parent)
    central.check_room(held_size(body) + EDGE_BYTES * len(header.constraints))
    if header.when_killed:
        store_termination_message(central, parent, message, body)
        central.accept(connection, header.number)
        return
    task = Task(TaskId(central.new_id()), message, body, connection)
    task.priority, task.since, task.tap_depth = (
        header.priority,
        central.clock.now,
        central.tap_depth,
    )
    is_monitor = message.message_class.is_monitor
    if is_monitor:
        _create_watch(central, task, parent, header)
    # The fact ``Received`` comes before the facts that ``add`` records. It contains the constraints
    # that ``add`` returns, and is therefore inserted afterwards.
    index = len(central.facts)
    constraints = central.agenda.add(task, parent, header.flags, header.constraints)
    sender = connection.module.name
    central.facts[index:index] = [
        received(task, sender, header.parent, constraints, header.origin, header.blocking),
        *birth_facts(task),
    ]
    central.report_new_task(task)
    if is_monitor:
        enlist_monitor(central, task)
    if has_extras:
        _add_extras(central, connection, task, header)
    fire_after(central, task, SENT)
    if header.deadline:
        set_deadline(central, task, END_ACHIEVING, header.deadline)
    if header.number:
        central.accept_task(connection, header.number, task.id, quiet=header.quiet)


def record_refusal(central: State, header: Send, text: str) -> None:
    """Record the refusal of a *quiet* task for the handler that sent it.

    The handler's reply has the number of refusals that the handler knows of (``Reply.refusals``).
    If that number does not include this refusal, the delivery fails.
    """
    delivery = central.dispatcher.running[central.origin]
    before = delivery.refused.number if delivery.refused.delivery == delivery.handling_id else 0
    delivery.refused = Refusals(
        delivery.handling_id, before + 1, f"'{header.message}' was refused: {text}"
    )


def _check_extras(central: State, header: Send) -> None:
    """Raise RequestError if constraints, attachments or the deadline of a task are not possible."""
    _check_count(header.constraints)
    check_attachments(central, header.attachments)
    checked_seconds(header.deadline, f"a deadline of '{header.message}'")
    timers = 1 + sum(one.delay > 0 for one in header.constraints)
    central.check_declared(TIMER_BYTES * timers + ATTACHED_BYTES * len(header.attachments))
    if header.keep:
        check_retained_room(central)
    if header.retry is not None:
        if header.when_killed or central.registry.messages[header.message].message_class.is_monitor:
            text = f"'{header.message}' takes no retry policy here: send it as a goal or command"
            raise RequestError(Refusal.PROTOCOL, text)
        check_policy(central, header.retry)
    elif central.registry.messages[header.message].format.retry is not None:
        check_policy_room(central)


def _add_extras(central: State, connection: Connection, task: Task, header: Send) -> None:
    """Suspend or retain a new task and attach exception handlers to it, as its sender wants."""
    if header.suspended and not task.killed:
        suspend(central, task, by=connection.module.name, is_new=True)
    if header.retry is not None:
        adopt(central, task, header.retry)
    for attachment in header.attachments:
        attach(central, attachment, task, connection.module)
    if header.keep:
        keep(central, task, connection.module)


def _create_watch(central: State, task: Task, parent: Task, header: Send) -> None:
    """Create the watch of a new monitor."""
    options = header.watch or WatchOptions()
    check_options(central, task.message, options)
    _check_end_point(task.message, parent, options)
    become_monitor(
        central, task, options, is_foreign_monitor=is_foreign(central, parent, header.origin)
    )


def _check_end_point(message: MessageType, parent: Task, options: WatchOptions) -> None:
    """Raise RequestError if a monitor would watch until the end of a task that waits for it."""
    until = options.until
    if until is None or until.moment is not Moment.END_ACHIEVING:
        return
    is_waited_for = options.waited_for or not message.is_interval_monitor
    if is_waited_for and (above := parent.find_above(until.task)) is not None:
        text = f"{message.title} can't watch until {above} ends, because {above} waits for it"
        hint = (
            f": leave out waited_for, and the monitor ends with {above} at the latest"
            if options.waited_for
            else ""
        )
        raise RequestError(Refusal.CYCLE, text + hint)


def _refuse_exception_handler(
    _: State, _connection: Connection, _header: Send, message: MessageType, _body: bytes
) -> None:
    """Refuse to send an exception handler: only central sends such messages."""
    text = (
        f"exception handler '{message.name}' is not sent: attach it to a task, "
        "and raise the failure there"
    )
    raise RequestError(Refusal.PROTOCOL, text)


SENDERS = {
    MessageClass.INFORM: _send_one_way,
    MessageClass.QUERY: _send_query,
    MessageClass.BROADCAST: _send_one_way,
    MessageClass.MULTI_QUERY: _send_multi_query,
    MessageClass.GOAL: _send_task,
    MessageClass.COMMAND: _send_task,
    MessageClass.EXCEPTION: _refuse_exception_handler,
    MessageClass.POINT_MONITOR: _send_task,
    MessageClass.POLLING_MONITOR: _send_task,
    MessageClass.DEMON_MONITOR: _send_task,
}
"""One row per message class: the function that sends its messages."""


def _check_count(constraints: list[Constraint]) -> None:
    """Raise RequestError if there are too many constraints for one request."""
    if len(constraints) > MOST_CONSTRAINTS:
        text = (
            f"{len(constraints)} constraints in one request: {MOST_CONSTRAINTS} are allowed, "
            "send several requests"
        )
        raise RequestError(Refusal.OVERLOAD, text)


def on_constrain(
    central: State, connection: Connection, header: headers.Constrain, _: bytes
) -> None:
    """Add constraints between existing tasks."""
    _check_count(header.constraints)
    central.check_room(EDGE_BYTES * len(header.constraints))
    central.check_declared(TIMER_BYTES * sum(one.delay > 0 for one in header.constraints))
    if added := central.agenda.constrain(header.constraints):
        central.facts.append(facts.Constrained(added))
    central.accept(connection, header.number)
