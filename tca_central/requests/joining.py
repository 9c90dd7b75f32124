"""Connects and disconnects modules, and registers their messages and handlers.

HANDLERS in core.py has the function for each header.
"""

from tca_central.control.keeping import release_all
from tca_central.control.monitors import check_parts
from tca_central.errors import RequestError, check_name
from tca_central.events import ConnectionId
from tca_central.failing.policies import check_declared_policy
from tca_central.life_cycles.changes import (
    cancel_tasks_of,
    check_custom_handler,
    resend_requests,
    restart,
)
from tca_central.locks import claims
from tca_central.model.budget import HANDLER_BYTES, RESOURCE_BYTES
from tca_central.model.clock import checked_seconds
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import Connection, Delivery, Handler, Module, ModuleResource
from tca_central.model.registry import type_size
from tca_central.model.rights import OWNER, Rights, rights_of
from tca_central.model.tasks import Task
from tca_central.outgoing.central_messages import broadcast_notice
from tca_central.requests.forgetting import make_room
from tca_central.requests.replying import fail_delivery
from tca_central.requests.restarting import release_if_complete
from tca_central.requests.variables import forget_unfit_value, send_value_to_watcher
from tca_central.requests.waiting import give_up
from tca_central.state import State, cancelled_header, deliver_header, drop
from tca_central.watching.taps import fire_after, on_listeners_added
from tca_wire.journal import facts
from tca_wire.messages.declarations import D
from tca_wire.messages.failures import MODULE_LOST, UNCERTAIN
from tca_wire.messages.notices import (
    COMMANDS,
    MODULE_JOINED,
    MODULE_LEFT,
    Arrival,
    Departure,
    Notice,
)
from tca_wire.packets import headers
from tca_wire.packets.headers import PROTOCOL_VERSION, Cancelled
from tca_wire.packets.parts import HandlerFormat
from tca_wire.rules import FAILURE, RETURNED
from tca_wire.text.printable import shortened
from tca_wire.vocabulary import Limit, Outcome, Refusal

MOST_AHEAD = 256
"""The greatest number of messages that a slot may prefetch, even if it asks for more."""
MOST_LATE = MOST_AHEAD + 8
"""Deliveries of a lost connection whose late answers central recognises.

They are prefetched and nested messages.
"""


def greet(
    central: State, connection_id: ConnectionId, header: headers.Hello, principal: str
) -> None:
    """Admit a connection that introduces itself, for the first time or after a reconnect."""
    registry = central.registry
    _check_hello(header)
    session = f"{header.incarnation}/{header.connection}"
    _check_owner(central, header, session, principal)
    rights = _rights(central, header, principal)
    module, is_new = registry.module(
        header.module or "module", header.incarnation, header.process, principal
    )
    if is_new:
        module.cancels_on_leave = header.cancels_on_leave
        central.facts.append(facts.ModuleJoined(module.name, header.process, principal))
        _announce(central, module, MODULE_JOINED, Arrival(module.name, header.process))
    connection = module.connections.get(session)
    if connection is not None:  # it reconnected before its loss was noticed
        del registry.connections[connection.id]
        connection.id = connection_id
        registry.connections[connection_id] = connection
        connection.repeats_until = central.tree.newest
        central.restart_pause.awaited.pop(connection, None)
    else:
        connection = Connection(connection_id, session, module, header.connection)
        connection.prefetch = max(0, min(header.prefetch, MOST_AHEAD))
        connection.hung_after = header.hung_after if header.resource else 0.0
        _join(central, connection, header.resource)
    connection.pulse, connection.rights = header.pulse, rights
    on_hello_again(central, connection, header, b"")
    _resend_all(central, connection)
    release_if_complete(central)


