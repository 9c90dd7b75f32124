"""Numbers that are names. Central copies and counts them like any number, and they can still be
told from counts.

They differ from run to run, so scripts must not see them, or they would be other scripts in each
run: in headers, answers and contexts they are replaced by the script's own names, and central's
texts do not have them.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Self

import msgspec

_are_shown = ContextVar("_are_shown", default=False)


@contextmanager
def numbers_shown() -> Iterator[None]:
    """Texts that are made meanwhile have these numbers: they are for people."""
    token = _are_shown.set(True)
    try:
        yield
    finally:
        _are_shown.reset(token)


class Identifier(int):
    """A number that only names something: what matters is which are equal, not what they are."""

    __slots__ = ()

    def __add__(self, other: int) -> Self:
        return type(self)(int(self) + other)

    def __str__(self) -> str:
        return repr(self) if _are_shown.get() else "…"


class MessageId(Identifier):
    """Names a message or delivery in central."""

    __slots__ = ()


class RequestNumber(Identifier):
    """Names a request of a connection."""

    __slots__ = ()


Rename = Callable[[int], int]

_NAMING = frozenset(("task", "parent", "monitor", "id"))
"""The fields of headers and their parts that name a task, an exception handler or a wiretap."""

_PLAIN = (str, bytes, float, bool)


def renamed(value: Any, rename: Rename) -> Any:
    """A header or part of one, with other ids; ids that are 0 or -1 name no task but the root, and
    the new one.
    """
    if type(value) is list:
        return [renamed(one, rename) for one in value]
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
    """Central's rows on a task's relatives, with renamed tasks."""
    rows = msgspec.msgpack.decode(body)
    for row in rows:
        row["task"], row["parent"] = rename(row["task"]), rename(row["parent"])
    return msgspec.msgpack.encode(rows)
