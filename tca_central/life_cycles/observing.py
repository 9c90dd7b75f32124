"""Observers are told of each change of a task's state; those who come late, first how things stand."""

from collections.abc import Iterable

import msgspec

from tca_central.errors import RequestError
from tca_central.model.budget import WAIT_BYTES
from tca_central.model.deliveries import Connection
from tca_central.model.observers import Observation
from tca_central.model.tasks import Task
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.life_cycles import GENERAL
from tca_wire.packets.changes import Observe
from tca_wire.packets.headers import Answer
from tca_wire.packets.parts import StateChange
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome, Party, Refusal

MOST_LATE = 10_000
"""Tasks of which an observer who comes late is told."""
MOST_LOOKED_AT = 100_000
"""Tasks that are looked at for that."""


def on_observe(central: State, connection: Connection, header: Observe, _: bytes) -> None:
    """A module wants to be told of states. It is told how things stand; then an answer without a body says that what
    comes now is news.
    """
    observation = Observation(connection, header)
    central.check_declared(WAIT_BYTES)
    if header.task and central.tree.task(header.task) is None:
        _tell_end(central, connection, header)
        return
    if header.below and central.tree.task(header.below) is None:  # nothing stands under it, and nothing will
        central.tell(connection, Answer(header.number, more=True))
        central.send(connection, header.number, Answer(header.number))
        return
    late = _living(central, observation)
    connection.outstanding[header.number] = observation
    central.observers.add(observation)
    for task in late:
        _send(central, observation, msgspec.msgpack.encode(_as_it_stands(task)), task.state)
    observation.told += 1
    central.tell(connection, Answer(header.number, more=True))


def begin_observers_wait(central: State, observation: Observation) -> None:
    """Whoever observes does nothing, as far as is known, until there is news."""
    if not observation.is_awaited:
        observation.is_awaited = True
        central.facts.append(facts.WaitBegan(*observation.wait))


def end_observers_wait(central: State, observation: Observation) -> None:
    """There is news, or nobody waits for it any more."""
    if not observation.is_awaited:
        return
    connection, number = observation.connection, observation.number
    wait = connection.pauses.get(number) or connection.waits.get(number)
    central.unblock(connection, number)
    others = wait.together if wait is not None and not wait.is_coroutine else ()  # a coroutine still awaits the others
    for one in (observation, *map(connection.outstanding.get, others)):
        if isinstance(one, Observation) and one.is_awaited:
            one.is_awaited = False
            central.facts.append(facts.WaitEnded(*one.wait))


def _living(central: State, observation: Observation) -> list[Task]:
    """The tasks that it is about. Raises RequestError if there are too many of them."""
    tree = central.tree
    if observation.task_id:
        return [tree.tasks[observation.task_id]]
    found: Iterable[Task] = tree.tasks.values()
    if observation.below:
        found = (task for task in tree.subtree(tree.tasks[observation.below]) if task.id != observation.below)
    if len(tree.tasks) <= MOST_LOOKED_AT:
        late = [task for task in found if observation.message in ("", task.message.name)]
        if len(late) <= MOST_LATE:
            return late
    text = f"there are {len(tree.tasks)} tasks: observe a message, what is under a task, or one task"
    raise RequestError(Refusal.OVERLOAD, text)


def _tell_end(central: State, connection: Connection, header: Observe) -> None:
    """The task to be observed has ended: tell how."""
    result, failure, text, body = central.known_outcome(header.task)
    kept = central.kept.get(header.task)
    name, goal = (kept.message.name, kept.body) if kept is not None else (header.message, b"")
    message = central.registry.messages.get(name)
    cycle = message.life_cycle if message is not None else GENERAL
    change = StateChange(
        header.task, name, -1, cycle.done if result.lets_go_on else cycle.cancelled, "", Party.SERVER,
        text=_why(failure, text), goal=goal, data=body, is_late=True, is_over=True, outcome=result,
    )  # fmt: skip
    central.tell(connection, Answer(header.number, more=True), msgspec.msgpack.encode(change))
    central.send(connection, header.number, Answer(header.number))


def _why(failure: str, text: str) -> str:
    return f"{failure}: {text}" if failure and text else failure or text


def _as_it_stands(task: Task) -> StateChange:
    progress = task.clients.progress if task.clients is not None else b""
    return StateChange(
        TaskId(int(task.id)), task.message.name, task.serial, task.state, "", Party.CENTRAL, goal=task.body,
        data=progress, is_late=True,
    )  # fmt: skip


def tell(
    central: State, task: Task, transition: str, by: Party, module: str = "", text: str = "", data: bytes = b"",
    *, outcome: Outcome | None = None,
) -> None:  # fmt: skip
    """Tell all who observe a task of a change."""
    if not central.observers.concern(task):
        return
    observers = list(central.observers.of(task))
    is_over = outcome is not None
    if not (observers or is_over):
        return
    change = StateChange(
        TaskId(int(task.id)), task.message.name, task.serial, task.state, transition, by, module, text, task.body, data,
        is_over=is_over, outcome=outcome,
    )  # fmt: skip
    encoded = msgspec.msgpack.encode(change) if observers else b""
    for one in observers:
        _send(central, one, encoded, task.state)
    if is_over:
        for one in [one for one in (*observers, *central.observers.others) if task.id in (one.task_id, one.below)]:
            end_observers_wait(central, one)
            central.observers.remove(one)
            one.connection.outstanding.pop(one.number, None)
            central.send(one.connection, one.number, Answer(one.number))


def _send(central: State, observation: Observation, encoded: bytes, state: str) -> None:
    if not observation.states or state in observation.states:
        end_observers_wait(central, observation)
        observation.told += 1
        central.tell(observation.connection, Answer(observation.number, more=True), encoded)


def tell_birth(central: State, task: Task) -> None:
    """A task is new."""
    module = task.sender.module.name if task.sender is not None else ""
    if task.state == task.message.initial:
        tell(central, task, "initiated", Party.CLIENT if module else Party.CENTRAL, module)


def tell_end(central: State, task: Task) -> None:
    """A task has ended: its last state is that of its outcome."""
    cycle = task.message.life_cycle
    outcome, failure, text, body = central.outcome(task)
    end_state = cycle.done if outcome.lets_go_on else cycle.cancelled
    transition = cycle.ending(task.state, end_state, outcome)
    task.state = end_state
    task.serial += 1
    by = Party.CENTRAL if outcome is Outcome.KILLED else Party.SERVER
    tell(central, task, transition, by, "", _why(failure, text), body, outcome=outcome)
