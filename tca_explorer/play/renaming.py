"""Central's ids in headers, answers and contexts, replaced by a script's own names for them, or the other way round."""

from collections.abc import Callable
from typing import Any

import msgspec

Rename = Callable[[int], int]

_NAMING = frozenset(("task", "parent", "monitor", "id"))
"""The fields of headers and their parts that name a task, an exception handler or a wiretap."""

_PLAIN = (str, bytes, float, bool)


def renamed(value: Any, rename: Rename) -> Any:
    """A header or part of one, with other ids; ids that are 0 or -1 name no task but the root, and the new one."""
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
    """The same of what central tells of a task's relatives."""
    rows = msgspec.msgpack.decode(body)
    for row in rows:
        row["task"], row["parent"] = rename(row["task"]), rename(row["parent"])
    return msgspec.msgpack.encode(rows)
