"""Errors of the tools; each is shown as one line, and its exit code is the program's."""

from collections.abc import Iterator
from contextlib import contextmanager

import click

from tca_wire.text.missing import missing_package
from tca_wire.text.printable import printable


class ToolError(click.ClickException):
    """The answer is no."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class BadUserFile(ToolError):
    """A file that a user has written can't be used: which key or line, and what to do."""

    exit_code = 2


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
def extra(name: str, what: str, otherwise: str = "", package: str = "") -> Iterator[None]:
    """A context for imports that need an extra. Raises ToolError, which says what is missing and
    what would do.
    """
    try:
        yield
    except ImportError as error:
        raise ToolError(
            missing_package(what, package or str(error.name).partition(".")[0], name, otherwise)
        ) from None
