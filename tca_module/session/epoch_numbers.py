"""Numbers that know which central assigned them.

A restarted central counts from 1 again, so an old number may belong to another task by now. Each
number therefore carries the epoch of its central, and ``Connection`` checks all headers that leave.
A plain number without an epoch counts as a number of the central that receives it.
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
    """A number from the central of *epoch*. *what* names the numbered object, for people."""

    epoch: str
    what: str

    def __new__(cls, number: int, epoch: str = "", what: str = "") -> Self:
        """Create the number. Copying passes *number* alone and sets the rest afterwards."""
        self = super().__new__(cls, number)
        self.epoch, self.what = epoch, what
        return self


N = TypeVar("N", bound=int)


def with_epoch(number: N, epoch: str, what: str) -> N:
    """Return the number, marked as a number of the central of *epoch*.

    A number of 0 or less stays plain, because it names nothing of central. All numbers stay plain
    if *epoch* is "".
    """
    if number <= 0 or not epoch:
        return number
    named: N = cast("Any", EpochNumber(number, epoch, what))
    return named


def numbers_in(header: msgspec.Struct) -> list[EpochNumber]:
    """Return the numbers in a header that know their central, in the order of its fields."""
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


_NUMBER_FIELDS = ("origin", "delivery", "id")
_NUMBER_TYPES = (TaskId, Point, Point | None, list[Constraint], WatchOptions | None)
"""The names, and the types, of header fields that hold numbers of tasks and other objects."""


@cache
def _reader(kind: type) -> Callable[[msgspec.Struct], tuple[Any, ...]]:
    """Return a reader of the header fields that may hold an EpochNumber; cached for speed."""
    hints = get_type_hints(kind)
    fields = hints.items()
    names = [name for name, hint in fields if name in _NUMBER_FIELDS or hint in _NUMBER_TYPES]
    if len(names) > 1:
        return attrgetter(*names)  # for a single name it returns no tuple
    return lambda part: tuple(getattr(part, name) for name in names)


def first_foreign(numbers: Iterable[int], epoch: str) -> EpochNumber | None:
    """Return the first number that a central of another epoch has assigned; None without any."""
    for one in numbers:
        if isinstance(one, EpochNumber) and one.epoch != epoch:
            return one
    return None


def forgotten_text(what: str) -> str:
    """Return the text that an object was forgotten with a central, and the remedy."""
    return f"{what} is lost: {RESTARTED}; send it again"


def check_epoch(numbers: Iterable[int], epoch: str) -> None:
    """Raise CentralLost if a central of another epoch has assigned one of the numbers."""
    if (lost := first_foreign(numbers, epoch)) is not None:
        raise CentralLost(forgotten_text(lost.what))
