"""The numbers that a central gives: each knows which central that was.

Theory of operation. A central that was restarted counts from 1 again, so a number of the one before is somebody else's
task by now. Numbers get into headers in many ways: handles, points, the order among siblings, what a handler sends
under. So the number itself says whose it is (``Given``), and one place looks at each header as it leaves
(``Connection.request`` and ``post``), which is when it is known which central will get it. On the wire it is a number
like any other. A plain number (typed, or out of some data) is taken as one of the central that gets it.
"""

from collections.abc import Callable, Iterable
from functools import cache
from operator import attrgetter
from typing import Any, Self, TypeVar, get_type_hints

import msgspec

from tca_module.errors import CentralLost

RESTARTED = "central was restarted and has forgotten its tree"


class Given(int):
    """A number that a central has given: the *epoch* is its, *what* names what was numbered, for people."""

    epoch: str
    what: str

    def __new__(cls, number: int, epoch: str = "", what: str = "") -> Self:
        """The defaults are for copies, which get the rest afterwards."""
        self = super().__new__(cls, number)
        self.epoch, self.what = epoch, what
        return self


N = TypeVar("N", bound=int)


def given(number: N, epoch: str, what: str) -> N:
    """The number as that central's; as it is where it names nothing (0), or where no central is ever restarted (epoch
    "", in the explorer).
    """
    named: Any = Given(number, epoch, what)
    return named if number > 0 and epoch else number


def numbers_in(header: msgspec.Struct) -> list[Given]:
    """The numbers in a header that know their central, in the order of its fields."""
    found: list[Given] = []
    parts = _reader(header.__class__)(header)
    if any(parts):
        _collect(parts, found)
    return found


def _collect(parts: Iterable[Any], found: list[Given]) -> None:
    for part in parts:
        if isinstance(part, Given):
            found.append(part)
        elif isinstance(part, list):
            _collect(part, found)
        elif isinstance(part, msgspec.Struct):
            found += numbers_in(part)


@cache
def _reader(kind: type) -> Callable[[msgspec.Struct], tuple[Any, ...]]:
    """What reads the fields in which such numbers may be: each message passes here."""
    hints = get_type_hints(kind)
    names = [name for name, hint in hints.items() if hint not in (str, bytes, float, bool)]
    return attrgetter(*names) if len(names) > 1 else lambda part: tuple(getattr(part, name) for name in names)


def foreign(numbers: Iterable[int], epoch: str) -> Given | None:
    """The first of some numbers that another central than that of *epoch* has given."""
    for one in numbers:
        if isinstance(one, Given) and one.epoch != epoch:
            return one
    return None


def gone(what: str) -> str:
    """That what a central had given a number is forgotten with it, and what to do."""
    return f"{what} is lost: {RESTARTED}; whoever wants it sends it again"


def check_epoch(numbers: Iterable[int], epoch: str) -> None:
    """Raise CentralLost if one of them means nothing to the central of *epoch*, which has not given it."""
    if (lost := foreign(numbers, epoch)) is not None:
        raise CentralLost(gone(lost.what))
