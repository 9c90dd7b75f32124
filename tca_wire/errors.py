"""Errors of the shared language, and the base of all errors that users may catch.

WireError            do not raise or catch this one; it groups the others
├── ProtocolError    the peer sent bytes that are no legal message
├── BadData          user data does not fit the format of its message
├── BadFormat        a type cannot be a message format
├── KeyRefused       a key file can't be used, or may not be
└── JournalDamaged   a journal is not one, comes from an earlier version, or is damaged before its
tail
"""

from typing import Any


class CopyableError(Exception):
    """An exception that can be copied and pickled, whatever its constructor takes."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.args), dict(self.__dict__)


def _restored(kind: type[BaseException], arguments: tuple[Any, ...]) -> BaseException:
    """The exception without its attributes. Its constructor may take others than were given to its
    base's.
    """
    error = kind.__new__(kind)
    error.args = arguments
    return error


class WireError(CopyableError):
    """Base of all errors of this package."""


class ProtocolError(WireError):
    """The peer sent bytes that are no legal message."""


class BadData(WireError):
    """Data does not fit the format declared for its message."""


class BadFormat(WireError):
    """A type that cannot be encoded, so it can't be the format of a message."""


class KeyRefused(WireError):
    """A key file that can't be used, or may not be: which one, and what to do."""


class JournalDamaged(WireError):
    """A journal cannot be read any further; all read before is good."""
