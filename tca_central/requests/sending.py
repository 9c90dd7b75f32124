"""What each message from a module does, once it has joined: check, record, tell the parts of central it concerns.

One function a message; HANDLERS in core.py says which. A function that raises RequestError has changed nothing.
"""

from typing import Any

import msgspec

from tca_central.control.keeping import check_room, keep
from tca_central.control.kills_and_suspension import check_parting, keep_for_termination, set_deadline
from tca_central.control.monitors import tested
from tca_central.control.revoking import warn_if_taken
from tca_central.errors import RequestError
from tca_central.failing.attaching import attach, check_attachments
from tca_central.failing.failures import fail_task, failure_of, kill, reissue
from tca_central.locks.claims import end_with, outlive, taken_from
from tca_central.model.clock import checked_seconds
from tca_central.model.registry import Connection, Delivery, MessageType
from tca_central.model.task_tree import Task, Verdict
from tca_central.needs.texts import end_of_multi_query, why_full
from tca_central.outgoing.central_messages import at_birth
from tca_central.outgoing.direct_routes import tell_sender
from tca_central.outgoing.fan_out import copies, route_statement
from tca_central.state import Collector, Failure, State, dropped
from tca_central.status import topics as status
from tca_central.watching.taps import happened
from tca_central.watching.watches import become_monitor, check_options, ends_by_itself, enlist, is_put_by_others
from tca_wire.constraints import Constraint
from tca_wire.journal import facts
from tca_wire.messages.failures import OVERLOAD
from tca_wire.packets import headers
from tca_wire.packets.headers import Accepted, Answer
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import END_ACHIEVING, ROOT, Moment, TaskId
from tca_wire.rules import FAILURE, REPLIED, RETURNED, SENT, SUCCESS
from tca_wire.vocabulary import Limit, MessageClass, Outcome, Refusal, Role

MOST_CONSTRAINTS = 1000
_LONGEST = 200
"""Characters that are told of the text of each failure of a multi-query."""
"""In one request: so long must everybody else wait for it."""

NIL = b"\xc0"  # None as MessagePack


# --- sending ---------------------------------------------------------------------------------------------------------


def on_send(central: State, connection: Connection, header: headers.Send, body: bytes) -> None:
    """A message to be routed by its class."""
    message = central.registry.messages.get(header.message)
    if message is None:
        text = f"nobody has declared message '{header.message}': register it before it is sent"
        raise RequestError(Refusal.UNKNOWN, text)
    if message.message_class.keeps_value:
        raise RequestError(Refusal.PROTOCOL, f"'{message.name}' is a variable: it is set, not sent")
    if message.is_notice:
        raise RequestError(Refusal.PROTOCOL, f"'{message.name}' is a notice: only central sends it")
    if not header.number and message.message_class.has_reply:
        raise RequestError(Refusal.PROTOCOL, f"{message.message_class} '{message.name}' needs a request number")
    if header.when_killed:
        check_parting(message, header.parent)
    if header.if_handled and not message.serving:
        if header.number:
            central.send(connection, header.number, Accepted(header.number))
        return
    if message.route:
        tell_sender(central, connection, message)
    ROUTES[message.message_class](central, connection, header, message, body)


def _received(
    connection: Connection, header: headers.Send, made: Delivery, constraints: list[Constraint]
) -> facts.Received:
    message = made.message
    parent = header.parent if message.message_class.is_task else ROOT
    sender, origin = connection.module.name, header.origin
    return facts.Received(
        made.id, message.name, message.message_class, sender, parent, origin, header.blocking, made.body, constraints
    )


def _make(central: State, connection: Connection, header: headers.Send, message: MessageType, body: bytes) -> Delivery:
    delivery = Delivery(central.new_id(), message, body, connection)
    delivery.priority, delivery.origin = header.priority, header.origin
    central.facts.append(_received(connection, header, delivery, []))
    happened(central, delivery, SENT)
    return delivery


def _route_statement(
    central: State, connection: Connection, header: headers.Send, message: MessageType, body: bytes
) -> None:
    delivery = _make(central, connection, header, message, body)
    route_statement(central, delivery)
    if header.number:
        central.send(connection, header.number, Accepted(header.number, delivery.id))


