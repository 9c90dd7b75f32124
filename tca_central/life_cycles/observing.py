"""Observers get each change of a task's state. Late observers first get the current state."""

from collections.abc import Iterable

from tca_central.errors import RequestError
from tca_central.model.budget import WAIT_BYTES
from tca_central.model.deliveries import Connection
from tca_central.model.observers import Observation, encode_change
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
"""The number of tasks of which a late observer gets the current state."""
MOST_SEARCHED = 100_000
"""The number of living tasks that central searches for tasks to observe."""


def on_observe(central: State, connection: Connection, header: Observe, _: bytes) -> None:
    """Let a module observe states.

    The module gets the current states, then an answer without a body, then each change.
    """
    observation = Observation(connection, header)
    central.check_declared(WAIT_BYTES)
    if header.task and central.tree.task(header.task) is None:
        _answer_ended(central, connection, header)
        return
    # A task that has ended gets no new tasks under it.
    if header.below and central.tree.task(header.below) is None:
        central.notify(connection, Answer(header.number, more=True))
        central.answer(connection, header.number, Answer(header.number))
        return
    late = _living(central, observation)
    connection.outstanding[header.number] = observation
    central.observers.add(observation)
    for task in late:
        central.notify_observer(observation, encode_change(_current_state(task)), task.state)
    observation.notifications += 1
    central.notify(connection, Answer(header.number, more=True))


def start_observers_wait(central: State, observation: Observation) -> None:
    """Record that an observer, as far as central knows, only waits for the next change."""
    if not observation.is_awaited:
        observation.is_awaited = True
        central.facts.append(facts.WaitBegan(*observation.wait))


def _living(central: State, observation: Observation) -> list[Task]:
    """Return the observed tasks that live. Raises RequestError if there are too many."""
    tree = central.tree
    if observation.task_id:
        return [tree.tasks[observation.task_id]]
    found: Iterable[Task] = tree.tasks.values()
    if observation.below:
        found = (
            task
            for task in tree.subtree(tree.tasks[observation.below])
            if task.id != observation.below
        )
    if len(tree.tasks) <= MOST_SEARCHED:
        late = [task for task in found if observation.message in ("", task.message.name)]
        if len(late) <= MOST_LATE:
            return late
    text = (
        f"there are {len(tree.tasks)} tasks: observe a message, what is under a task, or one task"
    )
    raise RequestError(Refusal.OVERLOAD, text)


def _answer_ended(central: State, connection: Connection, header: Observe) -> None:
    """Answer the observer of an ended task: send the outcome as the only change."""
    result, failure, text, body = central.memory.known_outcome(header.task)
    kept = central.memory.records.get(header.task)
    name, goal = (kept.message.name, kept.body) if kept is not None else (header.message, b"")
    message = central.registry.messages.get(name)
    cycle = message.life_cycle if message is not None else GENERAL
    usual_end = cycle.done if result.lets_successors_continue else cycle.cancelled
    change = StateChange(
        header.task,
        name,
        -1,
        central.memory.end_of(header.task) or usual_end,
        "",
        Party.SERVER,
        text=_failure_text(failure, text),
        goal=goal,
        data=body,
        is_late=True,
        is_over=True,
        outcome=result,
    )
    central.notify(connection, Answer(header.number, more=True), encode_change(change))
    central.answer(connection, header.number, Answer(header.number))


def _failure_text(failure: str, text: str) -> str:
    """Return a failure's name and text; either may be empty."""
    return f"{failure}: {text}" if failure and text else failure or text


def _current_state(task: Task) -> StateChange:
    """Return a task's state as a late observer gets it."""
    progress = task.clients.progress if task.clients is not None else b""
    return StateChange(
        TaskId(int(task.id)),
        task.message.name,
        task.serial,
        task.state,
        "",
        Party.CENTRAL,
        goal=task.body,
        data=progress,
        is_late=True,
    )


def publish_end(central: State, task: Task) -> None:
    """Set the final state of an ended task, and send it to observers.

    The outcome and the life cycle determine the state. Of several transitions, the handler's choice
    counts: the one that it has named, or that has the name of its failure.
    """
    outcome, failure, text, body = central.outcome(task)
    step = task.message.life_cycle.end(task.state, outcome, failure or task.ending)
    task.state = step.target
    task.serial += 1
    by = Party.CENTRAL if outcome is Outcome.KILLED else step.by
    central.notify_observers(
        task, step.name, by, "", _failure_text(failure, text), body, outcome=outcome
    )
