"""Begins and ends the waits of modules for a moment of a task, or for an answer."""

from tca_central.life_cycles.observing import start_observers_wait
from tca_central.locks.claims import release_claim
from tca_central.model.budget import WAIT_BYTES
from tca_central.model.deliveries import Connection, Delivery, PresenceWait
from tca_central.model.intervals import checked_moment
from tca_central.model.observers import Observation
from tca_central.model.resources import Claim
from tca_central.needs.texts import end_of_wait
from tca_central.outgoing.availability import end_presence_wait
from tca_central.requests.replying import end_collector
from tca_central.state import Collector, State, TaskWait, dropped_fact
from tca_wire.journal import facts
from tca_wire.messages.failures import DEADLOCK
from tca_wire.packets import headers
from tca_wire.vocabulary import Dropping

Awaited = Delivery | Collector | TaskWait | Observation
"""The kinds of outstanding requests whose answers a sender may await."""
_WHY_DROPPED = {Dropping.GIVEN_UP: "its sender gave up", Dropping.DEADLOCK: DEADLOCK}


def on_await_point(
    central: State, connection: Connection, header: headers.AwaitPoint, _: bytes
) -> None:
    """Begin a module's wait for a moment of a task."""
    moment = checked_moment(header.point)
    task = central.tree.task(header.point.task)
    if task is not None:
        outcome = central.outcome(task)
    else:
        outcome = central.memory.known_outcome(header.point.task)
    central.check_declared(WAIT_BYTES)
    wait = TaskWait(connection, header)
    connection.outstanding[header.number] = wait
    central.facts.append(
        facts.WaitBegan(connection.module.name, header.origin, wait.task_id, moment)
    )
    if task is None or task.reached & moment:
        wait.answer(central, outcome)
    else:
        central.agenda.add_waiter(task, moment, wait)
        if header.blocking:
            central.block(connection, header.number, header.origin, brief=header.brief)
        central.dispatcher.lending.to_lend.append(connection)


def on_await(central: State, connection: Connection, header: headers.Await, _: bytes) -> None:
    """Begin or end a sender's wait for answers.

    Record nothing if an answer is on its way: the sender continues when that answer arrives.
    """
    numbers = (header.request, *header.others)
    found = (connection.outstanding.get(number) for number in numbers)
    awaited = [one for one in found if isinstance(one, Awaited)]
    observed = [one for one in awaited if isinstance(one, Observation)]
    if connection.unconfirmed and not observed:
        central.confirm_tasks(connection)
    if header.seen < 0:
        for one in observed:
            central.end_observers_wait(one)
    elif sum(one.notifications for one in observed) == header.seen and len(awaited) == len(numbers):
        _begin_waits(central, connection, header, awaited)


def _begin_waits(
    central: State, connection: Connection, header: headers.Await, awaited: list[Awaited]
) -> None:
    """Record the waits for the *awaited* answers.

    A wait for a query is *brief*: central does not check it for a deadlock. The sender's own
    resource may answer the query while the sender waits.
    """
    for due in awaited:
        if isinstance(due, Delivery | Collector):
            central.facts.append(facts.Awaited(due.id))
        elif isinstance(due, Observation):
            start_observers_wait(central, due)
    if header.blocking and connection.waits.keys().isdisjoint((header.request, *header.others)):
        brief = header.brief or isinstance(awaited[0], Delivery | Collector)
        central.block(
            connection, header.request, awaited[0].origin, brief=brief, others=header.others
        )
        central.dispatcher.lending.to_lend.append(connection)


def on_await_any(
    central: State, connection: Connection, header: headers.AwaitAny, _: bytes
) -> None:
    """Begin the wait of a handler's coroutine for one of several answers.

    The coroutine does not wait if one of the answers was sent already.
    """
    central.unblock_coroutine(connection, header.delivery)
    numbers = tuple(dict.fromkeys(header.requests))
    delivery = central.dispatcher.running.get(header.delivery)
    is_handled = delivery is not None and delivery.slot is connection
    if numbers and is_handled and all(_may_await(connection, number) for number in numbers):
        central.block_coroutine(connection, numbers, header.delivery)
        central.dispatcher.lending.to_lend.append(connection)