def _route_query(
    central: State, connection: Connection, header: headers.Send, message: MessageType, body: bytes
) -> None:
    if central.dispatcher.is_full(message):
        raise RequestError(Refusal.OVERLOAD, f"{why_full(central, message)}: try later")
    delivery = _make(central, connection, header, message, body)
    delivery.number = header.number
    connection.outstanding[header.number] = delivery
    central.dispatcher.route(delivery)
    if header.blocking:
        central.block(connection, header.number, header.origin, brief=header.brief)


def _route_multi_query(
    central: State, connection: Connection, header: headers.Send, message: MessageType, body: bytes
) -> None:
    original = _make(central, connection, header, message, body)
    for_each = copies(central, original)
    wanted = min(header.maximum, len(for_each)) if header.maximum > 0 else len(for_each)
    collector = Collector(connection, header.number, original, wanted)
    connection.outstanding[header.number] = collector
    for copy, resource in for_each:
        collector.pending[copy.id], collector.asked[copy.id] = copy, resource.module
        central.collectors[copy.id] = collector
    for copy, resource in for_each:
        if central.dispatcher.is_full(message, resource):
            fail_delivery(central, copy, Failure(OVERLOAD, why_full(central, message, resource)))
        else:
            central.dispatcher.route(copy, resource)
    if header.blocking and header.number in connection.outstanding:
        central.block(connection, header.number, header.origin, brief=True)
    _end_if_complete(central, collector)


def _route_task(
    central: State, connection: Connection, header: headers.Send, message: MessageType, body: bytes
) -> None:
    _check_number(header.constraints)
    check_attachments(central, header.attachments)
    checked_seconds(header.deadline, f"a deadline of '{message.name}'")
    if header.keep:
        check_room(central)
    parent = central.tree.root if header.parent == ROOT else central.tree.task(header.parent)
    if parent is None:
        text = f"task {header.parent} has ended: nothing can be added under it"
        raise RequestError(Refusal.TOO_LATE, text)
    if header.when_killed:
        keep_for_termination(central, parent, message, body)
        central.send(connection, header.number, Accepted(header.number))
        return
    task = Task(TaskId(central.new_id()), message, body, connection)
    task.priority, task.since = header.priority, central.clock.now
    if message.message_class.is_monitor:
        _make_monitor(central, task, parent, header)
    mark = len(central.facts)
    constraints = central.agenda.add(task, parent, header.flags, header.constraints)
    central.facts[mark:mark] = [_received(connection, header, task, constraints), *at_birth(task)]
    enlist(central, task)
    for attachment in header.attachments:
        attach(central, attachment, task, connection.module.called)
    if header.keep:
        keep(central, task, connection.module)
    happened(central, task, SENT)
    if header.deadline:
        set_deadline(central, task, END_ACHIEVING, header.deadline)
    if header.number:
        central.send(connection, header.number, Accepted(header.number, task.id))


def _make_monitor(central: State, task: Task, parent: Task, header: headers.Send) -> None:
    """A new task is a monitor."""
    options = header.watch or WatchOptions()
    check_options(central, task.message, options)
    _check_end(task.message, parent, options)
    become_monitor(central, task, options)
    task.is_watcher = not (ends_by_itself(task.message, options) or options.for_ever)
    task.more.is_guest = is_put_by_others(central, parent, header.origin)


def _check_end(message: MessageType, parent: Task, options: WatchOptions) -> None:
    """Raises RequestError if a monitor is to watch until the end of what does not end before the monitor has."""
    until = options.until
    if until is None or until.moment is not Moment.END_ACHIEVING:
        return
    above = parent.above(until.task)
    if above is not None:
        text = f"{message.message_class} '{message.name}' under {above} can't watch until that ends, which waits for it"
        raise RequestError(Refusal.CYCLE, f"{text}: without an end of its own it ends with what it watches over")


def _route_exception(
    _: State, _connection: Connection, _header: headers.Send, message: MessageType, _body: bytes
) -> None:
    text = f"exception handler '{message.name}' is not sent: attach it to a task, and raise the failure there"
    raise RequestError(Refusal.PROTOCOL, text)


