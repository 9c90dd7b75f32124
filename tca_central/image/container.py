"""The container of an image: a title line, the length and checksum of the content, and its tables.

    tca image 2 of 0.1.0
    length u64, CRC-32 u32, then a MessagePack list of tables, one per class

A *thing* is a plain value in a mixed column (encoder.py), an object, or a value (shapes.py). Things
are numbered in this order. A value comes after the values that it contains. A column of references
holds numbers of things.
"""

import struct
import zlib
from typing import Annotated, Any

import msgspec

from tca_central.errors import ImageError
from tca_wire.release import release

FORMAT = 2
"""The version of the container. The image itself lists the attributes of its classes."""

_WORDS = b"tca image "
_CHECK = struct.Struct(">QI")
_LONG = 1
"""The MessagePack extension type of integers beyond 64 bits."""
_SMALLEST, _LARGEST = -(1 << 63), (1 << 64) - 1

PLAIN = frozenset((type(None), bool, int, float, str, bytes))


class Column(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    """One attribute of all objects of a class, or the contents of all containers of a class."""

    values: list[Any]
    refers: bool = False
    """Whether the values are numbers of things."""
    is_common: bool = False
    """Whether all objects of the table have the same value, which is then written once."""


class ClassTable(msgspec.Struct, array_like=True, forbid_unknown_fields=True):
    """All objects of a class."""

    name: str
    fields: list[str]
    count: Annotated[int, msgspec.Meta(ge=0)]
    columns: list[Column]


def seal(tables: list[ClassTable]) -> bytes:
    """Return an image with these tables."""
    content = msgspec.msgpack.encode(tables)
    title = b"%s%d of %s\n" % (_WORDS, FORMAT, release().encode())
    return title + _CHECK.pack(len(content), zlib.crc32(content)) + content


def unseal(data: bytes) -> list[ClassTable]:
    """Return the tables of an image. Raise ImageError if it is damaged or of another format."""
    title, *_ = data[:200].partition(b"\n")
    if not title.startswith(_WORDS):
        raise ImageError("this is not an image of central's state: it does not start like one")
    version = title[len(_WORDS) :].decode("ascii", "replace")
    if version.partition(" ")[0] != str(FORMAT):
        raise ImageError(
            f"the image has format {version!r}, and tca {release()} reads format {FORMAT}: "
            "start the other version, or continue without the image"
        )
    start = len(title) + 1 + _CHECK.size
    if len(data) < start:
        raise ImageError("the image is cut off: continue with an older one, or without")
    length, check = _CHECK.unpack_from(data, start - _CHECK.size)
    content = memoryview(data)[start:]
    if len(content) != length or zlib.crc32(content) != check:
        what = "cut off" if len(content) < length else "damaged"
        raise ImageError(f"the image is {what}: continue with an older one, or without")
    tables: list[ClassTable] = msgspec.msgpack.decode(
        content, type=list[ClassTable], ext_hook=_read_long
    )
    return tables


def plain_column(values: list[Any], count: int) -> Column:
    """Return a column of plain values, in a table of *count* objects."""
    kinds = set(map(type, values))
    if kinds == {int}:
        has_long = _is_long(min(values)) or _is_long(max(values))
    else:
        has_long = int in kinds and any(type(one) is int and _is_long(one) for one in values)
    if has_long:
        values = [_long(one) if type(one) is int and _is_long(one) else one for one in values]
    # Floats are always written one by one: 0.0 and -0.0 are equal, but differ.
    is_common = len(kinds) == 1 and float not in kinds and _are_all_the_same(values, count)
    return Column(values[:1] if is_common else values, is_common=is_common)


def references(numbers: list[int], count: int) -> Column:
    """Return a column of numbers of things, in a table of *count* objects."""
    is_common = _are_all_the_same(numbers, count)
    return Column(numbers[:1] if is_common else numbers, refers=True, is_common=is_common)


def _are_all_the_same(values: list[Any], count: int) -> bool:
    """Whether there is one value per object (not one per item of containers), all equal."""
    return count == len(values) > 1 and values.count(values[0]) == count


def _is_long(number: int) -> bool:
    return not _SMALLEST <= number <= _LARGEST


def _long(number: int) -> msgspec.msgpack.Ext:
    """Return a long integer in a form that MessagePack can hold."""
    return msgspec.msgpack.Ext(
        _LONG, number.to_bytes(number.bit_length() // 8 + 1, "big", signed=True)
    )


def _read_long(code: int, data: memoryview) -> int:
    if code != _LONG:
        raise ValueError(f"extension {code} in an image")
    return int.from_bytes(data, "big", signed=True)