def _resend_all(central: State, connection: Connection) -> None:
    """Repeat the packets that a connection may have missed before it reconnected."""
    for orphan in connection.orphans:  # they have failed: a handler that still runs should stop
        central.notify(connection, Cancelled(orphan, "its connection to central was lost"))
    connection.orphans = []
    for number, lost in connection.lost_claims.items():
        central.notify(connection, headers.Taken(number, lost.text))
    for delivery in list(central.dispatcher.running.values()):
        # The packet may have been lost on the way. A slot that has it ignores the repetition.
        if delivery.slot is connection:
            central.notify(connection, deliver_header(delivery), delivery.body)
            if isinstance(delivery, Task):
                resend_requests(central, delivery)
                if delivery.killed or delivery.retry_pending:
                    central.notify(connection, cancelled_header(delivery))
    resource = connection.resource
    if resource is None:
        _report_hung_slots(central, connection)
    elif resource.prefetching_slot is connection:
        _resend_prefetched(central, connection, resource)


def _resend_prefetched(central: State, connection: Connection, resource: ModuleResource) -> None:
    """Send prefetched messages again, and the recall if one is in progress."""
    for place, delivery in enumerate(resource.prefetched, len(connection.handling)):
        central.notify(connection, deliver_header(delivery, place), delivery.body)
    if resource.is_recalling:
        central.recall(connection)


def _report_hung_slots(central: State, connection: Connection) -> None:
    """Ask a module again to replace its slots whose handlers hang."""
    for lost in central.registry.lost.values():
        if lost.was_replaced and lost.module is connection.module:
            central.notify(connection, headers.Replace(lost.number))


def _check_hello(header: headers.Hello) -> None:
    """Raise RequestError if the fields of a hello are not valid."""
    if header.version != PROTOCOL_VERSION:
        text = (
            f"module '{header.module}' speaks protocol {header.version}, "
            f"central {PROTOCOL_VERSION}: use one version"
        )
        raise RequestError(Refusal.PROTOCOL, text)
    check_name("module", header.module, or_none=True)
    check_name("process", header.process, or_none=True)
    check_name("resource", header.resource, or_none=True)
    check_name("incarnation", header.incarnation)
    checked_seconds(header.hung_after, "a handler that hangs")
    if len(header.pulse) > Limit.NAME:
        raise RequestError(Refusal.PROTOCOL, f"a pulse is named by at most {Limit.NAME:d} bytes")


def _check_owner(central: State, header: headers.Hello, session: str, principal: str) -> None:
    """Raise RequestError if another user owns the incarnation, or a lost connection of *session*.

    Also raise it for a slot that was given up because its handler hung.
    """
    lost = central.registry.lost.get(session)
    if lost is not None and lost.was_replaced:
        text = (
            f"slot {header.connection} of module '{header.module}' was given up, "
            "because its handler did not return"
        )
        raise RequestError(Refusal.TOO_LATE, text)
    known = central.registry.modules.get(header.incarnation) or lost
    if known is not None and known.principal != principal:
        text = (
            f"another user's run of module '{header.module}' has this incarnation: draw a new one"
        )
        raise RequestError(Refusal.FORBIDDEN, text)


def _rights(central: State, header: headers.Hello, principal: str) -> Rights | None:
    """Return a connection's rights; None: everything is allowed.

    Raises RequestError if the rules do not admit the module.
    """
    if central.registry.permissions.rules is None:
        return None
    known = central.registry.modules.get(header.incarnation)
    called = known.called if known is not None else header.module or "module"
    if (rights := rights_of(central.registry.permissions.rules, principal, called)) is None:
        text = f"'{principal or OWNER}' may not be module '{called}': see the permissions file"
        raise RequestError(Refusal.FORBIDDEN, text)
    return rights


def _join(central: State, connection: Connection, resource_name: str) -> None:
    """Add a connection to its module.

    The connection inherits the requests and answers of a lost connection of the same session.
    """
    module = connection.module
    if lost := central.registry.lost.pop(connection.session, None):
        central.answers.transfer(lost, connection)
        connection.last_number, connection.tasks = lost.last_number, lost.tasks
        connection.orphans, connection.late_answers = lost.orphans, lost.late_answers
        connection.lost_claims = lost.lost_claims
    module.connections[connection.session] = connection
    central.registry.connections[connection.id] = connection
    if resource_name:
        resource = central.registry.resource(module, resource_name)
        central.facts.append(
            facts.ResourceChanged(module.name, resource.name, resource.capacity + 1)
        )
        central.dispatcher.add_slot(connection, resource)