ROUTES = {
    MessageClass.INFORM: _route_statement,
    MessageClass.QUERY: _route_query,
    MessageClass.BROADCAST: _route_statement,
    MessageClass.MULTI_QUERY: _route_multi_query,
    MessageClass.GOAL: _route_task,
    MessageClass.COMMAND: _route_task,
    MessageClass.EXCEPTION: _route_exception,
    MessageClass.POINT_MONITOR: _route_task,
    MessageClass.POLLING_MONITOR: _route_task,
    MessageClass.DEMON_MONITOR: _route_task,
}
"""One row per message class: how it is routed."""


# --- handlers return -------------------------------------------------------------------------------------------------


def _attended(central: State, connection: Connection, delivery_id: int) -> Delivery | None:
    """What a handler answers; None if that is too late, and it has been told so."""
    delivery = central.dispatcher.attended.get(delivery_id)
    if delivery is None or delivery.slot is not connection:
        if late := connection.late.pop(delivery_id, ""):
            central.facts.append(facts.Ignored(connection.module.name, late))
            central.tell(connection, headers.Refused(0, Refusal.TOO_LATE, late))
            return None
        text = (
            f"module '{connection.module.name}' answers delivery {delivery_id}, which it was not given or has answered"
        )
        raise RequestError(Refusal.UNKNOWN, text)
    return delivery


def on_reply(central: State, connection: Connection, header: headers.Reply, body: bytes) -> None:
    """A handler returned."""
    delivery = _attended(central, connection, header.delivery)
    if delivery is None:
        return
    central.facts.append(facts.Returned(delivery.given_as, Outcome.DONE, body))
    central.dispatcher.complete(delivery)
    happened(central, delivery, RETURNED | SUCCESS)
    if not isinstance(delivery, Task):
        end_with(central, delivery, "it has ended")
        happened(central, delivery, REPLIED, body)
        _answer_query(central, delivery, Answer(delivery.number), body)
    elif delivery.again and not delivery.killed:
        central.agenda.retry(delivery)
    elif delivery.killed:
        end_with(central, delivery, "it was killed")
        central.agenda.returned(delivery)
    else:
        delivery.result = b"" if body == NIL else body
        central.agenda.returned(delivery)
        outlive(central, delivery)
        warn_if_taken(central, connection, delivery)
    taken_from(connection, delivery)


def on_fail(central: State, connection: Connection, header: headers.Fail, body: bytes) -> None:
    """A handler failed."""
    delivery = _attended(central, connection, header.delivery)
    if delivery is None:
        return
    is_exception = isinstance(delivery, Task) and delivery.role is Role.EXCEPTION
    if header.reissue and not is_exception:
        raise RequestError(
            Refusal.PROTOCOL, f"message {delivery.message_id} handles no failure, so there is none to be reissued"
        )
    outcome = Outcome.DONE if header.reissue else Outcome.FAILED
    central.facts.append(facts.Returned(delivery.given_as, outcome, body))
    central.dispatcher.complete(delivery)
    happened(central, delivery, RETURNED | (0 if header.reissue else FAILURE))
    end_with(central, delivery, "its handler failed")
    taken_from(connection, delivery)
    if not (header.reissue and isinstance(delivery, Task)):
        fail_delivery(central, delivery, failure_of(header, body))
    elif delivery.again and not delivery.killed:
        central.agenda.retry(delivery)
    elif delivery.killed:
        central.agenda.returned(delivery)
    else:
        reissue(central, delivery)


def fail_delivery(central: State, delivery: Delivery, failure: Failure) -> None:
    """Raise a failure on a delivery that no handler has any more."""
    delivery.message.failed += 1
    if isinstance(delivery, Task):
        fail_task(central, delivery, failure)
    else:
        end_with(central, delivery, "it failed")
        central.has_failed(delivery, failure)
        answer = Answer(delivery.number, Outcome.FAILED, failure.name, failure.text)
        _answer_query(central, delivery, answer, failure.body, failure.kinds)


