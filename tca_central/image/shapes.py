"""Shapes: how all objects of a class are taken apart into columns, and made of columns again.

A column holds one attribute of all objects of a class, so that next to all work is done by functions written in C. An
object that may change is made empty, and filled when all others are there: so circles, and what several share, come
back. A value, which never changes, is made complete, after the values that it holds.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from functools import partial
from itertools import chain, islice, repeat, starmap
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

from tca_central.errors import ImageError
from tca_central.model.stored import Stored

Columns = list[list[Any]]
Read = Callable[[list[Any]], Columns]

ITEMS = "length", "item"
"""The columns of containers: the first has a row for each, the others for each item of one after the other."""


class ObjectShape(NamedTuple):
    """The shape of a class of objects that may change."""

    name: str
    fields: tuple[str, ...]
    read: Read
    empty: Callable[[], Any]
    fill: Callable[[list[Any], Columns], None]


class ValueShape(NamedTuple):
    """The shape of a class of values that never change."""

    name: str
    fields: tuple[str, ...]
    read: Read
    make: Callable[[int, Columns], list[Any]]
    """So many values, of these columns."""


# --- objects ---------------------------------------------------------------------------------------------------------


def record(kind: type, fields: tuple[str, ...], derived: Iterable[str]) -> ObjectShape:
    """The shape of a class of central; *derived* attributes are not stored."""
    known = {*fields, *derived}
    slots = {name for parent in kind.__mro__ for name in getattr(parent, "__slots__", ())}

    def refuse_unlisted(names: Iterable[str]) -> None:
        if not known.issuperset(names):
            new = ", ".join(sorted(set(names) - known))
            raise ImageError(f"{kind.__name__} has attributes that tca_central/image/layout.py does not list: {new}")

    def read(things: list[Any]) -> Columns:
        refuse_unlisted(slots)
        if hasattr(things[0], "__dict__"):
            for thing in things:
                refuse_unlisted(vars(thing))
        return _attributes(fields, things)

    def fill(things: list[Any], columns: Columns) -> None:
        for field, values in zip(fields, columns, strict=True):
            settings = starmap(setattr, zip(things, repeat(field, len(things)), values, strict=True))
            deque(settings, maxlen=0)  # does it all

    empty = partial(kind.__new__, kind) if issubclass(kind, Stored) else kind
    return ObjectShape(kind.__name__, fields, read, empty, fill)


def listed(name: str, empty: Callable[[], Any], extend: Callable[[Any, list[Any]], None]) -> ObjectShape:
    """The shape of a class of containers that are filled with a list."""

    def fill(things: list[Any], columns: Columns) -> None:
        for thing, items in _pieces(things, *columns):
            extend(thing, items)

    return ObjectShape(name, ITEMS, _items, empty, fill)


def names() -> ObjectShape:
    """The shape of sets of strings. A set of anything else has no order that could be had again."""

    def read(things: list[Any]) -> Columns:
        if any(type(item) is not str for item in chain.from_iterable(things)):
            raise ImageError("a set in the state may hold strings only: use dict.fromkeys(), which has an order")
        return _items(list(map(sorted, things)))

    return listed("set", set, set.update)._replace(read=read)


def mapping(kind: type[dict[Any, Any]]) -> ObjectShape:
    """The shape of a class of dicts."""

    def read(things: list[Any]) -> Columns:
        return [*_items(things), list(chain.from_iterable(map(dict.values, things)))]

    def fill(things: list[Any], columns: Columns) -> None:
        lengths, keys, values = columns
        for thing, items in _pieces(things, lengths, list(zip(keys, values, strict=True))):
            thing.update(items)

    return ObjectShape(kind.__name__, ("length", "key", "value"), read, kind, fill)


# --- values ----------------------------------------------------------------------------------------------------------


def frozen(kind: type, fields: tuple[str, ...]) -> ValueShape:
    """The shape of a class of values with fields."""

    def make(count: int, columns: Columns) -> list[Any]:
        return list(starmap(kind, zip(*columns, strict=True))) if columns else [kind() for _ in range(count)]

    return ValueShape(kind.__name__, fields, partial(_attributes, fields), make)


def tuples(length: int) -> ValueShape:
    """The shape of tuples of one length."""

    def read(things: list[Any]) -> Columns:
        return [list(map(itemgetter(place), things)) for place in range(length)]

    def make(count: int, columns: Columns) -> list[Any]:
        return list(zip(*columns, strict=True)) if columns else [()] * count

    return ValueShape(f"tuple of {length}", tuple(map(str, range(length))), read, make)


def long_tuples() -> ValueShape:
    """The shape of tuples of any length."""

    def make(_: int, columns: Columns) -> list[Any]:
        lengths, items = columns
        left = iter(items)
        return [tuple(islice(left, length)) for length in lengths]

    return ValueShape("tuple", ITEMS, _items, make)


def members(kind: type[Enum]) -> ValueShape:
    """The shape of the members of an enumeration."""
    return _known(kind.__name__, attrgetter("value"), kind)


def constants(kind: type, known: dict[str, Any]) -> ValueShape:
    """The shape of a class of which there are only these."""
    words = {id(value): word for word, value in known.items()}
    return _known(kind.__name__, lambda value: words[id(value)], known.__getitem__)


def _known(name: str, word_of: Callable[[Any], str | int], value_of: Callable[[Any], Any]) -> ValueShape:
    """The shape of values that the program knows by a word."""
    return ValueShape(
        name, ("word",), lambda things: [list(map(word_of, things))], lambda _, columns: list(map(value_of, columns[0]))
    )


# --- columns ---------------------------------------------------------------------------------------------------------


def _attributes(fields: tuple[str, ...], things: list[Any]) -> Columns:
    return [list(map(attrgetter(field), things)) for field in fields]


def _items(things: list[Any]) -> Columns:
    return [list(map(len, things)), list(chain.from_iterable(things))]


def _pieces(things: list[Any], lengths: list[int], items: list[Any]) -> Iterator[tuple[Any, list[Any]]]:
    """Each container that is not empty, with its items."""
    if sum(lengths) != len(items):
        raise ValueError("containers hold more, or less, than there is")
    start = 0
    for thing, length in zip(things, lengths, strict=True):
        if length:
            yield thing, items[start : start + length]
            start += length