def on_hello_again(central: State, connection: Connection, header: headers.Hello, _: bytes) -> None:
    """Welcome a connection: a new one, or one that asks whether central still knows it."""
    welcome = headers.Welcome(
        header.number, PROTOCOL_VERSION, connection.module.name, central.epoch
    )
    central.notify(connection, welcome)


def on_receipt(central: State, connection: Connection, header: headers.Receipt, _: bytes) -> None:
    """Forget the answers that a connection has read. The server handles the rest."""
    central.answers.forget_read(connection, header.answers)


def on_bye(central: State, connection: Connection, header: headers.Bye, _: bytes) -> None:
    """Remove a connection that closes regularly, or because of an error of its program."""
    why = f"it failed: {shortened(header.error)}" if header.error else "it said goodbye"
    disconnect(central, connection, why, lost=False)


def on_end_central(
    central: State, connection: Connection, header: headers.EndCentral, _: bytes
) -> None:
    """Record that central must end, and remove the connection that asks. The shell ends it."""
    if header.keep and not central.budget.keeps_inputs:
        text = (
            "the run can't be kept, because central stores no inputs (--no-inputs, --no-journal): "
            "leave --keep out to end the run"
        )
        raise RequestError(Refusal.UNKNOWN, text)
    central.facts.append(facts.CentralEnding(connection.module.name, header.keep))
    central.accept(connection, header.number)
    disconnect(central, connection, "it ended central", lost=False)


def disconnect(central: State, connection: Connection, why: str, *, lost: bool) -> None:
    """Remove a connection.

    If it was *lost*, its unfinished deliveries fail. Otherwise other handlers get them, except for
    copies and killed tasks, which end.
    """
    module = connection.module
    central.unconfirmed.pop(connection, None)
    is_uncertain = connection in central.restart_pause.awaited
    central.restart_pause.awaited.pop(connection, None)
    # A lost connection may come back, so answers to it stay. If too many connections are lost, the
    # answers to the oldest one are forgotten.
    oldest_lost = central.registry.forget_connection(connection)
    for one in (oldest_lost, None if lost else connection):
        central.answers.forget_all(one)
    for number in list(connection.outstanding):
        give_up(central, connection, number)
    claims.end_claims_of_connection(central, connection)
    if connection.resource is None:
        remove_handlers(central, list(module.handlers.values()))
        # The module's other connections close next. When the last one closes, exception handlers
        # that only this module handled are skipped.
        if module.connections:
            central.dispatcher.stranded.clear()
    orphans = central.dispatcher.remove_slot(connection)
    for delivery in orphans:
        _remember_orphan(connection, delivery, why)
    if connection.resource is not None:
        resource = connection.resource
        central.facts.append(facts.ResourceChanged(module.name, resource.name, resource.capacity))
    _forget_if_gone(central, module, why, lost=lost)
    for delivery in orphans:
        if lost or delivery.message.fans_out or (isinstance(delivery, Task) and delivery.killed):
            _fail_or_drop(central, delivery, module, why, lost=lost, is_uncertain=is_uncertain)
        else:
            _reassign(central, delivery)
    release_if_complete(central)


def on_grace_over(central: State, _: None) -> None:
    """Disconnect the connections that did not come back in time after a restart of central."""
    central.restart_pause.grace = None
    for connection in list(central.restart_pause.awaited):
        if connection in central.restart_pause.awaited:
            disconnect(central, connection, "it did not come back when central did", lost=True)


def on_hung(central: State, delivery: Delivery) -> None:
    """Give up a slot whose handler is no longer needed, and has not returned in time.

    Ask its module to replace the slot.
    """
    slot = delivery.slot
    if (
        slot is None
        or slot.hang_timers.pop(delivery.handling_id, None) is None
        or slot.resource is None
    ):
        return
    why = (
        f"its handler of '{delivery.message.name}' hangs: "
        f"it has not been needed for {slot.hung_after:g} s"
    )
    slot.was_replaced = True
    slot.resource.replaced += 1
    module = slot.module
    disconnect(central, slot, why, lost=True)
    for connection in module.connections.values():
        if connection.resource is None:
            central.notify(connection, headers.Replace(slot.number, why))


