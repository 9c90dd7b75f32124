"""Completes deliveries whose handlers return or fail: advances tasks, and answers senders."""

from tca_central.control.monitors import on_condition_answered
from tca_central.control.revoking import fail_for_lost_locks
from tca_central.errors import RequestError
from tca_central.failing.failures import fail_task, failure_of, kill, reissue
from tca_central.life_cycles.changes import set_ending
from tca_central.locks.claims import end_claims_of, pop_losses, suspect_kept_claims
from tca_central.model.contexts import RaisedFailure
from tca_central.model.deliveries import Connection, Delivery
from tca_central.model.tasks import Task, Verdict
from tca_central.needs.texts import end_of_multi_query
from tca_central.state import Collector, State, drop
from tca_central.watching.taps import fire_after
from tca_wire.journal import facts
from tca_wire.messages.failures import HANDLER_ERROR, OVERLOAD
from tca_wire.messages.formats import NIL
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer, ToCentral
from tca_wire.packets.large import damage_of, held_size
from tca_wire.rules import FAILURE, REPLIED, RETURNED, SUCCESS
from tca_wire.vocabulary import Dropping, Limit, Outcome, Refusal, Role

_LONGEST_TEXT = 200
"""Characters of each failure's text in the answer to a multi-query."""

_RETURNED_WELL = RETURNED | SUCCESS
_SMALL = 1000
"""A result of at most this number of bytes is accepted even if memory is full."""


def _running_delivery(central: State, connection: Connection, delivery_id: int) -> Delivery | None:
    """Return the delivery that a handler answers; None if the answer is late or a repetition.

    Refuse a late answer; ignore a repetition. Raise RequestError if the slot never had the
    delivery, or has answered it.
    """
    delivery = central.dispatcher.running.get(delivery_id)
    if delivery is None:
        delivery = central.dispatcher.begin_prefetched(connection, delivery_id)
    if delivery is not None and delivery.slot is connection:
        return delivery
    if late := connection.late_answers.pop(delivery_id, ""):
        central.facts.append(facts.Ignored(connection.module.name, late))
        central.notify(connection, headers.Refused(0, Refusal.TOO_LATE, late))
        return None
    if delivery_id <= connection.repeats_until:
        return None
    answer = f"module '{connection.module.name}' answers delivery {{{delivery_id}}}"
    raise RequestError(Refusal.UNKNOWN, f"{answer}, which it was not given or has answered")


def on_reply(central: State, connection: Connection, header: headers.Reply, body: bytes) -> None:
    """Complete a delivery whose handler has returned."""
    _complete(central, connection, header, body)


def on_replies(
    central: State, connection: Connection, header: headers.Replies, body: bytes
) -> None:
    """Complete several deliveries of a slot whose handlers have returned.

    A reply that is wrong is refused; the others are accepted.
    """
    sizes, now, offset = sum(ended.size for ended in header.ended), central.clock.now, 0
    if sizes != len(body):
        raise RequestError(Refusal.PROTOCOL, f"replies of {sizes} bytes, and a body of {len(body)}")
    for ended in header.ended:
        connection.next_began_at = connection.to_central_time(now, ended.ago + ended.took)
        reply, offset = body[offset : offset + ended.size], offset + ended.size
        one = headers.Reply(ended.delivery, ended.took)
        try:
            _complete(central, connection, one, reply or NIL, ended.ago)
        except RequestError as error:
            central.refuse(connection, 0, error.refusal, error.text)
    connection.next_began_at = (
        connection.to_central_time(now, header.begun) if header.begun >= 0 else 0.0
    )


