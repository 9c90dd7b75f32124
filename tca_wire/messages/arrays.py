"""Numpy arrays and numbers as MessagePack: each dtype arrives unchanged, or is refused by name.

An array of LARGE bytes and more is a *part* beside the MessagePack, which refers to it. Arrays
arrive read-only.

numpy is not imported here: an array brings its own methods, and a type that names numpy has
imported it already.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, get_args

import msgspec

from tca_wire.packets.large import ALIGNMENT, LARGE
from tca_wire.vocabulary import Limit

_NDARRAY = 1  # MessagePack extension type: [description of the dtype, shape, bytes in C order]
_LARGE_ARRAY = 2  # the same: [description of the dtype, shape, offset, size] of its part
# Python and MessagePack hold numbers of these kinds of dtype exactly, up to this size in bytes.
_NUMBERS, _LARGEST = "biuf", 8


PartOf = Callable[[int, int], memoryview]
"""Returns the part at an offset, of a size. Raises msgspec.ValidationError if there is none."""


class _Parts(threading.local):
    """The parts of the value that a thread encodes or decodes: msgspec's hooks get no context."""

    def __init__(self) -> None:
        self.collected: list[memoryview] = []  #: of the value that is being encoded
        self.size = 0  #: the bytes of the collected parts
        self.find: PartOf | None = None  #: finds those of the value that is being decoded


_parts = _Parts()


