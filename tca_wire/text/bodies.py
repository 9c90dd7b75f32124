"""Message bodies (user data of unknown type) as plain values and as text."""

import base64
import json
import math
import re
from typing import Any

import msgspec

from tca_wire.errors import BadData
from tca_wire.messages.arrays import ArrayInfo, describe_array
from tca_wire.messages.formats import decode_untyped
from tca_wire.text.measures import size
from tca_wire.text.printable import printable

_LONGEST_TEXT = 2000
_DEEPEST = 100
_NUMBER = re.compile(r"[<>|]([uifc])(\d\d?)")
_KINDS = {"u": "uint", "i": "int", "f": "float", "c": "complex"}


def plain_data(body: bytes) -> Any:
    """Return the content of *body* as JSON values.

    Numbers that JSON lacks become strings; bytes become objects, and arrays ArrayInfos.
    """
    try:
        return _plain(decode_untyped(body, describe_array), 0)
    except BadData as error:
        return {"undecodable": f"{len(body)} bytes: {error}"}


def json_text(value: Any, *, indent: int | None = None) -> str:
    """Return a value as JSON that every program reads.

    A number that JSON lacks becomes the text ``nan`` or ``inf``.
    """
    try:
        return json.dumps(value, indent=indent, allow_nan=False)
    except ValueError:
        return json.dumps(_plain(value, 0), indent=indent)


def data_text(body: bytes) -> str:
    """Return the content of *body* on one line, safe for a terminal; "" for no data.

    Very long data is cut.
    """
    data = plain_data(body)
    if data is None:
        return ""
    text = json.dumps(in_words(data), ensure_ascii=False)
    return printable(text if len(text) <= _LONGEST_TEXT else text[:_LONGEST_TEXT] + "…")


def in_words(value: Any) -> Any:
    """Return plain data with words for arrays: ``uint8 array of 480 x 640 x 3 (900 KiB)``."""
    if isinstance(value, ArrayInfo):
        return _array_in_words(value)
    if isinstance(value, dict):
        return {key: in_words(item) for key, item in value.items()}
    return [in_words(item) for item in value] if isinstance(value, list) else value


def _array_in_words(info: ArrayInfo) -> str:
    octets = size(info["bytes"])
    if "dtype" not in info:
        return f"data of {octets}"
    kind = info["dtype"] if isinstance(info["dtype"], str) else "structured"
    if number := _NUMBER.fullmatch(kind):
        kind = f"{_KINDS[number[1]]}{8 * int(number[2])}"
    shape = " x ".join(map(str, info["shape"]))
    return f"{'bool' if kind == '|b1' else kind} array{shape and ' of '}{shape} ({octets})"


def _plain(value: Any, depth: int) -> Any:
    if depth > _DEEPEST:
        return "…"
    if isinstance(value, ArrayInfo):
        return value
    if isinstance(value, dict):
        keys = (key if isinstance(key, str) else str(_plain_leaf(key)) for key in value)
        return dict(zip(keys, (_plain(item, depth + 1) for item in value.values()), strict=True))
    if isinstance(value, list | tuple):
        return [_plain(item, depth + 1) for item in value]
    return _plain_leaf(value)


def _plain_leaf(value: Any) -> Any:
    if (
        value is None
        or isinstance(value, str | bool | int)
        or (isinstance(value, float) and math.isfinite(value))
    ):
        return value
    if isinstance(value, bytes | bytearray):
        return {"base64": base64.b64encode(value).decode()}
    if isinstance(value, msgspec.msgpack.Ext):
        return {"extension": value.code, "base64": base64.b64encode(value.data).decode()}
    if hasattr(value, "isoformat"):
        return value.isoformat()
    return str(value)
