"""Bytes to central's state: classes are those of the layout, and nothing in the bytes is ever run."""

import gc
from typing import Any

import msgspec

from tca_central.core import Central
from tca_central.errors import ImageError
from tca_central.image.container import ClassTable, Column, unseal
from tca_central.image.layout import OBJECT_SHAPES, VALUE_SHAPES
from tca_central.image.shapes import ObjectShape, ValueShape

_OBJECTS: dict[str, ObjectShape] = {shape.name: shape for shape in OBJECT_SHAPES.values()}
_VALUES: dict[str, ValueShape] = {shape.name: shape for shape in VALUE_SHAPES.values()}

_ADVICE = "start the version that made it, or go on without the image"
_WRONG = (
    msgspec.MsgspecError, AttributeError, LookupError, MemoryError, OverflowError, RecursionError, StopIteration,
    TypeError, ValueError,
)  # fmt: skip
"""What bytes bring about that no central wrote."""


def decode(data: bytes) -> Central:
    """The central that an image shows. Raises ImageError, with what to do, if it is damaged, or not of this version."""
    is_on = gc.isenabled()
    gc.disable()  # it would look through all again and again, and find nothing
    try:
        return _central_of(unseal(data), len(data))
    except _WRONG as error:
        raise ImageError(f"the image was not written by a central: {type(error).__name__}: {error}") from None
    finally:
        if is_on:
            gc.enable()


def _central_of(tables: list[ClassTable], size: int) -> Central:
    if sum(table.count for table in tables) > size:
        raise ValueError("it tells of more objects than its bytes can name")
    if sum(table.count for table in tables if table.name == Central.__name__) != 1:
        raise ValueError("it is not of one central")
    (plain,), *tables = tables[0].columns, *tables[1:]
    things: list[Any] = list(plain.values)
    objects: list[tuple[ObjectShape, ClassTable, list[Any]]] = []
    for table in tables:
        if (kind := _OBJECTS.get(table.name)) is not None:
            _check_fields(table, kind)
            made = [kind.empty() for _ in range(table.count)]
            objects.append((kind, table, made))
        elif (value_kind := _VALUES.get(table.name)) is not None:
            _check_fields(table, value_kind)
            made = value_kind.make(table.count, [_values(column, table.count, things) for column in table.columns])
        else:
            raise ImageError(
                f"the image has objects of class {table.name}, which this version does not know: {_ADVICE}"
            )
        if len(made) != table.count:
            raise ValueError(f"{table.name}: {table.count} were told, and there are {len(made)}")
        things += made
    for kind, table, made in objects:
        kind.fill(made, [_values(column, table.count, things) for column in table.columns])
    (central,) = next(made for _, table, made in objects if table.name == Central.__name__)
    assert isinstance(central, Central)
    central.connect_outputs()
    return central


def _check_fields(table: ClassTable, shape: ObjectShape | ValueShape) -> None:
    """Raises ImageError if a class has other attributes than it had when the image was made."""
    if tuple(table.fields) == shape.fields:
        return
    gone, new = set(table.fields) - set(shape.fields), set(shape.fields) - set(table.fields)
    changes = [f"{table.name} has no {name} any more" for name in sorted(gone)]
    changes += [f"{table.name} now has {name}" for name in sorted(new)]
    what = ", ".join(changes) or f"{table.name} has its attributes in another order"
    raise ImageError(f"the image is of another version: {what}: {_ADVICE}")


def _values(column: Column, count: int, things: list[Any]) -> list[Any]:
    values = column.values * count if column.is_common else column.values
    if not column.refers:
        return values
    if min(values, default=0) < 0:
        raise ValueError("a reference to nothing")
    return list(map(things.__getitem__, values))