def padded(size: int) -> int:
    """Return the offset at which a part can begin that follows *size* bytes."""
    return -(-size // ALIGNMENT) * ALIGNMENT


def too_large(size: int, most: int) -> str:
    """Return the error for data of *size* bytes."""
    return f"{size} bytes: a message holds at most {most:d}; send a reference instead"


def collected_parts() -> list[memoryview]:
    """Return the large arrays that this thread has encoded since the last call."""
    if not (found := _parts.collected):  # the usual case, fast
        return found
    _parts.collected, _parts.size = [], 0
    return found


@contextmanager
def finding(find: PartOf | None) -> Iterator[None]:
    """Return a block in which this thread decodes arrays with the parts that *find* returns."""
    before, _parts.find = _parts.find, find
    try:
        yield
    finally:
        _parts.find = before


def slices_of(content: memoryview) -> PartOf:
    """Return the function that finds the parts of a segment with this content."""

    def part(offset: int, size: int) -> memoryview:
        if offset < 0 or size < 0 or offset + size > len(content):
            raise msgspec.ValidationError(
                f"damaged data ({size} bytes at {offset} of {len(content)})"
            )
        return content[offset : offset + size]

    return part


def is_array_type(kind: Any) -> bool:
    """Return whether a type is ``numpy.ndarray`` or ``numpy.typing.NDArray[...]`` itself."""
    origin = getattr(kind, "__origin__", kind)  # faster than typing.get_origin
    return (
        getattr(origin, "__name__", "") == "ndarray"
        and getattr(origin, "__module__", "") == "numpy"
    )


def encode_custom(value: Any) -> Any:
    """Encode values that msgspec does not know: arrays, numpy's numbers, subclasses of int.

    Raises TypeError.
    """
    if isinstance(value, int):
        return int(value)
    if _is_array(value):
        array = value if is_array_type(type(value)) else _plain(value)
        if array.nbytes >= LARGE:
            return _reference_to(array)
        content = [_description(array.dtype), array.shape, array.tobytes()]
        return msgspec.msgpack.Ext(_NDARRAY, msgspec.msgpack.encode(content))
    dtype: Any = getattr(value, "dtype", None)
    is_of_numpy = type(value).__module__ == "numpy" and dtype is not None
    if is_of_numpy and dtype.kind in _NUMBERS and dtype.itemsize <= _LARGEST:
        return value.item()
    suffix = f" (dtype {dtype})" if dtype is not None else ""
    raise TypeError(f"objects of type {type(value).__name__}{suffix} can't be sent")


def _is_array(value: Any) -> bool:
    """Return whether a value is an array, or one of a subclass, such as a ``numpy.memmap``."""
    return any(map(is_array_type, type(value).__mro__))


def _plain(array: Any) -> Any:
    """Return an array of a subclass as a plain one, uncopied.

    Raises TypeError if that loses something: a mask, or the attributes that others than numpy add.
    """
    kind = type(array)
    is_of_numpy = kind.__module__.partition(".")[0] == "numpy"
    is_masked = any(base.__name__ == "MaskedArray" for base in kind.__mro__)
    if is_masked or (not is_of_numpy and getattr(array, "__dict__", None)):
        lost = "mask" if is_masked else "attributes"
        raise TypeError(
            f"an array of type {kind.__name__} can't be sent: it would lose its {lost}; "
            f"send a plain array, and the {lost} beside it"
        )
    return sys.modules["numpy"].asarray(array)


def _reference_to(array: Any) -> msgspec.msgpack.Ext:
    """Collect a large array as a part; return the reference to it. Raises TypeError."""
    description, shape = _description(array.dtype), array.shape
    offset = padded(_parts.size)
    if offset + array.nbytes > Limit.LARGE:
        raise OverflowError(too_large(offset + array.nbytes, Limit.LARGE))
    if not array.flags.c_contiguous:
        array = array.copy(order="C")
    _parts.collected.append(memoryview(array.reshape(-1).view("u1")))
    _parts.size = offset + array.nbytes
    reference = [description, shape, offset, array.nbytes]
    return msgspec.msgpack.Ext(_LARGE_ARRAY, msgspec.msgpack.encode(reference))


def _description(dtype: Any) -> Any:
    """Return a dtype as text, or a structured one as a list of its fields.

    Raises TypeError if the description would lose a part of the dtype.
    """
    try:
        found = dtype.descr if dtype.names else dtype.str
        if not dtype.hasobject and _dtype(found) == dtype:
            return found
    except (ValueError, TypeError):  # numpy can't describe it, or can't read its description
        pass
    raise TypeError(
        f"an array of dtype {dtype} can't be sent: it holds Python objects, or overlapping fields"
    )


def _dtype(description: Any) -> Any:
    if isinstance(description, str):
        return _simple_dtype(description)
    return sys.modules["numpy"].lib.format.descr_to_dtype(_with_tuples(description))


@lru_cache(256)
def _simple_dtype(description: str) -> Any:
    return sys.modules["numpy"].lib.format.descr_to_dtype(description)


def _with_tuples(description: Any) -> Any:
    """Return a description as numpy wants it, with tuples: MessagePack has lists only."""
    if isinstance(description, str):
        return description
    fields = []
    for name, of, *shape in description:
        title = name if isinstance(name, str) else tuple(name)
        fields.append((title, _with_tuples(of), *(tuple(one) for one in shape)))
    return fields


# A decoder for each type is made once: that takes ten times as long as to decode.
_decode_content = msgspec.msgpack.Decoder(tuple[str | list[Any], tuple[int, ...], bytes]).decode
_decode_reference = msgspec.msgpack.Decoder(
    tuple[str | list[Any], tuple[int, ...], int, int]
).decode


class ArrayInfo(dict[str, Any]):
    """The ``dtype``, ``shape`` and ``bytes`` of an array; only the ``bytes`` of other data."""

    content: bytes | memoryview | None = None
    """The array in C order; None if its part is missing."""


def describe_array(code: int, data: memoryview) -> Any:
    """Return the ArrayInfo of the array that an extension holds, or refers to.

    Raises msgspec.ValidationError if the bytes are damaged.
    """
    content: bytes | memoryview | None
    if code == _NDARRAY:
        description, shape, content = _decode_content(data)
        size = len(content)
    elif code == _LARGE_ARRAY:
        description, shape, offset, size = _decode_reference(data)
        content = _parts.find(offset, size) if _parts.find is not None else None
    else:
        return msgspec.msgpack.Ext(code, bytes(data))
    info = ArrayInfo(dtype=description, shape=list(shape)) if description else ArrayInfo()
    info["bytes"], info.content = size, content
    return info


def large_value(size: int) -> bytes:
    """Return MessagePack that ``describe_array`` decodes as the ArrayInfo of any large value."""
    content = msgspec.msgpack.encode(["", (), 0, size])
    return msgspec.msgpack.encode(msgspec.msgpack.Ext(_LARGE_ARRAY, content))


def decode_array(code: int, data: memoryview) -> Any:
    """Return the array that an extension holds, or refers to; it is read-only.

    Without numpy or the array's part, return its ArrayInfo. Raises msgspec.ValidationError if the
    bytes are damaged.
    """
    numpy: Any = sys.modules.get("numpy")
    content: bytes | memoryview
    if numpy is None or (code == _LARGE_ARRAY and _parts.find is None):
        return describe_array(code, data)
    if code == _NDARRAY:
        description, shape, content = _decode_content(data)
    elif code == _LARGE_ARRAY and _parts.find is not None:
        description, shape, offset, size = _decode_reference(data)
        content = _parts.find(offset, size)
    else:
        return msgspec.msgpack.Ext(code, bytes(data))
    try:
        return numpy.frombuffer(content, dtype=_dtype(description)).reshape(shape)
    except (ValueError, TypeError) as error:
        raise msgspec.ValidationError(f"damaged array ({error})") from None


def decode_custom(kind: Any, value: Any) -> Any:
    """Check that an array is of the declared type. Raises msgspec.ValidationError."""
    if not is_array_type(kind) or not is_array_type(type(value)):
        msg = f"Expected `{getattr(kind, '__name__', kind)}`, got `{type(value).__name__}`"
        raise msgspec.ValidationError(msg)
    wanted = [part for hint in get_args(kind)[1:] for part in get_args(hint)]
    if wanted and isinstance(wanted[0], type) and not issubclass(value.dtype.type, wanted[0]):
        msg = f"Expected an array of `{wanted[0].__name__}`, got one of `{value.dtype}`"
        raise msgspec.ValidationError(msg)
    return value


def without_content(value: Any) -> Any:
    """Encode an array as None, other values as ``encode_custom`` does."""
    return None if _is_array(value) else encode_custom(value)
