"""Numbers that know which central gave them.

A restarted central counts from 1 again, so an old number is somebody else's task by now. Numbers
get into headers in many ways; so each carries the epoch of its central, and ``Connection`` checks
all headers that leave. A plain number is taken as one of the central that gets it.
"""

from collections.abc import Callable, Iterable
from functools import cache
from operator import attrgetter
from typing import Any, Self, TypeVar, cast, get_type_hints

import msgspec

from tca_module.errors import CentralLost
from tca_wire.constraints import Constraint
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import Point, TaskId

RESTARTED = "central was restarted and has forgotten its tree"


class EpochNumber(int):
    """A number from the central of *epoch*; *what* names its object, for people."""

    epoch: str
    what: str

    def __new__(cls, number: int, epoch: str = "", what: str = "") -> Self:
        """Copies give *number* alone, and get the rest afterwards."""
        self = super().__new__(cls, number)
        self.epoch, self.what = epoch, what
        return self


N = TypeVar("N", bound=int)


def with_epoch(number: N, epoch: str, what: str) -> N:
    """The number as that central's; unchanged if it names nothing (0), or central is never
    restarted (epoch "").
    """
    if number <= 0 or not epoch:
        return number
    named: N = cast("Any", EpochNumber(number, epoch, what))
    return named


def numbers_in(header: msgspec.Struct) -> list[EpochNumber]:
    """The numbers in a header that know their central, in the order of its fields."""
    found: list[EpochNumber] = []
    parts = _reader(header.__class__)(header)
    if any(parts):
        _collect(parts, found)
    return found


def _collect(parts: Iterable[Any], found: list[EpochNumber]) -> None:
    for part in parts:
        if isinstance(part, EpochNumber):
            found.append(part)
        elif isinstance(part, list):
            _collect(part, found)
        elif isinstance(part, msgspec.Struct):
            found += numbers_in(part)


_NUMBERS = ("origin", "delivery", "id")
_NAMING = (TaskId, Point, Point | None, list[Constraint], WatchOptions | None)
"""Names and types of the fields of headers, and of their parts, that name tasks and other things of
a central.
"""


@cache
def _reader(kind: type) -> Callable[[msgspec.Struct], tuple[Any, ...]]:
    """Reads the fields that may hold such numbers: each message passes here."""
    hints = get_type_hints(kind)
    names = [name for name, hint in hints.items() if name in _NUMBERS or hint in _NAMING]
    return (
        attrgetter(*names)
        if len(names) > 1
        else lambda part: tuple(getattr(part, name) for name in names)
    )


def first_foreign(numbers: Iterable[int], epoch: str) -> EpochNumber | None:
    """The first of some numbers that another central than that of *epoch* has given."""
    for one in numbers:
        if isinstance(one, EpochNumber) and one.epoch != epoch:
            return one
    return None


def forgotten_text(what: str) -> str:
    """The text that something was forgotten with a central, and what to do."""
    return f"{what} is lost: {RESTARTED}; send it again"


def check_epoch(numbers: Iterable[int], epoch: str) -> None:
    """Raise CentralLost if another central than that of *epoch* has given one of the numbers."""
    if (lost := first_foreign(numbers, epoch)) is not None:
        raise CentralLost(forgotten_text(lost.what))
