"""Decodes bytes to central's state. Nothing in the bytes is ever run."""

import gc
from collections.abc import Callable
from typing import Any

from tca_central.core import Central
from tca_central.errors import ImageError
from tca_central.image.container import ClassTable, Column, unseal
from tca_central.image.shapes import ObjectShape, Shape, shape_named
from tca_wire.packets.large import MARK

_ADVICE = "start the version that wrote it, or continue without the image"
_CENTRAL = f"{Central.__module__}.{Central.__name__}"


def decode(data: bytes, adopt: Callable[[bytes], bytes] = bytes) -> Central:
    """Return the central of an image. *adopt* gets each large body.

    Raise ImageError, with advice, if the image is damaged or not of this version.
    """
    was_enabled = gc.isenabled()
    gc.disable()  # it would scan all new objects repeatedly, and find no garbage
    try:
        return _central_of(_with_adopted(unseal(data), adopt), len(data))
    except ImageError:
        raise
    except Exception as error:  # noqa: BLE001 - hostile bytes may cause any exception
        raise ImageError(
            f"the image was not written by a central: {type(error).__name__}: {error}"
        ) from None
    finally:
        if was_enabled:
            gc.enable()


def _with_adopted(tables: list[ClassTable], adopt: Callable[[bytes], bytes]) -> list[ClassTable]:
    """Replace the large bodies among plain values. Return the tables."""
    for table in tables:
        for column in table.columns:
            if not column.refers:
                column.values = [
                    adopt(one) if type(one) is bytes and one[:1] == MARK else one
                    for one in column.values
                ]
    return tables


def _central_of(tables: list[ClassTable], size: int) -> Central:
    """Return the central that an image's tables describe; *size* is the length of the image."""
    if sum(table.count for table in tables) > size:
        raise ValueError("it declares more objects than its bytes can hold")
    if sum(table.count for table in tables if table.name == _CENTRAL) != 1:
        raise ValueError("it does not hold exactly one central")
    (plain,) = tables[0].columns
    things: list[Any] = list(plain.values)
    objects: list[tuple[ObjectShape, ClassTable, list[Any]]] = []
    for table in tables[1:]:
        shape = _shape_of(table)
        if isinstance(shape, ObjectShape):
            made = [shape.empty() for _ in range(table.count)]
            objects.append((shape, table, made))
        else:
            made = shape.make(
                table.count, [_values(column, table.count, things) for column in table.columns]
            )
        if len(made) != table.count:
            raise ValueError(f"{table.name}: {table.count} are declared, and there are {len(made)}")
        things += made
    for shape, table, made in objects:
        shape.fill(made, [_values(column, table.count, things) for column in table.columns])
    (central,) = (one for one in things if isinstance(one, Central))
    central.connect_outputs()
    return central


def _shape_of(table: ClassTable) -> Shape:
    """Return the shape of a table's class. Raise ImageError if the table has other attributes."""
    shape, name = shape_named(table.name), table.name.rpartition(".")[2]
    if shape is None:
        raise ImageError(
            f"the image has objects of class {name}, which this version does not know: {_ADVICE}"
        )
    if tuple(table.fields) == shape.fields:
        return shape
    removed, added = set(table.fields) - set(shape.fields), set(shape.fields) - set(table.fields)
    changes = [f"{name} has no {field} any more" for field in sorted(removed)]
    changes += [f"{name} now has {field}" for field in sorted(added)]
    difference = ", ".join(changes) or f"{name} has its attributes in another order"
    raise ImageError(f"the image is of another version: {difference}: {_ADVICE}")


def _values(column: Column, count: int, things: list[Any]) -> list[Any]:
    """Return the values of a column, with things in place of their numbers."""
    values = column.values * count if column.is_common else column.values
    if not column.refers:
        return values
    if min(values, default=0) < 0:
        raise ValueError("a reference to nothing")
    return list(map(things.__getitem__, values))
