"""Shell completion of names from the journal of the newest run."""

import time
from collections.abc import Iterator

import click

from tca_tools.errors import ToolError
from tca_tools.journal.journals import open_log
from tca_tools.terminal import for_shell
from tca_wire.journal import facts
from tca_wire.messages.notices import COMMANDS

_SECONDS = 0.5
"""Seconds for which a journal is read. The names stand near its beginning."""


def complete_modules(_: click.Context, __: click.Parameter, start: str) -> list[str]:
    """Return the names of modules that begin with *start*."""
    found = (one.module for one in _facts() if isinstance(one, facts.ModuleJoined))
    return for_shell((name for name in found if not name.startswith(COMMANDS)), start)


def complete_tasks(_: click.Context, __: click.Parameter, start: str) -> list[str]:
    """Return the names of messages that become tasks and begin with *start*."""
    found = (one for one in _facts() if isinstance(one, facts.FormatDefined))
    return for_shell((one.message for one in found if one.message_class.is_task), start)


def _facts() -> Iterator[facts.Fact]:
    until = time.monotonic() + _SECONDS
    try:
        for entry in open_log(None):
            yield from entry.facts
            if time.monotonic() > until:
                return
    except ToolError:
        return