def _may_await(connection: Connection, number: int) -> bool:
    """Whether a coroutine may wait for a request's answer: it is due, and no thread awaits it."""
    due = connection.outstanding.get(number)
    is_due = isinstance(due, Delivery | TaskWait) or (
        isinstance(due, Observation) and due.is_awaited
    )
    return is_due and number not in connection.waits


# --- tasks within waits ---------------------------------------------------------------------------


def lend(central: State, slot: Connection) -> None:
    """Have a slot handle a queued task within the wait of its handler, if the wait needs the task.

    If the slot's handlers have all returned, and reply later, any task below them will do.
    """
    dispatcher = central.dispatcher
    if slot.resource is None or not slot.resource.lendable or dispatcher.are_tasks_paused:
        return
    awaited: set[int] | None = None
    if (handler := dispatcher.lending.handler_in(slot)) is not None:
        due = [slot.outstanding.get(number) for number in dispatcher.lending.waits_of(slot)]
        awaited = {one.task_id for one in due if isinstance(one, TaskWait)}
        awaited.update(  # a coroutine does not block its slot
            one.task_id
            for one in slot.outstanding.values()
            if isinstance(one, TaskWait) and one.lends_slot and one.origin == handler.handling_id
        )
        awaited.update(one.task_id or one.below for one in due if isinstance(one, Observation))
    elif slot.has_room:
        return  # it is free, or about to be
    if (task := dispatcher.lending.task_to_lend(slot, awaited)) is not None:
        dispatcher.lend(task, slot)


# --- give up --------------------------------------------------------------------------------------


def on_give_up(central: State, connection: Connection, header: headers.GiveUp, _: bytes) -> None:
    """End a sender's wait for an answer. If the header has a number, answer why there was none."""
    connection.lost_claims.pop(header.request, None)
    answer, body = end_of_wait(central, connection, header.request, header.number)
    give_up(central, connection, header.request, where=answer.text.partition("\n")[0])
    if header.number:
        central.answer(connection, header.number, answer, body)


def on_release(central: State, connection: Connection, header: headers.Release, _: bytes) -> None:
    """Release a module's lock or reservation. The answer has the claim's id (0: not held)."""
    connection.lost_claims.pop(header.request, None)
    claim = central.claims.get((connection, header.request))
    claim_id = claim.id if claim is not None and claim.is_granted else 0
    give_up(central, connection, header.request)
    central.accept(connection, header.number, claim_id)


def give_up(
    central: State,
    connection: Connection,
    number: int,
    dropping: Dropping = Dropping.GIVEN_UP,
    where: str = "",
) -> None:
    """Forget that an answer is due. Drop a query that no handler has yet.

    *where* is the place of the query, for the journal.
    """
    why = _WHY_DROPPED[dropping]
    due = connection.outstanding.pop(number, None)
    if isinstance(due, PresenceWait):
        end_presence_wait(central, due)
    elif isinstance(due, Observation):
        central.end_observers_wait(due)
        central.observers.remove(due)
    elif isinstance(due, TaskWait):
        if (task := central.tree.tasks.get(due.task_id)) is not None:
            central.agenda.stop_waiting(task, due)
        central.facts.append(facts.WaitEnded(connection.module.name, due.origin, due.task_id))
    elif due is None or isinstance(due, Claim):
        release_claim(central, connection, number, why)
    elif isinstance(due, Collector):
        end_collector(central, due)
        for delivery in due.pending.values():
            _abandon(central, delivery, ())
        central.facts.append(
            facts.Dropped(due.id, due.message.name, why, where=where, dropping=dropping)
        )
    elif isinstance(due, Delivery):
        _abandon(central, due, (dropped_fact(due, why, where, dropping),))
    central.unblock(connection, number)


def _abandon(central: State, delivery: Delivery, dropped: tuple[facts.Dropped, ...]) -> None:
    """Drop a query that waits for a handler. If a handler has it, the handler should return soon.

    *dropped* are the facts to record.
    """
    if delivery.queues is None:
        central.facts.extend(dropped)
        if delivery.slot is not None:
            central.expect_return(delivery.slot, delivery)
    else:
        central.dispatcher.withdraw(delivery, facts_of_drop=dropped)
