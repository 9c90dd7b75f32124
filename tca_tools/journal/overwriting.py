"""Fields of a record that are written over: what each was at a moment stays known, in O(log) of its
changes. Pure.
"""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import inf
from operator import itemgetter
from typing import TYPE_CHECKING, Any

Changes = Sequence[tuple[float, str, Any]] | dict[str, list[tuple[float, Any]]]
"""Old values, each with when it was written over: a few with the names of their fields, many by
field.
"""
_FEW = 8
_TIME = itemgetter(0)


class Overwritten:
    """A record that remembers its changes."""

    __slots__ = ()
    if TYPE_CHECKING:
        changes: Changes
        received: float

    def overwrite(self, name: str, value: Any, time: float) -> None:
        """Write a new value over a field, and remember from when on it is so."""
        old = getattr(self, name)
        setattr(self, name, value)
        if not isinstance(self.changes, dict):
            if len(self.changes) < _FEW:
                self.changes = (*self.changes, (time, name, old))  # type: ignore[misc]  # its class has the slot
                return
            by_field = {field: self.overwritten(field) for _, field, _ in self.changes}
            self.changes = by_field  # type: ignore[misc]
        self.changes.setdefault(name, []).append((time, old))

    def overwritten(self, name: str) -> list[tuple[float, Any]]:
        """The old values of one of its fields, oldest first, and when each was written over."""
        if isinstance(self.changes, dict):
            return self.changes.get(name, [])
        return [(time, old) for time, field_name, old in self.changes if field_name == name]

    def was(self, name: str, moment: float) -> Any:
        """The value of one of its fields at a moment."""
        old = self.overwritten(name) if self.changes else ()
        place = bisect_right(old, moment, key=_TIME)
        return old[place][1] if place < len(old) else getattr(self, name)

    def written(self, name: str, moment: float = inf) -> float:
        """When one of its fields was last written over, until a moment; else when it was sent."""
        old = self.overwritten(name) if self.changes else ()
        place = bisect_right(old, moment, key=_TIME)
        return old[place - 1][0] if place else self.received

    def became(self, name: str) -> list[tuple[float, Any]]:
        """The values written over one of its fields, and when, oldest first."""
        return [
            (time, new)
            for (time, _), (_, new) in pairwise(
                [*self.overwritten(name), (0.0, getattr(self, name))]
            )
        ]
