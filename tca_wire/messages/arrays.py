"""Numpy arrays and numbers as MessagePack: each dtype arrives unchanged, or is refused by name.

numpy is not imported here: an array brings its own methods, and a type that names numpy has
imported it already.
"""

import sys
from typing import Any, get_args, get_origin

import msgspec

_NDARRAY = 1  # MessagePack extension type: [description of the dtype, shape, bytes in C order]
# Python and MessagePack hold numbers of these kinds of dtype exactly, up to this size in bytes.
_NUMBERS, _LARGEST = "biuf", 8


def is_array_type(kind: Any) -> bool:
    """Return whether a type is ``numpy.ndarray`` or ``numpy.typing.NDArray[...]`` itself."""
    origin = get_origin(kind) or kind
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
    if is_array_type(type(value)):
        content = [_description(value.dtype), value.shape, value.tobytes()]
        return msgspec.msgpack.Ext(_NDARRAY, msgspec.msgpack.encode(content))
    dtype: Any = getattr(value, "dtype", None)
    if type(value).__module__ == "numpy" and dtype.kind in _NUMBERS and dtype.itemsize <= _LARGEST:
        return value.item()
    suffix = f" (dtype {dtype})" if dtype is not None else ""
    raise TypeError(f"objects of type {type(value).__name__}{suffix} can't be sent")


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
    numpy: Any = sys.modules["numpy"]
    return numpy.lib.format.descr_to_dtype(_with_tuples(description))


def _with_tuples(description: Any) -> Any:
    """Return a description as numpy wants it, with tuples: MessagePack has lists only."""
    if isinstance(description, str):
        return description
    fields = []
    for name, of, *shape in description:
        title = name if isinstance(name, str) else tuple(name)
        fields.append((title, _with_tuples(of), *(tuple(one) for one in shape)))
    return fields


def decode_array(code: int, data: memoryview) -> Any:
    """Return the array that an extension holds.

    Raises msgspec.ValidationError if its bytes are damaged.
    """
    if code != _NDARRAY:
        return msgspec.msgpack.Ext(code, bytes(data))
    description, shape, content = msgspec.msgpack.decode(
        data, type=tuple[str | list[Any], tuple[int, ...], bytes]
    )
    numpy: Any = sys.modules.get("numpy")
    if numpy is None:  # a tool without numpy still shows the type and shape
        return {"dtype": description, "shape": shape}
    try:
        return numpy.frombuffer(bytearray(content), dtype=_dtype(description)).reshape(shape)
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
    return None if is_array_type(type(value)) else encode_custom(value)
