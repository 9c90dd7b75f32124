"""Commands that change tasks, locks and attachments of a running central.

They are ``tca kill``, ``suspend``, ``resume``, ``retry``, ``raise``, ``unlock`` and ``detach``.
"""

from typing import Any, NamedTuple

import click

from tca_module.client import Client
from tca_tools.errors import ToolError
from tca_tools.live import steering
from tca_tools.live.completion import MODULES, RESOURCES, TASKS
from tca_tools.live.questions import attached_in_all, attached_to
from tca_tools.live.shared import live_command, seconds, task_argument
from tca_tools.live.steering import find_task, too_late
from tca_wire.messages.declarations import Failure
from tca_wire.text.measures import listed, numbered
from tca_wire.text.plain_data import Bare, PlainFormat
from tca_wire.text.printable import printable
from tca_wire.vocabulary import Scope

_ANYTHING: Any = PlainFormat("{}")
_SHOWN = 10
"""Attachments that an error lists."""


@live_command("kill")
@task_argument
@click.option("--descendants", is_flag=True, help="End only what is under it, not the task itself.")
@click.option("--siblings", is_flag=True, help="End only the other children of its parent.")
@click.option(
    "--in",
    "delay",
    metavar="SECONDS",
    type=seconds,
    default=0.0,
    help="Kill it after this time.",
)
@click.option("--why", metavar="TEXT", default="", help="The reason, for the waiting modules.")
def kill(
    client: Client, task: str, delay: float, why: str, *, descendants: bool, siblings: bool
) -> None:
    """End a task and everything under it.

    TASK is a task's number, or its message's name if only one such task lives. Running handlers are
    notified, not interrupted: the task ends when they have returned.
    """
    if descendants and siblings:
        raise click.UsageError(
            "--descendants and --siblings exclude each other: kill them one after the other"
        )
    scope = Scope.TASK
    if descendants or siblings:
        scope = Scope.DESCENDANTS if descendants else Scope.SIBLINGS
    click.echo(steering.kill(find_task(client, task), why, delay, scope))


@live_command("suspend")
@task_argument
def suspend(client: Client, task: str) -> None:
    """Start nothing more of a task until it is resumed.

    TASK is a task's number, or its message's name if only one such task lives. Nothing under it is
    started either. Running handlers are notified; they may pause or finish.
    """
    click.echo(steering.suspend(find_task(client, task)))


@live_command("resume")
@click.argument("task", required=False, shell_complete=TASKS)
def resume(client: Client, task: str | None) -> None:
    """Resume a suspended task with everything under it.

    TASK is a task's number, or its message's name if only one such task lives. Without TASK, a
    restarted central starts tasks again, even if some modules have not come back yet.
    """
    if task is not None:
        click.echo(steering.resume(find_task(client, task)))
    else:
        is_new = client.go_on()
        click.echo("tasks start again" if is_new else "central already starts tasks: nothing to do")


@live_command("retry")
@task_argument
def retry(client: Client, task: str) -> None:
    """Handle a task again, from the beginning.

    TASK is a task's number, or its message's name if only one such task lives. All under it is
    killed first, except monitors of other modules. A running handler is notified; the task starts
    again when it has returned.
    """
    click.echo(steering.retry(find_task(client, task)))


@live_command("raise")
@task_argument
@click.argument("failure")
@click.argument("text", default="")
@click.option("--data", metavar="JSON", help="The failure's data.")
def raise_failure(client: Client, task: str, failure: str, text: str, data: str | None) -> None:
    """Raise a failure on a task, as if its handler had raised it.

    TASK is a task's number, or its message's name if only one such task lives. The nearest
    exception handler is called; without one the top-level task ends. FAILURE is any name; TEXT
    describes the failure to users.
    """
    found = find_task(client, task)
    if not found.fail(Failure(failure, _ANYTHING)(Bare(data) if data is not None else None, text)):
        raise too_late(found, "failed")
    click.echo(f"{printable(str(found))}: failure '{failure}' was raised")


