"""Formats of user data: from Python type hints to MessagePack and JSON Schema. Knows nothing of messages.

numpy is not imported here: an array says how it is built, and a type that names numpy has imported it already.
"""

import json
import sys
from typing import Any, Generic, TypeVar, get_args, get_origin

import msgspec

from tca_wire.errors import BadData, BadFormat
from tca_wire.vocabulary import Limit

T = TypeVar("T")

NIL = b"\xc0"
"""None as MessagePack."""

NO_DATA = '{"type":"null"}'
"""The schema of messages without data."""

MISSION_TASK = "x-tca-mission"
"""The key of a schema that says which task of which server a command is: missions find their tasks by it."""

_CERTAIN = (bytes, str, float, int, bool, type(None))
"""Types whose values can be read wherever they can be sent."""

_NDARRAY = 1  # MessagePack extension type: [dtype, shape, bytes in C order]
_UNFIT = (msgspec.MsgspecError, UnicodeDecodeError, UnicodeEncodeError, RecursionError, TypeError, OverflowError)


def _is_array_type(kind: Any) -> bool:
    origin = get_origin(kind) or kind
    return getattr(origin, "__name__", "") == "ndarray" and getattr(origin, "__module__", "") == "numpy"


def _encode_custom(value: Any) -> Any:
    """Encode what msgspec does not know: numpy arrays and numpy's numbers, numbers that know more than they are."""
    if isinstance(value, int):
        return int(value)
    if _is_array_type(type(value)):
        if value.dtype.hasobject:
            msg = f"an array of dtype {value.dtype} holds Python objects"
            raise TypeError(msg)
        return msgspec.msgpack.Ext(_NDARRAY, msgspec.msgpack.encode([value.dtype.str, value.shape, value.tobytes()]))
    if type(value).__module__ == "numpy" and hasattr(value, "item"):
        return value.item()
    msg = f"objects of type {type(value).__name__} can't be sent"
    raise TypeError(msg)


def _decode_array(code: int, data: memoryview) -> Any:
    if code != _NDARRAY:
        return msgspec.msgpack.Ext(code, bytes(data))
    dtype, shape, content = msgspec.msgpack.decode(data, type=tuple[str, tuple[int, ...], bytes])
    numpy: Any = sys.modules.get("numpy")
    if numpy is None:  # a tool without numpy: still show what there is
        return {"dtype": dtype, "shape": shape}
    try:
        return numpy.frombuffer(bytearray(content), dtype=numpy.dtype(dtype)).reshape(shape)
    except (ValueError, TypeError) as error:
        msg = f"damaged array ({error})"
        raise msgspec.ValidationError(msg) from None


def _decode_custom(kind: Any, value: Any) -> Any:
    if not _is_array_type(kind) or not _is_array_type(type(value)):
        msg = f"Expected `{getattr(kind, '__name__', kind)}`, got `{type(value).__name__}`"
        raise msgspec.ValidationError(msg)
    wanted = [part for hint in get_args(kind)[1:] for part in get_args(hint)]
    if wanted and isinstance(wanted[0], type) and not issubclass(value.dtype.type, wanted[0]):
        msg = f"Expected an array of `{wanted[0].__name__}`, got one of `{value.dtype}`"
        raise msgspec.ValidationError(msg)
    return value


def _schema_of_custom(kind: Any) -> dict[str, Any]:
    if _is_array_type(kind):
        return {"type": "array", "format": "numpy"}
    msg = f"{getattr(kind, '__name__', kind)} has no format; use a dataclass, msgspec.Struct or TypedDict"
    raise BadFormat(msg)


class Format(Generic[T]):
    """The encoding of values of one type: checked, as MessagePack.

    Accepts what msgspec does (dataclasses, Structs, TypedDicts, enums, containers, optionals, datetimes, ...) and
    numpy arrays. Raises BadFormat for a type that it can't encode.
    """

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        try:
            self.schema = schema_text(kind)
            self._decoder = msgspec.msgpack.Decoder(kind, dec_hook=_decode_custom, ext_hook=_decode_array)
        except (TypeError, NameError, ValueError) as error:
            msg = f"{self} can't be a format: {error}"
            raise BadFormat(msg) from None
        self._encoder = msgspec.msgpack.Encoder(enc_hook=_encode_custom)
        self._certain = kind if kind in _CERTAIN else None

    def __str__(self) -> str:
        return "None" if self.kind is type(None) else getattr(self.kind, "__name__", None) or str(self.kind)

    def encode(self, value: T) -> bytes:
        """*value* as bytes. Raises BadData, naming the field, if the receiver could not read it."""
        try:
            data = self._encoder.encode(value)
        except _UNFIT as error:
            raise BadData(f"{error}") from None
        if len(data) > Limit.BODY:
            msg = f"{len(data)} bytes; a message holds at most {Limit.BODY:d}: send a reference to it instead"
            raise BadData(msg)
        if type(value) is not self._certain:
            self.decode(data)  # msgspec checks types only when it decodes
        return data

    def decode(self, data: bytes) -> T:
        """The value that *data* holds. Raises BadData, naming the field, if it is no T."""
        try:
            value: T = self._decoder.decode(data)
        except _UNFIT as error:
            raise BadData(f"{error}") from None
        return value


