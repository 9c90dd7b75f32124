"""Shapes: how the objects of a class are read into columns, and made from columns again.

A column holds one attribute of all objects of a class, so that functions written in C do almost all
the work. An *object* is mutable: it is made empty, and filled when all others exist. This restores
cycles and shared objects. A *value* never changes: it is made complete, after the values that it
contains.

An object has the attributes in its class's ``__slots__``, a value its declared fields. An image
names classes of this program. The decoder looks these names up among the classes that are loaded
already. It imports nothing, and runs nothing that the bytes contain.
"""

import sys
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from enum import Enum
from functools import cache, partial
from itertools import chain, islice, repeat, starmap
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

import msgspec

from tca_central.core import Central
from tca_central.errors import ImageError
from tca_central.model.stored import Stored

Columns = list[list[Any]]
Read = Callable[[list[Any]], Columns]

NOT_STORED = {"__dict__", "_output_queues", "_outputs", "is_task"}
"""Attributes that no image contains.

``Central.connect_outputs`` recreates the outputs. The others belong to the class: compiled classes
list ``is_task`` as an attribute, too, and compiled generic classes have an empty ``__dict__``.
"""

LONGEST_RECORD = 8
"""The longest tuple that is written with one column per item. Longer ones are like lists."""

_OURS = ("tca_central.", "tca_wire.")
_ITEMS = "length", "item"
"""The columns of containers: one row per container in the first, one per item in the second."""


class ObjectShape(NamedTuple):
    """The shape of a class of mutable objects."""

    name: str
    fields: tuple[str, ...]
    read: Read
    empty: Callable[[], Any]
    fill: Callable[[list[Any], Columns], None]


class ValueShape(NamedTuple):
    """The shape of a class of values, which never change."""

    name: str
    fields: tuple[str, ...]
    read: Read
    make: Callable[[int, Columns], list[Any]]
    """Makes a number of values from columns."""


Shape = ObjectShape | ValueShape


# --- finding shapes -------------------------------------------------------------------------------


def shape_of(thing: Any) -> Shape | None:
    """Return the shape of a thing; None if no image can hold it."""
    kind: Any = type(thing)
    if kind is tuple and len(thing) <= LONGEST_RECORD:
        return _of_tuples(len(thing))
    if kind is deque and thing.maxlen is not None:
        return None
    return (
        _CONTAINERS.get(kind.__name__)
        if kind.__module__ in ("builtins", "collections")
        else _shape_of_class(kind)
    )


def shape_named(name: str) -> Shape | None:
    """Return the shape of the class that an image names; None if this version has no such class."""
    if name in _CONTAINERS:
        return _CONTAINERS[name]
    module, _, word = name.rpartition(".")
    kind = getattr(sys.modules.get(module), word, None) if module.startswith(_OURS) else None
    shape = _shape_of_class(kind) if isinstance(kind, type) else None
    # The names differ if the module has only imported the class.
    return shape if shape is not None and shape.name == name else None


def group_key(thing: Any) -> object:
    """Return a thing's key. Things with the same key are written in one table.

    The key of a container includes the class of its first item, so that most columns hold one
    class. The key of a short tuple includes the classes of all items.
    """
    kind = type(thing)
    if kind is tuple:
        return tuple(map(type, thing)) if len(thing) <= LONGEST_RECORD else tuple
    if kind is dict:
        return next(((dict, type(key), type(value)) for key, value in thing.items()), dict)
    if kind is list:
        return (list, type(thing[0])) if thing else list
    return kind


@cache
def _shape_of_class(kind: Any) -> Shape | None:
    """Return the shape of a class of the state; None for other classes."""
    name = f"{kind.__module__}.{kind.__name__}"
    if not name.startswith(_OURS):
        return None
    if issubclass(kind, (Stored, Central)):
        return _of_objects(name, kind)
    if issubclass(kind, Enum):
        return ValueShape(name, ("word",), _words, lambda _, columns: list(map(kind, *columns)))
    if issubclass(kind, msgspec.Struct):
        return _of_values(name, kind, kind.__struct_fields__)
    return _of_values(name, kind, kind._fields) if issubclass(kind, tuple) else None


# --- objects --------------------------------------------------------------------------------------


def attributes_of(kind: type) -> tuple[str, ...]:
    """Return the attributes of a class of the state. Compiled classes list them differently."""
    listed = getattr(kind, "__mypyc_attrs__", None)
    if listed is None:
        listed = chain.from_iterable(getattr(parent, "__slots__", ()) for parent in kind.__mro__)
    return tuple(sorted({*listed} - NOT_STORED))


