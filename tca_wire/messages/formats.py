"""Formats of user data: from Python type hints to MessagePack and JSON Schema."""

import dataclasses
import json
from collections.abc import Callable
from typing import Any, Generic, TypeVar, get_args

import msgspec

from tca_wire.errors import BadData, BadFormat
from tca_wire.messages.arrays import (
    collected_parts,
    decode_array,
    decode_custom,
    encode_custom,
    finding,
    without_content,
)
from tca_wire.messages.large_data import LargeData, described, referred
from tca_wire.messages.schemas import schema_text
from tca_wire.packets.large import LARGE, is_large

T = TypeVar("T")

NIL = b"\xc0"
"""None as MessagePack."""

NO_DATA = '{"type":"null"}'
"""The schema of messages without data."""

MISSION_TASK = "x-tca-mission"
"""The key of a schema that names the task server's task of a command, for missions."""

_ALWAYS_READABLE = (bytes, str, float, int, bool, type(None))
"""Types whose values need no check before they are sent: a receiver can always read them."""

_UNFIT = (
    msgspec.MsgspecError,
    UnicodeDecodeError,
    UnicodeEncodeError,
    RecursionError,
    TypeError,
    OverflowError,
)


class Format(Generic[T]):
    """The encoding of values of one type: checked, as MessagePack.

    It accepts the types of msgspec (dataclasses, Structs, TypedDicts, enums, containers, optionals,
    datetimes, ...) and numpy arrays. Raises BadFormat for a type that it can't encode.
    """

    def __init__(self, kind: Any) -> None:
        self.kind = kind
        try:
            self.schema = schema_text(kind)
            self._decoder = msgspec.msgpack.Decoder(
                kind, dec_hook=decode_custom, ext_hook=decode_array
            )
        except (TypeError, NameError, ValueError) as error:
            advice = "give a type, such as float, list[int] or a dataclass"
            raise BadFormat(f"{self} can't be a format: {error}: {advice}") from None
        self._encoder = msgspec.msgpack.Encoder(enc_hook=encode_custom)
        self._always_readable = kind if kind in _ALWAYS_READABLE else None
        self._has_fields = '"properties"' in self.schema or '"prefixItems"' in self.schema

    def __reduce__(self) -> tuple[Any, ...]:
        return Format, (self.kind,)

    def __str__(self) -> str:
        return type_name(self.kind)

    def encode(self, value: T) -> bytes:
        """Encode *value*; as LargeData, if it has LARGE bytes or more.

        Raises BadData, naming the field, if the receiver could not read it.
        """
        try:
            if self.kind is bytes and isinstance(value, bytes) and len(value) >= LARGE:
                return LargeData.of_bytes(value)
            data = self._encoder.encode(value)
        except _UNFIT as error:
            collected_parts()
            raise BadData(f"{error}") from None
        if (parts := collected_parts()) or len(data) >= LARGE:
            data = LargeData(data, parts)
        if type(value) is not self._always_readable:
            read = self.decode(data)  # msgspec checks types only when it decodes
            if self._has_fields and (loss := _first_loss(value, read)):
                raise BadData(f"{self} has no place for `{loss}`: it would be lost")
        return data

    def decode(self, data: bytes) -> T:
        """Decode a value. Raises BadData, naming the field, if it is not a T.

        Also raises it if the value has large data that are gone.
        """
        value: T
        try:
            if is_large(data):
                packed, part = referred(data)
                with finding(part):
                    value = self._decoder.decode(packed)
            else:
                value = self._decoder.decode(data)
        except _UNFIT as error:
            raise BadData(f"{error}") from None
        return value


def type_name(kind: Any) -> str:
    """Return a type as it is written."""
    name = "None" if kind is type(None) else getattr(kind, "__name__", "")
    return name if name and not get_args(kind) else str(kind)


def decode_untyped(data: bytes, array: Callable[[int, memoryview], Any] = decode_array) -> Any:
    """Decode user data of unknown type to plain Python values; for tools. Raises BadData.

    Large data that this program has not opened become ArrayInfos. *array* decodes other arrays.
    """
    if not data:
        return None
    try:
        if not is_large(data):
            return msgspec.msgpack.decode(data, ext_hook=array)
        packed, part = described(data)
        with finding(part):
            return msgspec.msgpack.decode(packed, ext_hook=array)
    except _UNFIT as error:
        raise BadData(f"{error}") from None


# Parts of a schema that do not affect which data fits, or are compared separately.
_IGNORED_KEYS = frozenset(
    {"title", "description", "default", "examples", "$defs", "properties", "required"}
)

# Parts of a schema that describe values inside the value.
_INNER_KEYS = ("items", "additionalProperties", "prefixItems")


def first_difference(one: str, other: str) -> str | None:
    """Return the difference of two formats (JSON Schemas); None if they agree.

    For example ``"$.radius: number here, string there"``. Names of types, descriptions and defaults
    may differ; fields, their types and which fields are required may not.
    """
    if one == other:
        return None
    try:
        left, right = json.loads(one or "{}"), json.loads(other or "{}")
        return _Comparison(left, right).difference(left, right, "$")
    except Exception:  # noqa: BLE001 - clients may send any text
        return "$: one of the two is not a JSON Schema"