def _complete(
    central: State,
    connection: Connection,
    header: headers.Reply,
    body: bytes,
    ago: float = 0.0,
) -> None:
    """Complete a delivery whose handler has returned *ago* seconds ago.

    The delivery fails if central has refused more *quiet* tasks than the handler knows of, or if
    its task can't end in this way.
    """
    number = header.delivery
    delivery = _running_delivery(central, connection, number)
    if delivery is None:
        return
    task = delivery if isinstance(delivery, Task) else None
    refused, now = delivery.refused, central.clock.now
    error = refused.text if refused.delivery == number and refused.number > header.refusals else ""
    if error or (task is not None and (error := set_ending(central, task, header.transition))):
        on_fail(central, connection, headers.Fail(number, HANDLER_ERROR, error), b"")
        return
    if task is not None and (why := _why_not_stored(central, task, body)):
        text = f"its result is not taken: {why}"
        on_fail(central, connection, headers.Fail(number, OVERLOAD, text), b"")
        return
    ended = max(delivery.since, connection.to_central_time(now, ago)) if ago else now
    central.facts.append(
        facts.Returned(
            delivery.handling_id,
            Outcome.DONE,
            body,
            ended if ended < now else 0.0,
            task.ending if task is not None else "",
        )
    )
    central.dispatcher.complete(delivery, ended, header.took)
    # Claims end first: what waited goes before the listeners.
    if central.claimed_for and (task is None or task.killed):
        end_claims_of(central, delivery, "it has ended" if task is None else "it was killed")
    fire_after(central, delivery, _RETURNED_WELL)
    if task is None:
        if delivery.message.message_class.has_reply:
            fire_after(central, delivery, REPLIED, body)
            _answer_query(central, delivery, Answer(delivery.number), body)
    elif central.agenda.end_or_retry(task):
        suspect_kept_claims(central, task)  # of a task to be retried: a killed one has none
    else:
        # A result of None is stored as no bytes; for a task that has failed, as the bytes of None.
        result = b"" if body == NIL and task.failure is None else body
        central.tree.grow(task, held_size(result) - held_size(task.result))
        task.result = result
        central.agenda.mark_returned(task)
        suspect_kept_claims(central, task)
        fail_for_lost_locks(central, connection, task)
    pop_losses(connection, delivery)


def _why_not_stored(central: State, delivery: Delivery, body: bytes) -> str:
    """Return why there is no room for a task's result or its failure's data; "" if there is."""
    return (
        central.refuse_if_full(held_size(body))
        if held_size(body) > _SMALL and isinstance(delivery, Task)
        else ""
    )


def on_fail(central: State, connection: Connection, header: headers.Fail, body: bytes) -> None:
    """Complete a delivery whose handler fails or, as an exception handler, reissues its failure."""
    delivery = _running_delivery(central, connection, header.delivery)
    if delivery is None:
        return
    is_exception = isinstance(delivery, Task) and delivery.role is Role.EXCEPTION
    if header.reissue and not is_exception:
        text = f"message {delivery.message_id} handles no failure, so there is none to be reissued"
        raise RequestError(Refusal.PROTOCOL, text)
    if why := _why_not_stored(central, delivery, body):
        text = f"the data of failure '{header.failure}' are not taken: {why}\n{header.text}"
        header, body = headers.Fail(header.delivery, OVERLOAD, text, reissue=header.reissue), b""
    outcome = Outcome.DONE if header.reissue else Outcome.FAILED
    central.facts.append(facts.Returned(delivery.handling_id, outcome, body))
    central.dispatcher.complete(delivery, central.clock.now)
    end_claims_of(central, delivery, "its handler failed")
    fire_after(central, delivery, RETURNED | (0 if header.reissue else FAILURE))
    pop_losses(connection, delivery)
    if not (header.reissue and isinstance(delivery, Task)):
        fail_delivery(central, delivery, failure_of(header, body))
    elif not central.agenda.end_or_retry(delivery):
        reissue(central, delivery)


def on_postpone(central: State, connection: Connection, header: headers.Postpone, _: bytes) -> None:
    """Record that a handler has returned without a reply, which comes later."""
    dispatcher, number = central.dispatcher, header.delivery
    delivery = dispatcher.running.get(number) or dispatcher.begin_prefetched(connection, number)
    is_mine = delivery is not None and delivery.slot is connection
    if delivery is not None and is_mine and delivery not in dispatcher.lending.postponed:
        central.facts.append(facts.Postponed(delivery.handling_id, header.frees_slot))
        dispatcher.postpone(delivery, frees_slot=header.frees_slot)


def fault_of(body: bytes) -> str:
    """Return why a long or large body is refused, or ""."""
    if len(body) <= Limit.BODY:
        return damage_of(body)
    return (
        f"a body of {len(body):,} bytes; at most {Limit.BODY:,} are allowed: "
        "send a reference to the data instead"
    )


