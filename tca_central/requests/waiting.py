"""Waits of modules for a moment of a task."""

from tca_central.errors import RequestError
from tca_central.model.deliveries import Connection, Delivery
from tca_central.model.intervals import checked_moment
from tca_central.state import State, TaskWait
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.vocabulary import Outcome, Refusal


def on_wait_for(central: State, connection: Connection, header: headers.AwaitPoint, _: bytes) -> None:
    """A module waits for a moment of a task."""
    moment = checked_moment(header.point)
    task = central.tree.task(header.point.task)
    known = central.outcome(task) if task is not None else _outcome_of_ended(central, header.point.task)
    if known is None:
        text = f"task {header.point.task} ended too long ago to know how: see the journal"
        raise RequestError(Refusal.TOO_LATE, text)
    wait = TaskWait(connection, header)
    connection.outstanding[header.number] = wait
    origin = header.origin
    central.facts.append(facts.WaitBegan(connection.module.name, origin, wait.task_id, moment))
    if task is None or task.reached & moment:
        wait.answer(central, known)
    else:
        central.agenda.wait(task, moment, wait)
        if header.blocking:
            central.block(connection, header.number, header.origin, brief=header.brief)


def on_await_any(central: State, connection: Connection, header: headers.AwaitAny, _: bytes) -> None:
    """The coroutine of a handler can't go on until one of these is answered. Where one has been, it does already."""
    central.unblock_coroutine(connection, header.delivery)
    numbers, delivery = tuple(dict.fromkeys(header.requests)), central.dispatcher.running.get(header.delivery)
    is_handled = delivery is not None and delivery.slot is connection
    if numbers and is_handled and all(_is_awaited(connection, number) for number in numbers):
        central.block_coroutine(connection, numbers, header.delivery)


def _is_awaited(connection: Connection, number: int) -> bool:
    return isinstance(connection.outstanding.get(number), Delivery | TaskWait) and number not in connection.waits


def _outcome_of_ended(central: State, task_id: int) -> tuple[Outcome, str, str, bytes] | None:
    """How a task ended; None if that is forgotten."""
    if (record := central.kept.get(task_id)) is not None:
        return record.outcome
    if task_id <= central.forgotten and task_id not in central.outcomes:
        return None
    return central.outcomes.get(task_id, (Outcome.DONE, "", "", b""))
