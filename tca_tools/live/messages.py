"""Messages and variables from the command line: ``tca send``, ``query``, ``get`` and ``set``.

Data are checked against the declared format before they are sent.
"""

import json
import re
import sys
from typing import Any

import click

from tca_module.client import Client
from tca_module.errors import TaskFailed, TaskKilled, Timeout, VariableNotSet
from tca_module.sending.replies import QUERY_TIMEOUT
from tca_module.sending.task_ref import SentTask
from tca_tools.errors import ToolError
from tca_tools.live.completion import is_query, is_sent, messages
from tca_tools.live.shared import as_json, as_text, json_option, live_command, timeout_option
from tca_wire.errors import BadData
from tca_wire.messages.controls import ExceptionHandler
from tca_wire.messages.declarations import (
    Broadcast,
    Command,
    Goal,
    Inform,
    Message,
    MultiQuery,
    Query,
    Variable,
)
from tca_wire.text.plain_data import Bare
from tca_wire.text.printable import printable

_FIELD = re.compile(r"([^\s=\"'{}\[\],]+)=(.*)", re.DOTALL)
HOW = """DATA are fields, 'key=value', with dots for nested fields ('pose.x=1.5'); or one
whole value; or '-' for JSON from the standard input. A value is read as JSON if possible,
else as text. After '--' it may begin with a minus.
"""

variable_argument = click.argument("variable", shell_complete=messages(lambda one: one.keeps_value))
data_argument = click.argument("data", nargs=-1)


@live_command("send", epilog=HOW)
@click.argument("name", shell_complete=messages(is_sent))
@data_argument
@click.option(
    "--wait",
    is_flag=True,
    help="Wait until the goal or command has ended; exit code 1 unless it is done.",
)
@timeout_option
@json_option
def send(
    client: Client,
    name: str,
    data: tuple[str, ...],
    timeout: float | None,
    *,
    wait: bool,
    in_json: bool,
) -> None:
    """Send a message of any class.

    It prints the task of a goal or command, or the reply to a query.
    """
    message: Any = client.declared(name)
    if isinstance(message, Query | MultiQuery):
        _ask(client, message, data, timeout, None, in_json=in_json)
        return
    if isinstance(message, Variable | ExceptionHandler):
        how = "raise its failure with 'tca raise'"
        if isinstance(message, Variable):
            how = "set it with 'tca set'"
        raise click.UsageError(f"{message.title} is not sent: {how}")
    if (wait or timeout is not None) and not isinstance(message, Goal | Command):
        raise click.UsageError(
            f"{message.title} has no end to wait for: leave out --wait and --timeout"
        )
    value = _checked_data(client, message, data)
    if isinstance(message, Inform):
        client.inform(message, value, wait=0)
    elif isinstance(message, Broadcast):
        client.broadcast(message, value, wait=0)
    else:
        sent: SentTask[Any] = client.execute(message, value)
        _follow(sent, timeout, wait=wait or timeout is not None, in_json=in_json)


@live_command("query", epilog=HOW)
@click.argument("name", shell_complete=messages(is_query))
@data_argument
@timeout_option
@click.option(
    "--maximum",
    metavar="N",
    type=click.IntRange(min=1),
    help="Stop after N replies to a multi-query.",
)
@json_option
def query(
    client: Client,
    name: str,
    data: tuple[str, ...],
    timeout: float | None,
    maximum: int | None,
    *,
    in_json: bool,
) -> None:
    """Send a query and print the reply.

    It prints each reply to a multi-query when it arrives.
    """
    message = client.declared(name)
    if not isinstance(message, Query | MultiQuery):
        how = "'tca get' reads it" if isinstance(message, Variable) else "send it with 'tca send'"
        raise click.UsageError(f"{message.title} is not a query: {how}")
    if maximum is not None and isinstance(message, Query):
        raise click.UsageError(f"{message.title} has one reply: leave --maximum out")
    _ask(client, message, data, timeout, maximum, in_json=in_json)


@live_command("get")
@variable_argument
@json_option
def get_variable(client: Client, variable: str, *, in_json: bool) -> None:
    """Print the value of a shared variable.

    The exit code is 1 if it was never set.
    """
    try:
        value = client.get_variable(_variable(client, variable))
    except VariableNotSet:
        raise ToolError(
            f"variable '{variable}' was never set:"
            " set it with 'tca set', or start the module that sets it"
        ) from None
    click.echo(as_json(value) if in_json else as_text(value))


@live_command("set", epilog=HOW)
@variable_argument
@data_argument
def set_variable(client: Client, variable: str, data: tuple[str, ...]) -> None:
    """Give a shared variable a new value."""
    known = _variable(client, variable)
    client.set_variable(known, read_data(known, data))


def _variable(client: Client, name: str) -> Variable[Any]:
    message = client.declared(name)
    if not isinstance(message, Variable):
        raise click.UsageError(f"{message.title} is not a variable: 'tca variables' lists them")
    return message


# --- typed data -----------------------------------------------------------------------------------