def _remember_orphan(connection: Connection, delivery: Delivery, why: str) -> None:
    """Remember a delivery of a lost connection, which may answer it after a reconnect."""
    name = str(delivery) if isinstance(delivery, Task) else delivery.message.title
    connection.orphans.append(delivery.handling_id)
    connection.late_answers[delivery.handling_id] = (
        f"the answer of {name} came too late: the module had been lost ({why})"
    )
    if len(connection.late_answers) > MOST_LATE:
        del connection.late_answers[next(iter(connection.late_answers))]


def _forget_if_gone(central: State, module: Module, why: str, *, lost: bool) -> None:
    """Remove a module that has no connection left, with all that it handled, held and retained."""
    if module.connections:
        if not module.handlers and not module.has_slots:  # it handles nothing any more
            central.dispatcher.list_stranded(central.registry.messages.values())
        return
    remove_handlers(central, list(module.handlers.values()))
    central.dispatcher.list_stranded(central.registry.messages.values())
    claims.end_claims_on_module(central, module, why)
    release_all(central, module)
    if module.cancels_on_leave:
        cancel_tasks_of(central, module)
    central.registry.forget_module(module)
    central.tree.forget_module(module)
    central.facts.append(facts.ModuleLeft(module.name, why, lost))
    _announce(central, module, MODULE_LEFT, Departure(module.name, why, module.process, lost))


def _announce(central: State, module: Module, notice: Notice[D], data: D) -> None:
    """Broadcast that a module joined or left, unless it is a command such as ``tca top``."""
    if not module.name.startswith(COMMANDS):
        broadcast_notice(central, notice, data)


def _fail_or_drop(
    central: State, delivery: Delivery, module: Module, why: str, *, lost: bool, is_uncertain: bool
) -> None:
    """End a delivery of a closed connection that no other handler may finish."""
    if not lost and delivery.message.fans_out and not delivery.message.message_class.has_reply:
        drop(central, delivery, f"module '{module.name}' left before it began with it")
        return
    if isinstance(delivery, Task) and delivery.handling_id != delivery.id:
        central.facts.append(facts.Returned(delivery.handling_id, Outcome.FAILED, b""))
    fire_after(central, delivery, RETURNED | FAILURE)
    text = f"module '{module.name}' was lost: {why}"
    failure = (
        RaisedFailure(UNCERTAIN, text, kinds=(MODULE_LOST,))
        if is_uncertain
        else RaisedFailure(MODULE_LOST, text)
    )
    fail_delivery(central, delivery, failure)


def _reassign(central: State, delivery: Delivery) -> None:
    """Route a delivery again whose module has left without beginning it."""
    if not isinstance(delivery, Task):
        central.dispatcher.route(delivery)
        return
    # Record that the task is in no queue: it may be held or killed before it is queued again.
    central.facts.append(facts.Unqueued(delivery.handling_id))
    restart(central, delivery)
    if not delivery.killed:
        central.agenda.recheck_restart(delivery)


# --- messages and handlers ------------------------------------------------------------------------


def on_register(central: State, connection: Connection, header: headers.Register, _: bytes) -> None:
    """Declare messages and handlers: all of them or none.

    With ``is_ready`` the module reports that it has made the attachments of its start.
    """
    module, registry = connection.module, central.registry
    new = {declared.name: declared for declared in header.messages}
    classes = {declared.name: declared.message_class for declared in header.messages}
    for declared in header.messages:
        registry.check(declared, module)
        check_parts(central, declared, classes)
        check_declared_policy(central, declared, new)
    for handled in header.handlers:
        check_name("resource", handled.resource)
        check_name("pool", handled.pool, or_none=True)
        if handled.message not in new and handled.message not in registry.messages:
            raise RequestError(
                Refusal.UNKNOWN, f"no module has declared message '{handled.message}'"
            )
        if handled.pending < 0:
            text = (
                f"pending={handled.pending} of '{handled.message}': "
                "give 1 or more, or 0 for no limit"
            )
            raise RequestError(Refusal.PROTOCOL, text)
        known = new.get(handled.message) or registry.messages[handled.message].format
        check_custom_handler(handled, known)
    _make_room(central, header)
    for declared in header.messages:
        message, is_new = registry.declare(declared, module)
        if is_new:
            central.facts.append(
                facts.FormatDefined(
                    message.name,
                    message.message_class,
                    declared.data,
                    declared.reply,
                    module.name,
                    declared.life_cycle,
                )
            )
            forget_unfit_value(central, message)
    on_listeners_added(central, [handled.message for handled in header.handlers])
    for handled in header.handlers:
        _add_handler(central, module, handled)
    module.is_ready |= header.is_ready
    central.accept(connection, header.number)


