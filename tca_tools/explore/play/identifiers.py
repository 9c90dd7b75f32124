"""Numbers that only identify something, as ``int`` subclasses.

Central copies these numbers and adds to them like any number. Their types still show that they are
not counts.

The numbers differ from run to run. A script that saw them could act differently in each run, so
headers, answers and contexts contain the script's own names instead. Central's texts contain "…" in
place of a number.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Self

import msgspec

_are_shown = ContextVar("_are_shown", default=False)


@contextmanager
def numbers_shown() -> Iterator[None]:
    """Show the numbers in texts that are created in the ``with`` block, for users to read."""
    token = _are_shown.set(True)
    try:
        yield
    finally:
        _are_shown.reset(token)


class Identifier(int):
    """A number that only identifies something: its value has no meaning."""

    __slots__ = ()

    def __add__(self, other: int) -> Self:
        return type(self)(int(self) + other)

    def __str__(self) -> str:
        return repr(self) if _are_shown.get() else "…"


class MessageId(Identifier):
    """Identifies a message or delivery in central."""

    __slots__ = ()


class RequestNumber(Identifier):
    """Identifies a request of a connection."""

    __slots__ = ()


Rename = Callable[[int], int]

_NAMING = frozenset(("task", "parent", "monitor", "id"))
"""The fields of headers, and of parts of headers, that may hold an id to rename."""

_PLAIN = (str, bytes, float, bool)


def renamed(value: Any, rename: Rename) -> Any:
    """Return a header, or a part of one, with each id replaced by the result of *rename*.

    *rename* is not called for 0, the root. It is called for -1, the task that is being sent.
    """
    if type(value) is list:
        return [renamed(item, rename) for item in value]
    if not isinstance(value, msgspec.Struct):
        return value
    changes = {}
    for name in value.__struct_fields__:
        old = getattr(value, name)
        if not old or type(old) in _PLAIN:
            continue
        new = rename(old) if name in _NAMING and isinstance(old, int) else renamed(old, rename)
        if new is not old:
            changes[name] = new
    return msgspec.structs.replace(value, **changes) if changes else value


def renamed_rows(body: bytes, rename: Rename) -> bytes:
    """Return central's rows about relatives of a task, with the result of *rename* for each id."""
    rows = msgspec.msgpack.decode(body)
    for row in rows:
        row["task"], row["parent"] = rename(row["task"]), rename(row["parent"])
    return msgspec.msgpack.encode(rows)
