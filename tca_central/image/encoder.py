"""Central's state to bytes.

Theory of operation. From central on all objects are met in rounds, group by group: what has been
met is taken apart into columns, and what stands in them is met next. So nothing recurses, however
deep the tree is, and the order follows from the state alone. Then each column is written as it is,
if it has plain values only, or as the numbers of what it holds.
"""

from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from itertools import accumulate, chain, count
from operator import attrgetter
from typing import Any

from tca_central.core import Central
from tca_central.errors import ImageError
from tca_central.image.container import PLAIN, ClassTable, plain_column, references, seal
from tca_central.image.shapes import Shape, ValueShape, group_key, shape_of

LONG = 200
"""Characters or bytes: longer values are written once, however many objects hold them."""

_TO_NUMBER = frozenset((int, float, str, bytes))
"""Plain values that get numbers where they stand among objects; the others have theirs."""


def may_be_taken(central: Central) -> bool:
    """Whether an image can hold the state now: not while a look for deadlocks goes on, which comes
    to its end.
    """
    return central.scan is None


def encode(central: Central) -> bytes:
    """An image of the whole state, which is not changed. Raises ImageError if an image can't hold
    it.
    """
    if not may_be_taken(central):
        raise ImageError(
            "a look for deadlocks is under way, which no image can hold: try again after another event"
        )
    encoding = _Encoding()
    encoding.meet([central])
    encoding.go_on()
    return seal(list(encoding.tables()))


class _Gathered:
    """One attribute of all objects of a group, or what containers hold; and the classes of all
    that.
    """

    __slots__ = ("kinds", "values")

    def __init__(self) -> None:
        self.values: list[Any] = []
        self.kinds: set[type] = set()

    @property
    def is_mixed(self) -> bool:
        """Whether it is written as references: it has others than plain values, or long ones."""
        if not self.kinds <= PLAIN:
            return True
        if self.kinds.isdisjoint((str, bytes)):
            return False
        sized = (
            self.values
            if self.kinds <= {str, bytes}
            else [one for one in self.values if type(one) in (str, bytes)]
        )
        return max(map(len, sized)) > LONG


class _Group:
    """Objects of one class that were met; of containers, those that hold the same."""

    def __init__(self, shape: Shape, number: int) -> None:
        self.shape, self.number = shape, number
        self.is_value = isinstance(shape, ValueShape)
        self.things: list[Any] = []
        self.taken_apart = 0  #: so many of them
        self.columns = [_Gathered() for _ in shape.fields]


class _Encoding:
    """The objects of a state. They, and what was read of them, live as long as this: so id() tells
    them apart.
    """

    def __init__(self) -> None:
        self._groups: dict[object, _Group] = {}
        self._group_of: dict[int, _Group] = {}  #: by id() of an object
        self._plain: list[Any] = [None, False, True]  #: plain values that stand among objects
        #: of all that is referred to
        self._numbers = {id(value): number for number, value in enumerate(self._plain)}

    def meet(self, values: list[Any]) -> None:
        """Note which objects are among these."""
        group_of, groups = self._group_of, self._groups
        for one in values:
            if one is not None and id(one) not in group_of and type(one) not in PLAIN:
                group_of[id(one)] = group = groups.get(group_key(one)) or self._new_group(one)
                group.things.append(one)

    def _new_group(self, one: object) -> _Group:
        shape = shape_of(one)
        if shape is None:
            kind = type(one).__qualname__
            raise ImageError(
                f"{self._way_to(one)} is a {kind}, which is no class of the state: see model/stored.py"
            )
        self._groups[group_key(one)] = group = _Group(shape, len(self._groups))
        return group

    def go_on(self) -> None:
        """Take apart what was met, until nothing new comes."""
        while waiting := [
            group for group in self._groups.values() if group.taken_apart < len(group.things)
        ]:
            for group in waiting:
                things = group.things[group.taken_apart :]
                group.taken_apart += len(things)
                for column, values in zip(group.columns, group.shape.read(things), strict=True):
                    column.values += values
                    column.kinds.update(kinds := set(map(type, values)))
                    if not kinds <= PLAIN:
                        self.meet(values)

    # --- tables -----------------------------------------------------------------------------------

    def tables(self) -> Iterator[ClassTable]:
        """All that was met: plain values that stand among objects, then objects, then values."""
        mixed = [
            column for group in self._groups.values() for column in group.columns if column.is_mixed
        ]
        self._number_plain(mixed)
        yield ClassTable("plain", ["value"], len(self._plain), [plain_column(self._plain, 0)])
        ordered = [
            group for group in self._groups.values() if not group.is_value
        ] + self._values_in_order()
        things = chain.from_iterable(group.things for group in ordered)
        self._numbers.update(zip(map(id, things), count(len(self._plain)), strict=False))
        is_mixed = set(mixed)
        for group in ordered:
            size = len(group.things)
            columns = [
                references(list(map(self._numbers.__getitem__, map(id, column.values))), size)
                if column in is_mixed
                else plain_column(column.values, size)
                for column in group.columns
            ]
            yield ClassTable(group.shape.name, list(group.shape.fields), size, columns)

    def _number_plain(self, columns: list[_Gathered]) -> None:
        """Number the plain values that stand among others; those that are equal alike."""
        numbers, known = self._numbers, dict[object, int]()
        for column in columns:
            if column.kinds.isdisjoint(_TO_NUMBER):
                continue
            for one in column.values:
                if type(one) in _TO_NUMBER and id(one) not in numbers:
                    key = type(one), repr(one) if type(one) is float else one
                    if key not in known:
                        known[key] = len(self._plain)
                        self._plain.append(one)
                    numbers[id(one)] = known[key]

    def _values_in_order(self) -> list[_Group]:
        """The groups of values, each after those of values that it holds."""
        sorter = TopologicalSorter[_Group]()
        for group in self._groups.values():
            if group.is_value:
                mixed = [column.values for column in group.columns if not column.kinds <= PLAIN]
                held = {self._group_of.get(id(one)) for one in chain.from_iterable(mixed)}
                values = [one for one in held if one is not None and one.is_value]
                sorter.add(group, *sorted(values, key=attrgetter("number")))
        try:
            return list(sorter.static_order())
        except CycleError as error:
            names = " in a ".join(group.shape.name for group in error.args[1])
            raise ImageError(
                f"no image can hold a {names}: make one of them a NamedTuple"
            ) from None

    # --- errors -----------------------------------------------------------------------------------

    def _way_to(self, one: object) -> str:
        """The attribute by which a thing was met, and the containers between:
        "Connection.outstanding value".
        """
        way: list[str] = []
        while len(way) < 9 and (holder := self._holder(one)) is not None:
            group, place, field = holder
            if "length" not in group.shape.fields:
                return " ".join([f"{group.shape.name.rpartition('.')[2]}.{field}", *way])
            way.insert(0, field)
            ends = accumulate(group.columns[0].values)
            one = next(thing for thing, end in zip(group.things, ends, strict=False) if place < end)
        return " ".join(way) or "what was to be written"

    def _holder(self, one: object) -> tuple[_Group, int, str] | None:
        for group in self._groups.values():
            for column, field in zip(group.columns, group.shape.fields, strict=True):
                place = next(
                    (place for place, value in enumerate(column.values) if value is one), None
                )
                if place is not None:
                    return group, place, field
        return None
