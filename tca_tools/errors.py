"""Errors of the tools; each is shown as one line, and its exit code is the program's."""

from collections.abc import Iterator
from contextlib import contextmanager

import click


class ToolError(click.ClickException):
    """The answer is no."""

    exit_code = 1


class DamagedLog(ToolError):
    """A journal can't be read to its end; what comes before the damage was shown."""


class NoPicture(ToolError):
    """A picture can't be drawn here."""


class NotInLog(ToolError):
    """The journal has no such task or module."""


class UnusableLog(ToolError):
    """LOG is no journal that can be read at all: wrong usage."""

    exit_code = 2


@contextmanager
def raised_as(kind: type[Exception]) -> Iterator[None]:
    """For libraries that use a tool: its errors, as errors of their own."""
    try:
        yield
    except ToolError as error:
        raise kind(error.message) from None