def read_data(message: Message[Any, Any], words: tuple[str, ...]) -> Any:
    """Read a message's data from the words of a command line.

    Raises UsageError. A value that does not fit the format raises BadData when it is encoded.
    """
    takes_fields = getattr(message.data, "takes_fields", True)
    if message.data.kind is type(None) and words:
        raise click.UsageError(
            f"{message.title} takes no data, but '{printable(words[0])}' was given"
        )
    if words == ("-",):
        return _from_standard_input()
    if not words:
        return _without_words(message, takes_fields=takes_fields)
    pairs = [_FIELD.fullmatch(word) for word in words]
    if takes_fields and all(pairs):
        return _nested([(pair[1], pair[2]) for pair in pairs if pair])
    if len(words) == 1:
        return Bare(words[0])
    if not takes_fields:
        raise click.UsageError(
            f"{message.title} takes one value ({message.data}), but {len(words)} were given"
        )
    wrong = next(word for word, pair in zip(words, pairs, strict=True) if pair is None)
    raise click.UsageError(
        f"'{printable(wrong)}' is not a field of {message.title}: write key=value"
    )


def _without_words(message: Message[Any, Any], *, takes_fields: bool) -> Any:
    try:
        message.data.encode(None)
    except BadData:
        if not takes_fields:
            raise click.UsageError(
                f"{message.title} wants data ({message.data}), but none were given"
            ) from None
        return {}
    return None


def _from_standard_input() -> Any:
    try:
        return json.loads(sys.stdin.read())
    except (ValueError, RecursionError) as error:
        raise click.UsageError(f"the standard input is not JSON: {error}") from None


def _nested(pairs: list[tuple[str, str]]) -> dict[str, Any]:
    """Return the fields by name; "pose.x" is field x of the field pose."""
    fields: dict[str, Any] = {}
    for name, text in pairs:
        *path, last = name.split(".")
        part = fields
        for step in path:
            part = part.setdefault(step, {})
            if not isinstance(part, dict):
                raise click.UsageError(
                    f"fields '{name}' and '{step}' exclude each other: give one of them"
                )
        if last in part:
            raise click.UsageError(f"field '{name}' is given twice: give it once")
        part[last] = Bare(text)
    return fields


# --- results --------------------------------------------------------------------------------------


def _checked_data(client: Client, message: Message[Any, Any], words: tuple[str, ...]) -> Any:
    """Return the data of a message, checked before it is sent; warn if it has no handler.

    Raises UsageError or BadData.
    """
    value = read_data(message, words)
    message.encode_data(value)
    if not any(handler.capacity for handler in client.handlers(message)):
        is_lost = isinstance(message, Broadcast | MultiQuery)
        effect = "it reaches no module" if is_lost else "it waits for one"
        click.echo(f"{printable(message.title)} has no handler now: {effect}", err=True)
    return value


def _follow(ref: SentTask[Any], timeout: float | None, *, wait: bool, in_json: bool) -> None:
    """Print a task's number and, with *wait*, its outcome."""
    if not in_json:
        click.echo(printable(str(ref)))
    elif not wait:
        click.echo(as_json({"task": ref.id}))
    if not wait:
        return
    continues = f"continues: 'tca kill {ref.id}' ends it"
    try:
        ref.wait(timeout)
    except Timeout:
        if in_json:
            click.echo(as_json({"task": ref.id, "outcome": None}))
        raise ToolError(f"{ref} has not ended within {timeout:g} s, and {continues}") from None
    except KeyboardInterrupt:
        click.echo(f"{printable(str(ref))} {continues}", err=True)
        raise
    _print_outcome(ref, in_json=in_json)


def _print_outcome(ref: SentTask[Any], *, in_json: bool) -> None:
    shown: dict[str, Any] = {"task": ref.id, "outcome": str(ref.wait(0))}
    problem: TaskFailed | TaskKilled | None = None
    try:
        shown["result"] = ref.result()
    except TaskFailed as error:
        shown.update(failure=error.failure, text=error.text, data=error.data)
        problem = error
    except TaskKilled as error:
        shown["text"] = error.why
        problem = error
    if in_json:
        click.echo(as_json(shown))
        click.get_current_context().exit(1 if problem else 0)
    if problem:
        raise problem
    click.echo(f"done: {as_text(shown['result'])}" if shown["result"] is not None else "done")


def _ask(
    client: Client,
    message: Any,
    data: tuple[str, ...],
    timeout: float | None,
    maximum: int | None,
    *,
    in_json: bool,
) -> None:
    value = _checked_data(client, message, data)
    within = QUERY_TIMEOUT if timeout is None else timeout
    show = as_json if in_json else as_text
    if isinstance(message, Query):
        try:
            reply = client.query(message, value, timeout=within)
        except Timeout as error:
            advice = "; to wait longer, give --timeout" if error.can_wait else ""
            raise ToolError(error.what + advice) from None
        click.echo(show(reply))
        return
    replies = []
    for reply in client.multi_query_send(message, value, maximum=maximum, timeout=within):
        replies.append(reply)
        if not in_json:
            click.echo(show(reply))
    if in_json:
        click.echo(show(replies))
    if not replies:
        raise ToolError(f"no module replied to {message.title}: see 'tca messages'")