def _make_room(central: State, header: headers.Register) -> None:
    """Make room for a registration. Raise RequestError if that is not possible."""
    names = [declared.name for declared in header.messages]
    new = [name for name in dict.fromkeys(names) if name not in central.registry.messages]
    handled = [handled.message for handled in header.handlers]
    if not (new or handled):
        return
    needed = [one for declared in header.messages for one in declared.needs]
    size = sum(map(type_size, header.messages)) if new else 0
    make_room(
        central,
        new,
        size + (HANDLER_BYTES + RESOURCE_BYTES) * len(handled),
        [*names, *handled, *needed],
    )


def _add_handler(central: State, module: Module, handled: HandlerFormat) -> None:
    """Add a handler. It replaces the module's earlier handler of the same message."""
    if handled.message in module.handlers:
        remove_handlers(central, [module.handlers[handled.message]])
    resource = central.registry.resource(module, handled.resource)
    central.facts.append(
        facts.HandlerAdded(handled.message, module.name, resource.name, handled.accepts)
    )
    message = central.registry.messages[handled.message]
    handler = Handler(message, module, resource, handled)
    central.dispatcher.add_handler(handler)
    send_value_to_watcher(central, handler)


def on_unregister(
    central: State, connection: Connection, header: headers.Unregister, _: bytes
) -> None:
    """Remove a module's handlers. Running handlers continue to their ends."""
    handlers = connection.module.handlers
    names = header.messages or list(handlers)
    remove_handlers(central, [handlers[name] for name in dict.fromkeys(names) if name in handlers])
    if not header.messages and connection.module.has_slots:  # as in ``disconnect``
        central.dispatcher.stranded.clear()
    central.accept(connection, header.number)


def on_recalled(central: State, connection: Connection, header: headers.Recalled, _: bytes) -> None:
    """Take back prefetched messages of a slot. Messages that belong elsewhere by now go there."""
    moved = central.dispatcher.requeue_returned(
        connection, header.deliveries, is_answer=header.is_answer
    )
    _send_elsewhere(central, moved, connection.module.name)


def remove_handlers(central: State, handlers: list[Handler]) -> None:
    """Remove handlers of one module. The messages that waited for them go elsewhere."""
    queued = central.dispatcher.remove_handlers(handlers)
    if queued:
        _send_elsewhere(central, queued, handlers[0].module.name)


def _send_elsewhere(central: State, queued: list[Delivery], module: str) -> None:
    """Route messages again that a module no longer handles.

    Copies of broadcasts and multi-queries were for that module only: they fail or are dropped.
    """
    _route_again(central, [delivery for delivery in queued if not delivery.message.fans_out])
    for delivery in queued:
        if not delivery.message.fans_out:
            continue
        why = f"module '{module}' no longer handles it"
        if delivery.message.message_class.has_reply:
            fail_delivery(central, delivery, RaisedFailure(MODULE_LOST, why))
        else:
            drop(central, delivery, why)


def _route_again(central: State, queued: list[Delivery]) -> None:
    """Route messages again whose handlers were removed.

    Exception handlers come first, because they may end other tasks. A task that the same event has
    killed is not queued again.
    """
    stranded: list[Delivery] = []
    others: list[Delivery] = []
    for delivery in queued:
        if isinstance(delivery, Task) and delivery.killed:
            central.facts.append(facts.Unqueued(delivery.handling_id))
        else:
            (stranded if delivery.is_stranded else others).append(delivery)
    central.dispatcher.route_all(stranded)
    if stranded:
        tasks = [one for one in others if isinstance(one, Task)]
        central.facts.extend(facts.Unqueued(task.handling_id) for task in tasks)
        central.agenda.startable.extend(tasks)
        others = [one for one in others if not isinstance(one, Task)]
    central.dispatcher.route_all(others)
