"""The first difference between two states of central, with the path to this difference."""

from collections import deque
from collections.abc import Iterator
from typing import Any

import msgspec

from tca_central.core import Central
from tca_central.model.clock import Clock
from tca_central.model.resources import Queue

_IGNORED = frozenset(("_outputs", "_output_queues", "_sent_by"))
"""Attributes with functions of central, or with values that are computed on demand."""
_ATOMS = (int, float, str, bytes, type(None), type)


def difference(one: Central, other: Central) -> str:
    """Return the path and values of the first difference; "" if the states are equal."""
    waiting: deque[tuple[str, Any, Any]] = deque([("central", one, other)])
    met: dict[int, int] = {}
    kept: list[Any] = []  # keeps each id() unique
    while waiting:
        way, left, right = waiting.popleft()
        if type(left) is not type(right):
            return f"{way}: {left!r:.200} and {right!r:.200}"
        if isinstance(left, _ATOMS) or callable(left):
            if left != right and not callable(left):
                return f"{way}: {left!r:.200} and {right!r:.200}"
            continue
        if not isinstance(left, tuple | msgspec.Struct):
            if (known := met.get(id(left))) is not None:
                if known != id(right):
                    return f"{way}: {left!r:.200} is shared otherwise"
                continue
            met[id(left)] = id(right)
            kept += (left, right)
        inside = list(_parts(left)), list(_parts(right))
        if [name for name, _ in inside[0]] != [name for name, _ in inside[1]]:
            return f"{way}: {[name for name, _ in inside[0]]!r:.200} and {[name for name, _ in inside[1]]!r:.200}"
        waiting.extend((f"{way}.{name}", a, b) for (name, a), (_, b) in zip(*inside, strict=True))
    return ""


def _parts(thing: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the parts of a value, each with its name or place. Void entries of heaps are left out,
    because checks of the invariants remove them.
    """
    if isinstance(thing, Clock):
        yield "now", thing.now
        yield "due", sorted(entry for entry in thing._queue if not entry[2].is_cancelled)
        return
    if isinstance(thing, Queue):
        yield "waiting", sorted(entry for entry in thing._heap if entry[3].ticket == entry[2])
        return
    if isinstance(thing, dict):
        for place, (key, value) in enumerate(thing.items()):
            yield f"key {place}", key
            yield place, value
    elif isinstance(thing, list | tuple | deque):
        yield from enumerate(thing)
    elif isinstance(thing, set | frozenset):
        yield from enumerate(sorted(thing, key=repr))
    for kind in type(thing).__mro__:
        for name in getattr(kind, "__slots__", ()):
            if hasattr(thing, name) and name not in _IGNORED:
                yield name, getattr(thing, name)
