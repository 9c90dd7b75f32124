"""Records with overwritten fields, whose value at any instant is found in O(log n). Pure."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import inf
from operator import itemgetter
from typing import TYPE_CHECKING, Any

Changes = Sequence[tuple[float, str, Any]] | dict[str, list[tuple[float, Any]]]
"""Old values with the times of overwriting: in one tuple while they are few, else by field, so that
a lookup is O(log n).
"""
_FEW = 8
_TIME = itemgetter(0)


class Overwritten:
    """A record that retains the old values of its fields."""

    __slots__ = ()
    if TYPE_CHECKING:
        changes: Changes
        received: float

    def overwrite(self, name: str, value: Any, time: float) -> None:
        """Overwrite a field, and retain the old value and the time."""
        old = getattr(self, name)
        setattr(self, name, value)
        if not isinstance(self.changes, dict):
            if len(self.changes) < _FEW:
                # A subclass has the slot
                self.changes = (*self.changes, (time, name, old))  # type: ignore[misc]
                return
            by_field = {field: self.old_values(field) for _, field, _ in self.changes}
            self.changes = by_field  # type: ignore[misc]
        self.changes.setdefault(name, []).append((time, old))

    def old_values(self, name: str) -> list[tuple[float, Any]]:
        """Return the old values of a field with the times of overwriting, oldest first."""
        if isinstance(self.changes, dict):
            return self.changes.get(name, [])
        return [(time, old) for time, field_name, old in self.changes if field_name == name]

    def value_at(self, name: str, instant: float) -> Any:
        """Return the value of a field at an instant."""
        old = self.old_values(name) if self.changes else ()
        place = bisect_right(old, instant, key=_TIME)
        return old[place][1] if place < len(old) else getattr(self, name)

    def written_at(self, name: str, instant: float = inf) -> float:
        """Return when a field got the value that it had at an instant.

        That is when the old value was overwritten, or else when the record was received.
        """
        old = self.old_values(name) if self.changes else ()
        place = bisect_right(old, instant, key=_TIME)
        return old[place - 1][0] if place else self.received

    def new_values(self, name: str) -> list[tuple[float, Any]]:
        """Return the new values of a field with the times of overwriting, oldest first."""
        values = [*self.old_values(name), (0.0, getattr(self, name))]
        return [(time, new) for (time, _), (_, new) in pairwise(values)]
