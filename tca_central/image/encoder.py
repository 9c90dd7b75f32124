"""Encodes central's state as bytes.

The encoder works in rounds, and starts with central. Each round reads the attributes of new objects
into columns, group by group. Objects that appear in these columns for the first time are the new
objects of the next round. Nothing recurses, however deep the tree is. The order depends on the
state alone. A *mixed* column has objects or long values, and is written as numbers of things
(container.py). Other columns are written as they are.
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
from tca_wire.packets.large import LargeBody

LONG = 200
"""Values of more characters or bytes are written once, however many objects share them."""

_TO_NUMBER = frozenset((int, float, str, bytes))
"""Plain values that get numbers in mixed columns; None, False and True have fixed numbers."""


def can_encode(central: Central) -> bool:
    """Whether an image can hold the state now: not while a search for deadlocks is suspended."""
    return central.scan is None


def encode(central: Central) -> bytes:
    """Return an image of the whole state. The state stays unchanged.

    Raise ImageError if an image can't hold the state.
    """
    if not can_encode(central):
        raise ImageError(
            "a search for deadlocks is under way, which no image can hold: try again later"
        )
    encoding = _Encoding()
    encoding.discover([central])
    encoding.expand()
    return seal(list(encoding.tables()))


def _as_plain(values: list[Any]) -> list[Any]:
    """Return values with plain bytes in place of large bodies."""
    if not any(issubclass(kind, LargeBody) for kind in set(map(type, values))):
        return values
    return [bytes(one) if isinstance(one, LargeBody) else one for one in values]


class _Gathered:
    """The values of one column, and their classes."""

    __slots__ = ("kinds", "values")

    def __init__(self) -> None:
        self.values: list[Any] = []
        self.kinds: set[type] = set()

    @property
    def is_mixed(self) -> bool:
        """Whether it has objects or long values, so that it is written as references."""
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
    """Objects of one class or, for containers, those with contents of one class."""

    def __init__(self, shape: Shape, number: int) -> None:
        self.shape, self.number = shape, number
        self.is_value = isinstance(shape, ValueShape)
        self.things: list[Any] = []
        self.expanded = 0  #: number of things whose attributes are in the columns
        self.columns = [_Gathered() for _ in shape.fields]


class _Encoding:
    """The objects of a state, on the way to tables.

    The encoding keeps all objects and their attributes alive, so that id() identifies them.
    """

    def __init__(self) -> None:
        self._groups: dict[object, _Group] = {}
        self._group_of: dict[int, _Group] = {}  #: by id() of an object
        self._plain: list[Any] = [None, False, True]  #: plain values in mixed columns
        #: By id() of a thing.
        self._numbers = {id(value): number for number, value in enumerate(self._plain)}

    def discover(self, values: list[Any]) -> None:
        """Add the new objects among these values to their groups."""
        group_of, groups = self._group_of, self._groups
        for thing in values:
            if thing is not None and id(thing) not in group_of and type(thing) not in PLAIN:
                group_of[id(thing)] = group = groups.get(group_key(thing)) or self._new_group(thing)
                group.things.append(thing)

    def _new_group(self, thing: object) -> _Group:
        """Return a new group for things like *thing*. Raise ImageError if no image can hold it."""
        shape = shape_of(thing)
        if shape is None:
            kind = type(thing).__qualname__
            raise ImageError(
                f"{self._path_to(thing)} is a {kind}, no class of the state: see model/stored.py"
            )
        self._groups[group_key(thing)] = group = _Group(shape, len(self._groups))
        return group

    def expand(self) -> None:
        """Expand the objects until there are no new ones."""
        while waiting := [
            group for group in self._groups.values() if group.expanded < len(group.things)
        ]:
            for group in waiting:
                things = group.things[group.expanded :]
                group.expanded += len(things)
                for column, read in zip(group.columns, group.shape.read(things), strict=True):
                    values = _as_plain(read)
                    column.values += values
                    column.kinds.update(kinds := set(map(type, values)))
                    if not kinds <= PLAIN:
                        self.discover(values)

    # --- tables -----------------------------------------------------------------------------------

    def tables(self) -> Iterator[ClassTable]:
        """Yield the tables: plain values in mixed columns, then objects, then values."""
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
        """Number the plain values in mixed columns; equal values share a number."""
        numbers, known = self._numbers, dict[object, int]()
        for column in columns:
            if column.kinds.isdisjoint(_TO_NUMBER):
                continue
            for value in column.values:
                if type(value) in _TO_NUMBER and id(value) not in numbers:
                    key = type(value), repr(value) if type(value) is float else value
                    if key not in known:
                        known[key] = len(self._plain)
                        self._plain.append(value)
                    numbers[id(value)] = known[key]

    def _values_in_order(self) -> list[_Group]:
        """Return the groups of values, each after the groups of values that it contains."""
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

    def _path_to(self, one: object) -> str:
        """Return the path to a thing, for errors: an attribute, and fields of containers in it.

        For example "Connection.outstanding value".
        """
        path: list[str] = []
        while len(path) < 9 and (holder := self._holder(one)) is not None:
            group, row, field = holder
            if "length" not in group.shape.fields:
                return " ".join([f"{group.shape.name.rpartition('.')[2]}.{field}", *path])
            path.insert(0, field)
            ends = accumulate(group.columns[0].values)
            one = next(thing for thing, end in zip(group.things, ends, strict=False) if row < end)
        return " ".join(path) or "the state"

    def _holder(self, one: object) -> tuple[_Group, int, str] | None:
        """Return the group, row and field of the first column that has a thing, or None."""
        for group in self._groups.values():
            for column, field in zip(group.columns, group.shape.fields, strict=True):
                for row, value in enumerate(column.values):
                    if value is one:
                        return group, row, field
        return None
