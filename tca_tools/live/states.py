"""Requests to a running task and reports of its state: ``tca update``, ``cancel``, ``watch``."""

from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime
from typing import Any

import click

from tca_module.client import Client
from tca_module.sending.task_ref import Change, TaskRef
from tca_tools.live import steering
from tca_tools.live.completion import TASKS
from tca_tools.live.messages import HOW, data_argument, read_data
from tca_tools.live.shared import (
    as_text,
    json_option,
    live_command,
    plain,
    task_argument,
    timeout_option,
)
from tca_tools.live.steering import find_task, too_late
from tca_wire.life_cycles import Effect
from tca_wire.messages.declarations import TaskMessage
from tca_wire.messages.formats import MISSION_TASK, decode_untyped
from tca_wire.text.bodies import json_text
from tca_wire.text.facts_in_words import state_change
from tca_wire.text.measures import counted
from tca_wire.text.printable import printable


@live_command("cancel")
@task_argument
@click.option(
    "--why", metavar="TEXT", default="", help="The reason, for its handler and its observers."
)
def cancel(client: Client, task: str, why: str) -> None:
    """Request the end of a task.

    TASK is a task's number, or its message's name if only one such task lives. Its handler decides:
    it may clean up before it ends, or reject the request and continue. If the handler does not
    accept cancels, the task is killed.
    """
    click.echo(steering.cancel(client, find_task(client, task), why))


@live_command("update", epilog=HOW)
@task_argument
@data_argument
@timeout_option
@click.option("--no-wait", is_flag=True, help="Do not wait for its handler's answer.")
def update(
    client: Client, task: str, data: tuple[str, ...], timeout: float | None, *, no_wait: bool
) -> None:
    """Give a running task a new goal.

    TASK is a task's number, or its message's name if only one such task lives. The command waits
    until its handler has accepted the goal; the exit code is 1 if it rejects it. If the handler
    does not accept updates, the task starts again. A task of a mission keeps the parameters that
    are not given.
    """
    if no_wait and timeout is not None:
        raise click.UsageError("--no-wait and --timeout exclude each other: leave one of them out")
    found = find_task(client, task)
    message = client.declared(found.message)
    if not isinstance(message, TaskMessage):
        raise click.UsageError(f"{message.title} takes no new goal: only goals and commands do")
    goal = _with_present(found, message, read_data(message, data))
    message.encode_data(goal)
    name = next(
        (one.name for one in message.life_cycle.transitions if one.effect is Effect.NEW_GOAL), ""
    )
    if not no_wait or not name:
        found.update(goal, timeout=timeout, message=message)
    elif not found.take(name, goal, message=message):
        raise too_late(found, "given a new goal")
    result = "the new goal is asked for" if no_wait else "has the new goal"
    click.echo(printable(f"{found}: {result}"))


def _with_present(task: TaskRef, message: TaskMessage[Any, Any], goal: Any) -> Any:
    """Return the new goal. A task of a mission also keeps its present parameters."""
    info = task.info()
    if MISSION_TASK not in message.data.schema or info is None or not isinstance(goal, dict):
        return goal
    return {**(decode_untyped(info.data) or {}), **goal}


@live_command("watch")
@click.argument("what", metavar="[MESSAGE|TASK]", required=False, shell_complete=TASKS)
@click.option(
    "--state",
    "states",
    metavar="STATE",
    multiple=True,
    help="Only changes to this state; may be repeated.",
)
@click.option("--under", metavar="TASK", help="Only tasks under this task.")
@json_option
def watch(
    client: Client, what: str | None, states: tuple[str, ...], under: str | None, *, in_json: bool
) -> None:
    """Print each change of a task's state when it happens.

    MESSAGE selects all tasks of that message, and a number TASK that one task; without either, all
    tasks are watched. First it prints the present state of each living task. It ends with Ctrl-C,
    or with the task. With --json it prints one object a line.
    """
    with suppress(KeyboardInterrupt):
        for change in _changes(client, what, states, under):
            click.echo(json_text(plain(_row(change))) if in_json else _line(change))


def _changes(
    client: Client, what: str | None, states: tuple[str, ...], under: str | None
) -> Iterable[Change]:
    if what is not None and what.isdecimal() and what.isascii():
        if under is not None:
            raise click.UsageError(f"task {what} is one task: leave --under out")
        return (
            one for one in find_task(client, what).changes() if not states or one.state in states
        )
    if what is not None and what not in {one.name for one in client.messages()}:
        client.declared(what)  # raises an error that names the nearest
    below = find_task(client, under) if under is not None else None
    return client.observe(what, states=states, below=below)


def _row(change: Change) -> dict[str, Any]:
    names = "message serial state transition by module text data is_late is_over missed"
    fields = {name: getattr(change, name) for name in names.split()}
    return {"time": datetime.now().astimezone().isoformat(), "task": int(change.task.id), **fields}


def _line(change: Change) -> str:
    """``12:05:01.250  grasp {7}  running  result available by arm: {"force": 1}``."""
    said = ""
    if change.is_late:
        said = "so far" + (f": {change.text}" if change.text else "")
    elif change.transition:
        said = state_change(change.transition, "", change.module, change.text)
    data = "" if change.data is None else as_text(change.data)
    missed = f"({counted(change.missed, 'change')} missed)" if change.missed else ""
    columns = "  ".join(filter(None, (str(change.task), change.state or "ended", missed, said)))
    clock = f"{datetime.now().astimezone():%H:%M:%S.%f}"[:-3]
    return printable(f"{clock}  {columns}" + (f": {data}" if data else ""))