def decode_untyped(data: bytes) -> Any:
    """User data of unknown type, as plain Python values; for tools. Raises BadData."""
    try:
        return msgspec.msgpack.decode(data, ext_hook=_decode_array) if data else None
    except _UNFIT as error:
        raise BadData(f"{error}") from None


def schema_text(kind: Any) -> str:
    """The JSON Schema of a type, as canonical text."""
    return json.dumps(msgspec.json.schema(kind, schema_hook=_schema_of_custom), sort_keys=True, separators=(",", ":"))


# Parts of a schema that say nothing about which data fits.
_NO_MATTER = frozenset({"title", "description", "default", "examples", "$defs"})


def first_difference(one: str, other: str) -> str | None:
    """The difference of two formats (JSON Schema texts): ``"$.radius: number here, string there"``; None if they agree.

    Names of types, descriptions and defaults may differ; fields, their types and which are required may not.
    """
    if one == other:
        return None
    try:
        left, right = json.loads(one or "{}"), json.loads(other or "{}")
        return _Comparison(left, right).difference(left, right, "$")
    except Exception:  # noqa: BLE001 - the texts come from anybody, and may be any JSON or none
        return "$: one of the two is no JSON Schema"


class _Comparison:
    """Walks two schemas side by side, following references; recursive types end where a pair is met again."""

    def __init__(self, left: Any, right: Any) -> None:
        self._definitions = [schema.get("$defs", {}) if isinstance(schema, dict) else {} for schema in (left, right)]
        self._met: set[tuple[str, str]] = set()

    def _resolve(self, side: int, schema: Any) -> tuple[Any, str]:
        name = schema.get("$ref", "") if isinstance(schema, dict) else ""
        return (self._definitions[side].get(name.rpartition("/")[2], {}), name) if name else (schema, "")

    def difference(self, left: Any, right: Any, path: str) -> str | None:
        (left, left_name), (right, right_name) = self._resolve(0, left), self._resolve(1, right)
        if left_name and right_name:
            if (left_name, right_name) in self._met:
                return None
            self._met.add((left_name, right_name))
        if not isinstance(left, dict) or not isinstance(right, dict):
            return None if left == right else f"{path}: {brief(left)} here, {brief(right)} there"
        if left.get("type") != right.get("type") or ("enum" in left) != ("enum" in right):
            return f"{path}: {brief(left)} here, {brief(right)} there"
        return self._fields(left, right, path) or self._rest(left, right, path)

    def _fields(self, left: Any, right: Any, path: str) -> str | None:
        mine, yours = left.get("properties", {}), right.get("properties", {})
        for name in sorted(mine.keys() | yours.keys()):
            if name not in yours:
                return f"{path}.{name}: a field here, none there"
            if name not in mine:
                return f"{path}.{name}: no field here, one there"
            if found := self.difference(mine[name], yours[name], f"{path}.{name}"):
                return found
        for name in sorted(set(left.get("required", ())) ^ set(right.get("required", ()))):
            sides = ("required", "optional") if name in left.get("required", ()) else ("optional", "required")
            return f"{path}.{name}: {sides[0]} here, {sides[1]} there"
        return None

    def _rest(self, left: Any, right: Any, path: str) -> str | None:
        for key in sorted((left.keys() | right.keys()) - _NO_MATTER - {"properties", "required"}):
            mine, yours = left.get(key), right.get(key)
            step = {"items": "[...]", "additionalProperties": "[...]", "prefixItems": "[...]"}.get(key, "")
            if key in ("anyOf", "prefixItems") and mine is not None and yours is not None and len(mine) == len(yours):
                found = next(filter(None, map(self.difference, mine, yours, [path + step] * len(mine))), None)
            elif key in ("enum", "anyOf", "prefixItems"):
                found = None if mine == yours else f"{path}: {brief(left)} here, {brief(right)} there"
            else:
                found = self.difference(mine, yours, path + step)
            if found:
                return found
        return None


def brief(schema: Any) -> str:
    """A schema in a word or two, for a message."""
    if not isinstance(schema, dict):
        return "nothing" if schema is None else json.dumps(schema)
    if "enum" in schema:
        return f"one of {', '.join(map(json.dumps, schema['enum']))}"
    if "anyOf" in schema:
        return " or ".join(map(brief, schema["anyOf"]))
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    return f"{schema.get('format', '')} {schema.get('type', 'anything')}".strip()
