"""What people ask of a running task, which its handler decides: ``tca update`` and ``cancel``."""

import click

from tca_live import steering
from tca_live.messages import HOW, data_argument, read_data, timeout_option
from tca_live.shared import central_option, talking
from tca_live.steering import find_task
from tca_live.tasks import task_argument
from tca_wire.life_cycles import Effect
from tca_wire.messages.declarations import TaskMessage
from tca_wire.text.printable import printable


@click.command()
@task_argument
@click.option("--why", metavar="TEXT", default="", help="The reason, for its handler and those who watch.")
@central_option
def cancel(task: str, why: str, central: str | None) -> None:
    """Ask for the end of a task.

    TASK is a task's number, or its message's name if only one such task lives. Its handler decides: it may first leave
    things as they should be, or go on. If it knows of no cancels, the task is killed.
    """
    with talking("cancel", central) as client:
        click.echo(steering.cancel(client, find_task(client, task), why))


@click.command(epilog=HOW)
@task_argument
@data_argument
@timeout_option
@click.option("--no-wait", is_flag=True, help="Do not wait for the word of its handler.")
@central_option
def update(task: str, data: tuple[str, ...], timeout: float | None, central: str | None, *, no_wait: bool) -> None:
    """Give a running task a new goal.

    TASK is a task's number, or its message's name if only one such task lives. The command waits until its handler has
    taken the goal over; the exit code is 1 if it rejects it. If it knows of no updates, the task begins anew.
    """
    if no_wait and timeout is not None:
        raise click.UsageError("--no-wait and --timeout are given: leave one of them out")
    with talking("update", central) as client:
        found = find_task(client, task)
        message = client.declared(found.message)
        if not isinstance(message, TaskMessage):
            raise click.UsageError(f"{message.title} takes no new goal: only goals and commands do")
        goal = read_data(message, data)
        message.encode_data(goal)
        name = next((one.name for one in message.life_cycle.transitions if one.effect is Effect.NEW_GOAL), "")
        if not no_wait or not name:
            found.update(goal, timeout=timeout, message=message)
        elif not found.take(name, goal, message=message):
            raise steering.too_late(found, "given a new goal")
        click.echo(printable(f"{found}: " + ("the new goal is asked for" if no_wait else "has the new goal")))