@live_command("unlock")
@click.argument("resource", shell_complete=RESOURCES)
@click.option(
    "--module",
    metavar="NAME",
    shell_complete=MODULES,
    help="Its module, if several modules have such a resource.",
)
def unlock(client: Client, resource: str, module: str | None) -> None:
    """Revoke the lock or reservation of RESOURCE.

    Its holder may still rely on it: check 'tca modules' first.
    """
    was_held = client.unlock(resource, module)
    result = "free again" if was_held else "it had no holder"
    click.echo(f"resource '{printable(resource)}': {result}")


@live_command("detach")
@click.argument("what", required=False)
@click.option("--stale", is_flag=True, help="All attachments left from earlier runs of modules.")
def detach(client: Client, what: str | None, *, stale: bool) -> None:
    """Remove an exception handler, wiretap or monitor.

    WHAT is its number in 'tca attached', or the name of the exception handler, listener or monitor
    if only one has it. Messages that it has sent continue. The module that attached it is not
    notified, and may still rely on it.

    --stale removes everything that a restarted module attached in an earlier run, but not in this
    one.
    """
    if stale == (what is not None):
        raise click.UsageError("give a number or name, or --stale")
    if what is None:
        _detach_stale(client)
    else:
        _detach(client, _find_attached(client, what))


def _detach_stale(client: Client) -> None:
    known = client.status("attached")
    found = [one for one in _all_attached(known) if one.left_by]
    for one in found:
        whose = listed([f"'{name}'" for name in one.left_by])
        _detach(
            client, one._replace(text=f"{one.text}, which {whose} had attached in an earlier run")
        )
    if cut := attached_in_all(known):
        click.echo(f"of {cut} only the first were checked: run the command again")
    elif not found:
        click.echo("nothing is left from earlier runs")


def _detach(client: Client, one: "_Attached") -> None:
    was_there = client.detach(one.number)
    click.echo(f"{printable(one.text)}: " + ("detached" if was_there else "already removed"))


class _Attached(NamedTuple):
    number: int
    name: str
    text: str
    left_by: tuple[str, ...] = ()
    """If it is stale: the modules that attached it in an earlier run."""


def _find_attached(client: Client, what: str) -> _Attached:
    """Return the attachment of that number or name. Raises ToolError if none or several match."""
    known = client.status("attached")
    there, cut = _all_attached(known), attached_in_all(known)
    number = int(what) if what.isdecimal() and what.isascii() else None
    if cut and number is None:
        raise ToolError(
            f"there are {cut}, and central names only the first: give a number, not a name"
        )
    found = [one for one in there if (one.name == what if number is None else one.number == number)]
    if len(found) == 1:
        return found[0]
    if cut and number is not None:  # central may not have listed it
        return _Attached(number, "", f"number {number}")
    if found:
        raise ToolError(
            f"{len(found)} of that name are attached: give the number of one, {_listed(found)}"
        )
    why = f"nothing called '{what}' is attached"
    if number is not None:
        why = _not_attached(client, number)
    others = f"attached are {_listed(there)}" if there else "there are no attachments"
    raise ToolError(f"{why}; {others}")


def _all_attached(known: dict[str, Any]) -> list[_Attached]:
    kinds = (("exception_handlers", "handler"), ("wiretaps", "listener"), ("monitors", "monitor"))
    return [
        _Attached(
            one["id"],
            one[message],
            f"{kind.rstrip('s').replace('_', ' ')} {numbered(one[message], one['id'])}"
            f" of {attached_to(one)}",
            tuple(one["earlier"]) if one["is_stale"] else (),
        )
        for kind, message in kinds
        for one in known[kind]
    ]


def _not_attached(client: Client, number: int) -> str:
    if number > client.status()["newest id"]:
        return f"there is no number {number} yet"
    task = client.task(number) if number else None
    info = task.info() if task is not None else None
    if info is not None and not info.outcome:
        return f"{task} is not attached: 'tca kill {number}' ends it"
    return f"{number} is not attached, or was removed"


def _listed(found: list[_Attached]) -> str:
    return f"{listed([one.text for one in found], named=_SHOWN)}: see 'tca attached'"
