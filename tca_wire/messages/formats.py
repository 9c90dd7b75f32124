"""Formats of user data: from Python type hints to MessagePack and JSON Schema."""

import dataclasses
import json
from typing import Any, Generic, TypeVar, get_args

import msgspec

from tca_wire.errors import BadData, BadFormat
from tca_wire.messages.arrays import decode_array, decode_custom, encode_custom, without_content
from tca_wire.messages.schemas import schema_text
from tca_wire.vocabulary import Limit

T = TypeVar("T")

NIL = b"\xc0"
"""None as MessagePack."""

NO_DATA = '{"type":"null"}'
"""The schema of messages without data."""

MISSION_TASK = "x-tca-mission"
"""The key of a schema that names the task server's task of a command, for missions."""

_CERTAIN = (bytes, str, float, int, bool, type(None))
"""Types whose values can always be read again."""

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
            raise BadFormat(f"{self} can't be a format: {error}") from None
        self._encoder = msgspec.msgpack.Encoder(enc_hook=encode_custom)
        self._certain = kind if kind in _CERTAIN else None
        self._has_fields = '"properties"' in self.schema or '"prefixItems"' in self.schema

    def __reduce__(self) -> tuple[Any, ...]:
        return Format, (self.kind,)

    def __str__(self) -> str:
        return type_name(self.kind)

    def encode(self, value: T) -> bytes:
        """Encode *value*. Raises BadData, naming the field, if the receiver could not read it."""
        try:
            data = self._encoder.encode(value)
        except _UNFIT as error:
            raise BadData(f"{error}") from None
        if len(data) > Limit.BODY:
            limit = f"a message holds at most {Limit.BODY:d}"
            msg = f"{len(data)} bytes: {limit}; send a reference instead"
            raise BadData(msg)
        if type(value) is not self._certain:
            read = self.decode(data)  # msgspec checks types only when it decodes
            if self._has_fields and (loss := _first_loss(value, read)):
                raise BadData(f"{self} has no place for `{loss}`: it would be lost")
        return data

    def decode(self, data: bytes) -> T:
        """Decode a value. Raises BadData, naming the field, if it is not a T."""
        try:
            value: T = self._decoder.decode(data)
        except _UNFIT as error:
            raise BadData(f"{error}") from None
        return value


def type_name(kind: Any) -> str:
    """Return a type as it is written."""
    name = "None" if kind is type(None) else getattr(kind, "__name__", "")
    return name if name and not get_args(kind) else str(kind)


def decode_untyped(data: bytes) -> Any:
    """Decode user data of unknown type to plain Python values; for tools. Raises BadData."""
    try:
        return msgspec.msgpack.decode(data, ext_hook=decode_array) if data else None
    except _UNFIT as error:
        raise BadData(f"{error}") from None


# Parts of a schema that do not affect which data fits.
_NO_MATTER = frozenset({"title", "description", "default", "examples", "$defs"})


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

    A pair of named types that is met again ends the walk: types may be recursive.
    """

    def __init__(self, left: Any, right: Any) -> None:
        self._definitions = [
            schema.get("$defs", {}) if isinstance(schema, dict) else {} for schema in (left, right)
        ]
        self._visited: set[tuple[str, str]] = set()

    def _resolve(self, side: int, schema: Any) -> tuple[Any, str]:
        name = schema.get("$ref", "") if isinstance(schema, dict) else ""
        return (
            (self._definitions[side].get(name.rpartition("/")[2], {}), name)
            if name
            else (schema, "")
        )

    def difference(self, left: Any, right: Any, path: str) -> str | None:
        (left, left_name), (right, right_name) = self._resolve(0, left), self._resolve(1, right)
        if left_name and right_name:
            if (left_name, right_name) in self._visited:
                return None
            self._visited.add((left_name, right_name))
        if not isinstance(left, dict) or not isinstance(right, dict):
            return None if left == right else f"{path}: {brief(left)} here, {brief(right)} there"
        if left.get("type") != right.get("type") or ("enum" in left) != ("enum" in right):
            return f"{path}: {brief(left)} here, {brief(right)} there"
        return self._fields(left, right, path) or self._rest(left, right, path)

    def _fields(self, left: Any, right: Any, path: str) -> str | None:
        left_fields, right_fields = left.get("properties", {}), right.get("properties", {})
        for name in sorted(left_fields.keys() | right_fields.keys()):
            if name not in right_fields:
                return f"{path}.{name}: a field here, none there"
            if name not in left_fields:
                return f"{path}.{name}: no field here, one there"
            if found := self.difference(left_fields[name], right_fields[name], f"{path}.{name}"):
                return found
        for name in sorted(set(left.get("required", ())) ^ set(right.get("required", ()))):
            sides = (
                ("required", "optional")
                if name in left.get("required", ())
                else ("optional", "required")
            )
            return f"{path}.{name}: {sides[0]} here, {sides[1]} there"
        return None

    def _rest(self, left: Any, right: Any, path: str) -> str | None:
        for key in sorted((left.keys() | right.keys()) - _NO_MATTER - {"properties", "required"}):
            left_part, right_part = left.get(key), right.get(key)
            step = "[...]" if key in ("items", "additionalProperties", "prefixItems") else ""
            if (
                key in ("anyOf", "prefixItems")
                and left_part is not None
                and right_part is not None
                and len(left_part) == len(right_part)
            ):
                pairs = zip(left_part, right_part, strict=True)
                differences = (self.difference(*pair, path + step) for pair in pairs)
                found = next(filter(None, differences), None)
            elif key in ("enum", "anyOf", "prefixItems"):
                found = (
                    None
                    if left_part == right_part
                    else f"{path}: {brief(left)} here, {brief(right)} there"
                )
            else:
                found = self.difference(left_part, right_part, path + step)
            if found:
                return found
        return None


def brief(schema: Any) -> str:
    """Return a schema in a word or two, for a message."""
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
        # Keys that are not text were decoded to their own type: compare them in order.
        if isinstance(read, dict) and len(fields) == len(sent):
            fields = dict(zip(sent, fields.values(), strict=True))
        for key, value in sent.items():
            if (
                found := _loss(value, fields[key], f"{path}.{key}")
                if key in fields
                else f"{path}.{key}"
            ):
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
        config = read.__struct_config__
        tag = {config.tag_field or "type": config.tag} if config.tag is not None else {}
        return tag | {
            one.encode_name: getattr(read, one.name) for one in msgspec.structs.fields(read)
        }
    fields = (
        dataclasses.fields(read)
        if dataclasses.is_dataclass(read)
        else getattr(read, "__attrs_attrs__", ())
    )
    return {one.name: getattr(read, one.name) for one in fields}
