"""Waits that begin after the request, and waits that end without an answer."""

from tca_central.locks.claims import give_up_claim
from tca_central.model.deliveries import Connection, Delivery
from tca_central.model.resources import Claim
from tca_central.needs.texts import end_of_wait
from tca_central.state import Collector, PresenceWait, State, TaskWait, dropped_fact
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.text.facts_in_words import GAVE_UP


def on_await(central: State, connection: Connection, header: headers.Await, _: bytes) -> None:
    """A sender now waits for its answer. That is no suspect: its own resource may answer within the wait."""
    due = connection.outstanding.get(header.request)
    if not isinstance(due, Delivery | Collector):
        return
    central.facts.append(facts.Awaited(due.id))
    if header.blocking and header.request not in connection.waits:
        central.block(connection, header.request, due.origin, brief=True)


def on_give_up(central: State, connection: Connection, header: headers.GiveUp, _: bytes) -> None:
    """The sender no longer waits for an answer."""
    connection.lost_claims.pop(header.request, None)
    answer, body = end_of_wait(central, connection, header.request, header.number)
    give_up(central, connection, header.request, where=answer.text.partition("\n")[0])
    if header.number:
        central.send(connection, header.number, answer, body)


def on_release(central: State, connection: Connection, header: headers.Release, _: bytes) -> None:
    """The sender no longer needs what it has locked or reserved."""
    connection.lost_claims.pop(header.request, None)
    claim = central.claims.get((connection, header.request))
    had = claim.id if claim is not None and claim.is_granted else 0
    give_up(central, connection, header.request)
    central.accept(connection, header.number, had)


def give_up(central: State, connection: Connection, number: int, why: str = GAVE_UP, where: str = "") -> None:
    """Forget that an answer is due; a query that no handler has yet is dropped. *where* it was, for the journal."""
    central.unblock(connection, number)
    due = connection.outstanding.pop(number, None)
    if isinstance(due, TaskWait):
        if (task := central.tree.tasks.get(due.task_id)) is not None:
            central.agenda.stop_waiting(task, due)
        central.facts.append(facts.WaitEnded(connection.module.name, due.origin, due.task_id))
    elif isinstance(due, PresenceWait):
        due.end()
    elif due is None or isinstance(due, Claim):
        give_up_claim(central, connection, number, why)
    elif isinstance(due, Collector):
        for delivery in due.pending.values():
            _abandon(central, delivery)
        central.facts.append(facts.Dropped(due.id, due.message.name, why, where=where))
    elif isinstance(due, Delivery):
        _abandon(central, due)
        central.facts.append(dropped_fact(due, why, where))


def _abandon(central: State, delivery: Delivery) -> None:
    if delivery.queues is not None:
        central.dispatcher.withdraw(delivery)
        central.collectors.pop(delivery.id, None)