def displace(central: State, delivery: Delivery, why: str) -> None:
    """A delivery that waited gave way to a newer one of its message: whoever waits for it is told."""
    if isinstance(delivery, Task):
        kill(central, delivery, Verdict(f"{OVERLOAD}: {why}"))
    elif delivery.message.message_class.has_reply:
        fail_delivery(central, delivery, Failure(OVERLOAD, why))
    else:
        central.facts.append(dropped(delivery, why))


def _answer_query(central: State, delivery: Delivery, answer: Answer, body: bytes, kinds: tuple[str, ...] = ()) -> None:
    if (watch := central.asked.pop(delivery.id, None)) is not None:
        tested(central, watch, answer, body, kinds)
        return
    if collector := central.collectors.pop(delivery.id, None):
        _collect(central, collector, delivery, answer, body)
        return
    sender = delivery.sender
    if sender is not None and delivery.number and sender.outstanding.pop(delivery.number, None) is not None:
        central.facts.append(facts.Answered(delivery.id))
        central.send(sender, delivery.number, answer, body)


def _collect(central: State, collector: Collector, delivery: Delivery, answer: Answer, body: bytes) -> None:
    del collector.pending[delivery.id]
    module = collector.asked.pop(delivery.id)
    if answer.outcome is Outcome.DONE and collector.wanted:
        collector.wanted -= 1
        collector.answered += 1
        collector.end = Answer(collector.number), b""
        central.tell(collector.connection, Answer(collector.number, more=True), body)
    else:
        collector.failures.append(f"{module} failed ({_summary(answer.failure, answer.text)})")
        if collector.end is None:  # until somebody replies it ends with the first failure
            collector.end = Answer(collector.number, answer.outcome, answer.failure, answer.text), body
    _end_if_complete(central, collector)


def _summary(failure: str, text: str) -> str:
    """A failure and the first line of its text."""
    first = text.partition("\n")[0][:_LONGEST]
    return f"{failure}: {first}" if first else failure


def _end_if_complete(central: State, collector: Collector) -> None:
    is_complete = not collector.wanted or not collector.pending
    if is_complete and collector.connection.outstanding.pop(collector.number, None) is not None:
        central.facts.append(facts.Answered(collector.id))
        answer, body = Answer(collector.number), b""
        if collector.end is not None and collector.end[0].outcome is not Outcome.DONE:
            answer, body = end_of_multi_query(central, collector, collector.number)
        central.send(collector.connection, collector.number, answer, body)


# --- tasks: constraints, waits, kills --------------------------------------------------------------------------------


def _check_number(constraints: list[Constraint]) -> None:
    if len(constraints) > MOST_CONSTRAINTS:
        text = f"{len(constraints)} constraints in one request: {MOST_CONSTRAINTS} are allowed, send several requests"
        raise RequestError(Refusal.OVERLOAD, text)


def on_constrain(central: State, connection: Connection, header: headers.Constrain, _: bytes) -> None:
    """Constraints between tasks that exist."""
    _check_number(header.constraints)
    added = central.agenda.constrain(header.constraints)
    if added:
        central.facts.append(facts.Constrained(added))
    central.send(connection, header.number, Accepted(header.number))


def on_inspect(central: State, connection: Connection, header: headers.Inspect, _: bytes) -> None:
    """A module asks about a task and its relatives."""
    task = central.tree.root if header.task == ROOT else central.tree.task(header.task)
    found = status.relatives(central, task or central.kept.get(header.task), header.relation, header.message)
    _answer(central, connection, header.number, found, f"the {header.relation} of task {header.task}")


def on_ask(central: State, connection: Connection, header: headers.Ask, _: bytes) -> None:
    """A module asks what central knows."""
    _answer(central, connection, header.number, status.TOPICS[header.topic](central), f"the answer to '{header.topic}'")


def _answer(central: State, connection: Connection, number: int, value: Any, what: str) -> None:
    body = msgspec.msgpack.encode(value)
    if len(body) > Limit.BODY:
        raise RequestError(Refusal.OVERLOAD, f"{what} has {len(body)} bytes: read the journal")
    central.send(connection, number, Answer(number), body)