def refuse_body(central: State, connection: Connection, header: ToCentral, text: str) -> None:
    """Refuse a body. If it is a handler's answer, the delivery fails."""
    if not isinstance(header, headers.Reply | headers.Fail):
        raise RequestError(Refusal.PROTOCOL, text)
    failure = headers.Fail(header.delivery, HANDLER_ERROR, f"its answer has {text}")
    on_fail(central, connection, failure, b"")


def fail_delivery(central: State, delivery: Delivery, failure: RaisedFailure) -> None:
    """Raise a failure on a delivery that no handler has any more."""
    delivery.message.failed += 1
    if isinstance(delivery, Task):
        fail_task(central, delivery, failure)
    else:
        end_claims_of(central, delivery, "it failed")
        central.record_failure(delivery, failure)
        answer = Answer(delivery.number, Outcome.FAILED, failure.name, failure.text)
        _answer_query(central, delivery, answer, failure.body, failure.kinds)


def report_displaced(central: State, delivery: Delivery, why: str) -> None:
    """End a waiting delivery that a newer delivery of the same message has displaced."""
    if isinstance(delivery, Task):
        kill(central, delivery, Verdict(f"{OVERLOAD}: {why}"))
    elif delivery.message.message_class.has_reply:
        fail_delivery(central, delivery, RaisedFailure(OVERLOAD, why))
    else:
        drop(central, delivery, why, Dropping.DISPLACED)


def _answer_query(
    central: State, delivery: Delivery, answer: Answer, body: bytes, kinds: tuple[str, ...] = ()
) -> None:
    """Pass an answer on to the module, monitor or multi-query that sent the query."""
    if delivery.number:
        sender = delivery.sender
        if sender is not None and sender.outstanding.pop(delivery.number, None) is not None:
            central.facts.append(facts.Answered(delivery.id))
            central.answer(sender, delivery.number, answer, body)
    elif (watch := central.watch_of_condition.pop(delivery.id, None)) is not None:
        on_condition_answered(central, watch, answer, body, kinds)
    elif (collector := central.collectors.pop(delivery.id, None)) is not None:
        _collect(central, collector, delivery, answer, body)


def _collect(
    central: State, collector: Collector, delivery: Delivery, answer: Answer, body: bytes
) -> None:
    """Add a reply or failure to a multi-query."""
    del collector.pending[delivery.id]
    module = collector.module_of.pop(delivery.id)
    central.budget.collector_bytes -= collector.size
    if answer.outcome is Outcome.DONE and collector.wanted:
        collector.wanted -= 1
        collector.answered += 1
        collector.end = Answer(collector.number), b""
        central.notify(collector.connection, Answer(collector.number, more=True), body)
    else:
        text = answer.text.partition("\n")[0][:_LONGEST_TEXT]
        collector.failures.append(f"{module} failed ({answer.failure}{text and f': {text}'})")
        # Unless a reply comes, the multi-query ends with its first failure.
        if collector.end is None:
            if held_size(body) > _SMALL and central.refuse_if_full(held_size(body)):
                body = b""
            end = Answer(collector.number, answer.outcome, answer.failure, answer.text)
            collector.end = end, body
    central.budget.collector_bytes += collector.size
    end_if_complete(central, collector)


def end_if_complete(central: State, collector: Collector) -> None:
    """Answer a multi-query if no more replies are wanted or possible."""
    is_complete = not collector.wanted or not collector.pending
    if is_complete and collector.connection.outstanding.pop(collector.number, None) is not None:
        central.facts.append(facts.Answered(collector.id))
        end_collector(central, collector)
        answer, body = Answer(collector.number), b""
        if collector.end is not None and collector.end[0].outcome is not Outcome.DONE:
            answer, body = end_of_multi_query(central, collector, collector.number)
        central.answer(collector.connection, collector.number, answer, body)


def end_collector(central: State, collector: Collector) -> None:
    """Forget a multi-query. Later answers to its copies are ignored."""
    central.budget.collector_bytes -= collector.size
    for copy in collector.pending:
        del central.collectors[copy]
