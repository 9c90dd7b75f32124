"""The details of a message, a handling or a task, for whoever clicks it. Pure."""

from typing import Any

from tca_tools.run.records import HandlerWait, Handling, Message, Task
from tca_tools.run.whole_run import Run
from tca_tools.why.waits import of_handler_wait
from tca_wire.points import describe_moments
from tca_wire.text.bodies import plain_data

Details = dict[str, Any]


def of_message(run: Run, message: Message) -> Details:
    """A message: its data, its sender, its purpose."""
    parent = message.parent if isinstance(message, Task) else 0
    return {
        "id": message.id,
        "class": str(message.message_class),
        "sender": message.sender,
        "parent": run.describe(parent) if parent else None,
        "role": str(message.role) or None,
        "about": run.describe(message.about) if message.about else None,
        "data": plain_data(message.body),
        "dropped": message.dropped or None,
    }


def of_task(run: Run, task: Task) -> Details:
    """A task, as it was in the end."""
    return of_message(run, task) | {
        "state": str(task.state),
        "failure": task.failure or None,
        "killed": task.killed,
        "killed by": task.killed_by or None,
        "result": plain_data(task.result),
        "failure data": plain_data(task.failure_data),
    }


def of_handling(run: Run, handling: Handling) -> Details:
    """A run of a handler."""
    message = run.messages.get(handling.message_id)
    told: Details = {"directly from": handling.direct_from or None} | (of_message(run, message) if message else {})
    is_last = message is not None and message.handlings[-1:] == [handling]
    told["outcome"] = handling.outcome and str(handling.outcome)
    if message is None or not is_last:
        return told
    return told | {"result": plain_data(message.result), "failure data": plain_data(message.failure_data)}


def of_wait(run: Run, wait: HandlerWait) -> Details:
    """A wait of a handler."""
    kind = of_handler_wait(run, wait).kind
    return {
        "kind": str(kind),
        "for": run.describe(wait.awaited),
        "until": ", ".join(describe_moments(wait.moment or 0)) or None,
    }


def flows_from(message: Message) -> list[int]:
    """The arrows that begin where a message is sent: one along all its stations, but to each receiver of many one."""
    if message.message_class.fans_out:
        return [handling.delivery for handling in message.handlings]
    return [message.id] if message.handlings or message.queueings else []


def flow_to(run: Run, handling: Handling) -> list[int]:
    """The arrow that leads to a handling."""
    message = run.messages.get(handling.message_id)
    if message is None:
        return []
    return [handling.delivery if message.message_class.fans_out else message.id]


def flow_through(run: Run, message_id: int) -> list[int]:
    """The arrow that leads to a wait in a queue, and on from there."""
    message = run.messages.get(message_id)
    return [message.id] if message and not message.message_class.fans_out else []