class _Comparison:
    """Walks two schemas side by side, following references.

    Types may be recursive, so a pair of named types is compared only once.
    """

    def __init__(self, left: Any, right: Any) -> None:
        self._definitions = [
            schema.get("$defs", {}) if isinstance(schema, dict) else {} for schema in (left, right)
        ]
        self._visited: set[tuple[str, str]] = set()

    def _resolve(self, side: int, schema: Any) -> tuple[Any, str]:
        """Return a schema, or the definition that it refers to, and the reference ("": none)."""
        name = schema.get("$ref", "") if isinstance(schema, dict) else ""
        if not name:
            return schema, ""
        return self._definitions[side].get(name.rpartition("/")[2], {}), name

    def difference(self, left: Any, right: Any, path: str) -> str | None:
        (left, left_name), (right, right_name) = self._resolve(0, left), self._resolve(1, right)
        if left_name and right_name:
            if (left_name, right_name) in self._visited:
                return None
            self._visited.add((left_name, right_name))
        if not isinstance(left, dict) or not isinstance(right, dict):
            return None if left == right else path + here_and_there(left, right)
        if left.get("type") != right.get("type") or ("enum" in left) != ("enum" in right):
            return path + here_and_there(left, right)
        found = self._field_difference(left, right, path)
        return found or self._other_difference(left, right, path)

    def _field_difference(self, left: Any, right: Any, path: str) -> str | None:
        left_fields, right_fields = left.get("properties", {}), right.get("properties", {})
        for name in sorted(left_fields.keys() | right_fields.keys()):
            if name not in right_fields:
                return f"{path}.{name}: a field here, none there"
            if name not in left_fields:
                return f"{path}.{name}: no field here, one there"
            if found := self.difference(left_fields[name], right_fields[name], f"{path}.{name}"):
                return found
        left_required, right_required = (set(one.get("required", ())) for one in (left, right))
        if not (one_sided := left_required ^ right_required):
            return None
        name = min(one_sided)
        if name in left_required:
            return f"{path}.{name}: required here, optional there"
        return f"{path}.{name}: optional here, required there"

    def _other_difference(self, left: Any, right: Any, path: str) -> str | None:
        for key in sorted(
            (left.keys() | right.keys()) - _IGNORED_KEYS - {"properties", "required"}
        ):
            left_part, right_part = left.get(key), right.get(key)
            step = "[...]" if key in _INNER_KEYS else ""
            are_lists = left_part is not None and right_part is not None
            if key in ("anyOf", "prefixItems") and are_lists and len(left_part) == len(right_part):
                pairs = zip(left_part, right_part, strict=True)
                differences = (self.difference(*pair, path + step) for pair in pairs)
                found = next(filter(None, differences), None)
            elif key in ("enum", "anyOf", "prefixItems"):
                found = None if left_part == right_part else path + here_and_there(left, right)
            else:
                found = self.difference(left_part, right_part, path + step)
            if found:
                return found
        return None


def here_and_there(here: Any, there: Any) -> str:
    """Return a difference between two schemas: ``: number here, string there``."""
    return f": {brief(here)} here, {brief(there)} there"


def brief(schema: Any) -> str:
    """Return a schema in a word or two, for an error."""
    if not isinstance(schema, dict):
        return "nothing" if schema is None else json.dumps(schema)
    if "enum" in schema:
        return f"one of {', '.join(map(json.dumps, schema['enum']))}"
    if "anyOf" in schema:
        return " or ".join(map(brief, schema["anyOf"]))
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    return f"{schema.get('format', '')} {schema.get('type', 'anything')}".strip()


# --- data that a format would drop silently: fields of a subclass, misspelt keys of a dict --------

# A decoder skips fields that its type does not have. Before data is sent, it is therefore compared
# with the data that a receiver would read.

_encode = msgspec.msgpack.Encoder(enc_hook=without_content).encode


def _first_loss(sent: Any, read: Any) -> str:
    """Find the first part of a value that its receiver would not get.

    Args:
        sent: the sender's value.
        read: the value as the receiver's type reads it.

    Returns:
        The place of that part, such as ``$.legs[2].hight``; "" if nothing is lost.
    """
    data = _encode(sent)
    return "" if data == _encode(read) else _loss(msgspec.msgpack.decode(data), read, "$")


def _loss(sent: Any, read: Any, path: str) -> str:
    """Return the place of the first part of *sent* (plain data) that *read* lacks."""
    if isinstance(sent, dict):
        fields = _fields(read)
        # A decoder may have converted keys that are not text: match the fields by their order.
        if isinstance(read, dict) and len(fields) == len(sent):
            fields = dict(zip(sent, fields.values(), strict=True))
        for key, value in sent.items():
            where = f"{path}.{key}"
            if found := _loss(value, fields[key], where) if key in fields else where:
                return found
    elif isinstance(sent, list) and not isinstance(read, set | frozenset):
        items = read if isinstance(read, list | tuple) else list(_fields(read).values())
        for place, value in enumerate(sent):
            where = f"{path}[{place}]"
            if found := _loss(value, items[place], where) if place < len(items) else where:
                return found
    return ""


def _fields(read: Any) -> dict[Any, Any]:
    """Return the fields of a value, by their names in the encoded data."""
    if isinstance(read, dict):
        return read
    if isinstance(read, msgspec.Struct):
        config, fields = read.__struct_config__, msgspec.structs.fields(read)
        tag = {config.tag_field or "type": config.tag} if config.tag is not None else {}
        return tag | {one.encode_name: getattr(read, one.name) for one in fields}
    if dataclasses.is_dataclass(read):
        return {one.name: getattr(read, one.name) for one in dataclasses.fields(read)}
    return {one.name: getattr(read, one.name) for one in getattr(read, "__attrs_attrs__", ())}