def _of_objects(name: str, kind: type) -> ObjectShape:
    """Return the shape of a mutable class of central."""
    if kind.__dictoffset__ and not hasattr(kind, "__mypyc_attrs__"):
        raise ImageError(
            f"{kind.__name__} has attributes outside its __slots__: an image would lose them"
        )
    fields = attributes_of(kind)

    def fill(things: list[Any], columns: Columns) -> None:
        for field, values in zip(fields, columns, strict=True):
            settings = starmap(
                setattr, zip(things, repeat(field, len(things)), values, strict=True)
            )
            deque(settings, maxlen=0)  # runs the iterator in C

    empty = partial(kind.__new__, kind) if issubclass(kind, Stored) else kind
    return ObjectShape(name, fields, partial(_attributes, fields), empty, fill)


def _of_lists(kind: type, extend: Callable[[Any, list[Any]], None]) -> ObjectShape:
    """Return the shape of a class of containers that *extend* fills."""

    def fill(things: list[Any], columns: Columns) -> None:
        for thing, items in _pieces(things, *columns):
            extend(thing, items)

    return ObjectShape(kind.__name__, _ITEMS, _items, kind, fill)


def _of_dicts(kind: type[dict[Any, Any]]) -> ObjectShape:
    """Return the shape of a class of dicts."""

    def read(things: list[Any]) -> Columns:
        return [*_items(things), list(chain.from_iterable(map(dict.values, things)))]

    def fill(things: list[Any], columns: Columns) -> None:
        lengths, keys, values = columns
        for thing, items in _pieces(things, lengths, list(zip(keys, values, strict=True))):
            thing.update(items)

    return ObjectShape(kind.__name__, ("length", "key", "value"), read, kind, fill)


# --- values ---------------------------------------------------------------------------------------


def _of_values(name: str, kind: type, fields: tuple[str, ...]) -> ValueShape:
    """Return the shape of a class of values with fields."""

    def make(count: int, columns: Columns) -> list[Any]:
        return (
            list(starmap(kind, zip(*columns, strict=True)))
            if columns
            else [kind() for _ in range(count)]
        )

    return ValueShape(name, fields, partial(_attributes, fields), make)


@cache
def _of_tuples(length: int) -> ValueShape:
    """Return the shape of tuples of one length."""

    def read(things: list[Any]) -> Columns:
        return [list(map(itemgetter(place), things)) for place in range(length)]

    def make(count: int, columns: Columns) -> list[Any]:
        return list(zip(*columns, strict=True)) if columns else [()] * count

    return ValueShape(f"tuple of {length}", tuple(map(str, range(length))), read, make)


def _long_tuples(_: int, columns: Columns) -> list[Any]:
    """Return tuples of different lengths."""
    lengths, items = columns
    left = iter(items)
    return [tuple(islice(left, length)) for length in lengths]


# --- columns --------------------------------------------------------------------------------------


def _attributes(fields: tuple[str, ...], things: list[Any]) -> Columns:
    """Return one column per field."""
    return [list(map(attrgetter(field), things)) for field in fields]


def _words(members: list[Any]) -> Columns:
    """Return the column of an enum's members, as the words for them."""
    return [[member.value for member in members]]


def _items(things: list[Any]) -> Columns:
    """Return the columns of containers: their lengths, and all their items."""
    return [list(map(len, things)), list(chain.from_iterable(things))]


def _pieces(
    things: list[Any], lengths: list[int], items: list[Any]
) -> Iterator[tuple[Any, list[Any]]]:
    """Yield each container that is not empty, with its items."""
    if sum(lengths) != len(items):
        raise ValueError("the containers' lengths do not match their items")
    start = 0
    for thing, length in zip(things, lengths, strict=True):
        if length:
            yield thing, items[start : start + length]
            start += length


_CONTAINERS: dict[str, Shape] = {
    "list": _of_lists(list, list.extend),
    "deque": _of_lists(deque, deque.extend),
    "dict": _of_dicts(dict),
    "OrderedDict": _of_dicts(OrderedDict),
    "tuple": ValueShape("tuple", _ITEMS, _items, _long_tuples),
    **{shape.name: shape for shape in map(_of_tuples, range(LONGEST_RECORD + 1))},
}
