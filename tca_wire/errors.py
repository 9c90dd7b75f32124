"""Errors of the shared language, and the base of all errors that users may catch.

::

    WireError            a group: do not raise or catch it.
    ├── ProtocolError    the peer sent bytes that are not a valid message.
    ├── BadData          user data does not fit the format of its message.
    ├── BadFormat        a type cannot be a message format.
    ├── KeyRefused       a key file is unusable or unsafe.
    └── JournalDamaged   not a journal, too old, or damaged before its end.
"""

from typing import Any


class CopyableError(Exception):
    """An exception that can be copied and pickled, whatever its constructor takes."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.args), dict(self.__dict__)


def _restored(kind: type[BaseException], arguments: tuple[Any, ...]) -> BaseException:
    """Return the exception without its attributes, and without a call of its constructor."""
    error = kind.__new__(kind)
    error.args = arguments
    return error


class WireError(CopyableError):
    """Base of all errors of this package."""


class ProtocolError(WireError):
    """The peer sent bytes that are not a valid message."""


class BadData(WireError):
    """Data does not fit the format declared for its message.

    Cause: a value has another type than the declaration, or lies outside its bounds.

    Remedy: the text names the field: give it a value of the declared type.
    """


class BadFormat(WireError):
    """A declaration is not usable, for example because its type can't be encoded.

    Cause: a name that is no name, a type that MessagePack can't hold, or parts that do not fit.

    Remedy: declare what the text asks for, such as a dataclass or a ``msgspec.Struct``.
    """


class KeyRefused(WireError):
    """A key file is unusable or unsafe. The message names it and what to do."""


class JournalDamaged(WireError):
    """A journal can't be read any further; everything read before is sound."""
