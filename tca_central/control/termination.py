"""Messages that are sent when a task is killed, to leave things safe (TDL: ON TERMINATE)."""

from tca_central.errors import RequestError
from tca_central.model.deliveries import MessageType
from tca_central.model.task_tree import Task
from tca_central.outgoing.central_messages import make_task
from tca_central.state import State
from tca_wire.journal import facts
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import Refusal, Role

MOST_FAREWELLS = 100
"""Messages that may be kept for the termination of one task."""


def check_farewell(message: MessageType, task_id: int) -> None:
    """Raises RequestError if that message can't be kept for the termination of that task."""
    if not (message.message_class.is_task and message.message_class.may_react):
        text = f"{message.message_class} '{message.name}' can't be sent on termination: goals and commands can"
        raise RequestError(Refusal.PROTOCOL, text)
    if task_id == ROOT:
        text = f"'{message.name}' can't be sent on the termination of the root: it never ends"
        raise RequestError(Refusal.PROTOCOL, text)


def keep_for_termination(central: State, task: Task, message: MessageType, body: bytes) -> None:
    """Keep a message to be sent when the task is killed. If it was killed already and its handler runs, send it now."""
    if task.killed and task.slot is None:
        text = f"{task} was killed and its handler is done: '{message.name}' is not sent on its termination any more"
        raise RequestError(Refusal.TOO_LATE, text)
    if task.killed:
        make_task(central, message, body, task, Role.TERMINATION)
        return
    if len(task.more.farewells) >= MOST_FAREWELLS:
        raise RequestError(Refusal.OVERLOAD, f"{MOST_FAREWELLS} messages wait for the termination of {task} already")
    task.more.farewells.append((message, body))
    central.facts.append(facts.SendPlanned(TaskId(task.id), message.name, body))
