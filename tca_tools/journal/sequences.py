"""The sequences of a record: how they grow, and which of their spans are active at a time. Pure."""

from bisect import bisect_right
from collections.abc import Sequence
from math import inf
from operator import attrgetter
from typing import Any, TypeVar

NONE: Any = ()
SHORT = 8
"""Up to this length a sequence is a tuple, which takes less memory than a list."""
_NEWEST = 32
"""The number of spans that ``newest_active`` checks."""
_START = attrgetter("start")


class Span:
    """Something with a start, and an end once it is over."""

    __slots__ = ()
    start: float
    end: float | None

    @property
    def until(self) -> float:
        """When it ended; inf if it has not."""
        return inf if self.end is None else self.end

    def is_active(self, time: float) -> bool:
        """Whether it had started, and not ended, at a time."""
        return self.start <= time and (self.end is None or self.end > time)


_Span = TypeVar("_Span", bound=Span)
_T = TypeVar("_T")


def appended(items: Sequence[_T], item: _T) -> Sequence[_T]:
    """Return the items with one more: a new tuple while they are few, else the extended list."""
    if len(items) < SHORT:
        return (*items, item)
    items = items if isinstance(items, list) else [*items]
    items.append(item)
    return items


def active_at(spans: Sequence[_Span], time: float) -> _Span | None:
    """Return the span that was active at a time, of spans that do not overlap."""
    begun = bisect_right(spans, time, key=_START) if spans else 0
    return spans[begun - 1] if begun and spans[begun - 1].is_active(time) else None


def newest_active(spans: Sequence[_Span], time: float) -> list[_Span]:
    """Return the spans that were active at a time. Only the ``_NEWEST`` newest are checked."""
    begun = bisect_right(spans, time, key=_START) if spans else 0
    newest = spans[max(begun - _NEWEST, 0) : begun]
    return [span for span in newest if span.end is None or span.end > time]
