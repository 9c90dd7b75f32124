"""The details of a message, a handling or a task, for whoever clicks it. Pure."""

from tca_tools.explain.waits import of_handler_wait
from tca_tools.export.trace.events import Details
from tca_tools.journal.records import HandlerWait, Handling, Message, Task
from tca_tools.journal.whole_run import Run
from tca_wire.points import describe_moments
from tca_wire.text.bodies import plain_data


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
    """A run of a handler; of the last one with what came of the message."""
    message = run.messages.get(handling.message_id)
    details: Details = {"directly from": handling.direct_from or None} | (of_message(run, message) if message else {})
    details["outcome"] = handling.outcome and str(handling.outcome)
    if message and message.handlings and message.handlings[-1] is handling:
        details |= {"result": plain_data(message.result), "failure data": plain_data(message.failure_data)}
    return details


def of_wait(run: Run, wait: HandlerWait) -> Details:
    """A wait of a handler."""
    return {
        "kind": str(of_handler_wait(run, wait).kind),
        "for": run.describe(wait.awaited),
        "until": ", ".join(describe_moments(wait.moment or 0)) or None,
    }
