"""Errors of the tools. Each is shown as one line and has the exit code of the command."""

from collections.abc import Iterator
from contextlib import contextmanager

import click

from tca_wire.text.missing import missing_package
from tca_wire.text.printable import printable


class ToolError(click.ClickException):
    """The command can't do what it was asked for (exit code 1)."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class BadUserFile(ToolError):
    """A file of the user is wrong. The text names the key or line, and the remedy."""

    exit_code = 2


class DamagedLog(ToolError):
    """A journal is damaged. Everything before the damage was shown."""


class NoPicture(ToolError):
    """A picture can't be drawn on this machine, or is too large."""


class NotInLog(ToolError):
    """The journal has no such task or module."""


class UnusableLog(ToolError):
    """LOG is not a readable journal: wrong usage."""

    exit_code = 2


@contextmanager
def extra(name: str, what: str, otherwise: str = "", package: str = "") -> Iterator[None]:
    """A context for imports that need an extra.

    Args:
        name: the name of the extra.
        what: the command that needs it.
        otherwise: an alternative for the user; "": none.
        package: the missing package; "": the one that the import names.

    Raises:
        ToolError: an import failed; the text says what to install.
    """
    try:
        yield
    except ImportError as error:
        raise ToolError(
            missing_package(what, package or str(error.name).partition(".")[0], name, otherwise)
        ) from None
