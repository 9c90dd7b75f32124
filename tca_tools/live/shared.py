"""The common parts of the commands for a running central: options, errors, values as text."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import click
import msgspec

from tca_module.client import Client, connect
from tca_module.errors import MisuseError, TcaError
from tca_tools.errors import ToolError
from tca_tools.live.completion import TASKS
from tca_wire.endpoint import VARIABLE
from tca_wire.errors import BadData, BadFormat
from tca_wire.messages.notices import COMMANDS
from tca_wire.text.bodies import in_words, json_text
from tca_wire.text.printable import printable

_PATIENCE = 2.0
"""Seconds that a command waits for central."""

central_option = click.option(
    "--central", metavar="ADDRESS", help=f"Where central listens [default: ${VARIABLE}]."
)
json_option = click.option("--json", "in_json", is_flag=True, help="Print JSON.")
seconds = click.FloatRange(min=0)
timeout_option = click.option(
    "--timeout", metavar="SECONDS", type=seconds, help="Wait no longer than this."
)
task_argument = click.argument("task", metavar="TASK", shell_complete=TASKS)


def live_command(
    name: str, *, epilog: str | None = None
) -> Callable[[Callable[..., None]], click.Command]:
    """Make a command of a function.

    The function is called with a client of a running central, and the values of its own options.
    """

    def command_of(function: Callable[..., None]) -> click.Command:
        @click.command(name, epilog=epilog)
        @central_option
        @wraps(function)
        def command(central: str | None, **given: Any) -> None:
            with talking(name, central) as client:
                function(client, **given)

        return command

    return command_of


@contextmanager
def as_usage() -> Iterator[None]:
    """A context that turns errors of the library into wrong usage (exit code 2) or ToolError."""
    try:
        yield
    except (MisuseError, BadData, BadFormat) as error:
        raise click.UsageError(in_one_line(error)) from None
    except TcaError as error:
        raise ToolError(in_one_line(error)) from None


@contextmanager
def talking(command: str, central: str | None) -> Iterator[Client]:
    """A context with a client of central for one command, with the errors of ``as_usage``."""
    name = f"{COMMANDS}{command}"
    with as_usage(), connect(name, central, patience=_PATIENCE, on_leave="keep") as client:
        yield client


def in_one_line(error: Exception) -> str:
    """Return the text of an error in one line."""
    return printable(" ".join(str(error).split()))


def plain(value: Any, *, is_shown: bool = False) -> Any:
    """Return a value in the types of JSON: bytes in base64, times as text, arrays as lists.

    Described arrays are objects; if the value *is_shown* to the user, words.
    """
    try:
        value = in_words(value) if is_shown else value
        return msgspec.to_builtins(value, str_keys=True, enc_hook=_plain_part)
    except (TypeError, ValueError, RecursionError):
        return str(value)


def _plain_part(part: Any) -> Any:
    """Convert a value that msgspec does not know: an array to a list, most others to text."""
    return int(part) if isinstance(part, int) else getattr(part, "tolist", part.__str__)()


def as_json(value: Any) -> str:
    """Return a value as indented JSON, for programs."""
    return json_text(plain(value), indent=1)


def as_text(value: Any) -> str:
    """Return a value for the user: a text unchanged, others as JSON in one line."""
    value = plain(value, is_shown=True)
    return printable(value if isinstance(value, str) else json.dumps(value, ensure_ascii=False))
