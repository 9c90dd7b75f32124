"""The options that several tools share: the log, the part of it, the output file."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from inspect import cleandoc
from pathlib import Path
from typing import Any

import click

from tca_tools.journal.names import complete_modules, complete_tasks
from tca_tools.output import check_free
from tca_wire.journal.facts import LONGEST_TIME
from tca_wire.text.printable import printable


class _Time(click.ParamType):  # type: ignore[type-arg]
    """A finite time in seconds."""

    name = "seconds"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            seconds = float(value)
        except ValueError:
            seconds = math.nan
        if not abs(seconds) <= LONGEST_TIME:  # this form also rejects nan
            self.fail(f"{value!r} is not a time: give seconds, such as 12.5", param, ctx)
        return seconds


class _Measure(click.ParamType):  # type: ignore[type-arg]
    """A number with a unit: ``30d``, ``1.5G``."""

    def __init__(self, name: str, units: dict[str, int]) -> None:
        self.name, self._units = name, units

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?) ?([A-Za-z]*)", str(value))
        if number is None or number[2] not in self._units:
            self.fail(
                f"{value!r}: give a number with one of {', '.join(filter(None, self._units))}",
                param,
                ctx,
            )
        return float(number[1]) * self._units[number[2]]


TIME = _Time()
AGE = _Measure("age", {"min": 60, "h": 3600, "d": 86400, "w": 7 * 86400})
SIZE = _Measure("size", {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40})
force_option = click.option(
    "--force", is_flag=True, help="Also overwrite a file that no tca command has made."
)


_Command = Callable[..., Any]


def log_help(command: _Command) -> _Command:
    """Describe LOG in the help of a command, after the summary."""
    summary, *rest = cleandoc(command.__doc__ or "").split("\n\n")
    what = "LOG is a journal directory or one of its segments; the default is the newest run."
    command.__doc__ = "\n\n".join([summary, what, *rest])
    return command


def log_argument(command: _Command) -> _Command:
    """Add the argument LOG to a command."""
    path = click.Path(path_type=Path)
    argument = click.argument("log_path", metavar="[LOG]", required=False, type=path)
    return argument(log_help(command))


def output_option(kinds: str, *, required: bool = False) -> Callable[[_Command], _Command]:
    """Return the option for a command's output file; *kinds* is its help."""
    path = click.Path(path_type=Path, dir_okay=False)
    return click.option("-o", "--output", type=path, required=required, help=kinds)


_SHARED = (
    log_argument,
    click.option(
        "--from",
        "start",
        metavar="SECONDS",
        type=TIME,
        help="Only the part from this time on.",
    ),
    click.option(
        "--to", "end", metavar="SECONDS", type=TIME, help="Only the part up to this time."
    ),
    click.option(
        "--at", metavar="SECONDS", type=TIME, help="The state at this time, as known then."
    ),
    click.option(
        "--module",
        "modules",
        metavar="NAME",
        multiple=True,
        shell_complete=complete_modules,
        help="Only this module's (repeatable).",
    ),
    click.option(
        "--task",
        metavar="TASK",
        shell_complete=complete_tasks,
        help="Only this task and its descendants: its number, or a message's name.",
    ),
    force_option,
)


@dataclass(frozen=True, slots=True)
class Asked:
    """The values of the shared options."""

    log_path: Path | None
    start: float | None
    end: float | None
    at: float | None
    modules: tuple[str, ...]
    task: str | None
    force: bool


def shared_options(command: _Command) -> _Command:
    """Add the shared options to a command.

    The command is called with an `Asked`, and with its own options by name.
    """

    @wraps(command)
    def with_asked(**given: Any) -> Any:
        return command(Asked(**{name: given.pop(name) for name in Asked.__slots__}), **given)

    wrapped: _Command = with_asked
    for option in reversed(_SHARED):
        wrapped = option(wrapped)
    return wrapped


def check_output(output: Path | None, kinds: tuple[str, ...], *, force: bool) -> None:
    """Check the name of an output file before the work.

    Raises BadParameter if its suffix is not one of *kinds*. Raises ToolError if the file exists and
    was not made by tca, unless *force* is set.
    """
    if output is None:
        return
    if output.suffix not in kinds:
        known = " or ".join(filter(None, [", ".join(kinds[:-1]), kinds[-1]]))
        raise click.BadParameter(
            f"{printable(str(output))}: its name must end in {known}", param_hint="'-o'"
        )
    check_free(output, force=force)


def check_span(start: float | None, end: float) -> None:
    """Raise BadParameter if a span ends before it starts."""
    if start is not None and start >= end:
        raise click.BadParameter(f"{start:g} is not before the end, {end:g}", param_hint="'--from'")
