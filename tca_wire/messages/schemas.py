"""JSON Schemas of types: those of msgspec, plus the formats of times and the types of keys."""

import json
from collections.abc import Iterable
from datetime import date, datetime, time, timedelta
from decimal import Decimal
from typing import Annotated, Any
from uuid import UUID

import msgspec
from msgspec import inspect

from tca_wire.errors import BadFormat
from tca_wire.messages.arrays import is_array_type

TEXT_FORMATS: dict[str, Any] = {
    "date-time": Annotated[datetime, msgspec.Meta(tz=True)],
    "partial-date-time": Annotated[datetime, msgspec.Meta(tz=False)],
    "any-date-time": datetime,
    "time": Annotated[time, msgspec.Meta(tz=True)],
    "partial-time": Annotated[time, msgspec.Meta(tz=False)],
    "any-time": time,
    "date": date,
    "duration": timedelta,
    "uuid": UUID,
    "decimal": Decimal,
}
"""The type of each format of text.

Times that are "partial" have no time zone; "any" times may have one.
"""

_TIMES: dict[type, str] = {inspect.DateTimeType: "date-time", inspect.TimeType: "time"}
_ZONES = {True: "", False: "partial-", None: "any-"}
_KEY_TYPES: dict[type, Any] = {
    inspect.BoolType: bool,
    inspect.IntType: int,
    inspect.FloatType: float,
    inspect.BytesType: bytes,
    inspect.UUIDType: UUID,
    inspect.DecimalType: Decimal,
    inspect.DateType: date,
    inspect.DateTimeType: datetime,
    inspect.TimeType: time,
    inspect.TimeDeltaType: timedelta,
}


def schema_text(kind: Any) -> str:
    """Describe a type as JSON Schema, in canonical text.

    Raises TypeError or BadFormat for a type without a format.
    """
    schema = msgspec.json.schema(kind, schema_hook=_schema_of_custom)
    _Completion(schema.get("$defs", {})).complete(inspect.type_info(kind), schema)
    return json.dumps(schema, sort_keys=True, separators=(",", ":"))


def _schema_of_custom(kind: Any) -> dict[str, Any]:
    if is_array_type(kind):
        return {"type": "array", "format": "numpy"}
    name = getattr(kind, "__name__", kind)
    msg = f"{name} has no format: use a dataclass, msgspec.Struct or TypedDict"
    raise BadFormat(msg)


class _Completion:
    """Completes the schema of a type, side by side with the type. Each class is visited once."""

    def __init__(self, definitions: dict[str, Any]) -> None:
        self._definitions = definitions
        self._visited: set[str] = set()

    def complete(self, kind: inspect.Type, schema: dict[str, Any]) -> None:
        """Complete the *schema* of *kind*, and the schemas inside it."""
        kind = _without_metadata(kind)
        if name := schema.get("$ref", "").rpartition("/")[2]:
            if name not in self._visited:
                self._visited.add(name)
                self.complete(kind, self._definitions[name])
            return
        if isinstance(kind, inspect.DateTimeType | inspect.TimeType):
            schema["format"] = _ZONES[kind.tz] + _TIMES[type(kind)]
        elif isinstance(kind, inspect.DictType) and (key := self._key(kind.key_type)):
            schema["propertyNames"] = key
        for part, part_schema in zip(*_parts(kind, schema), strict=False):
            if part_schema:
                self.complete(part, part_schema)

    def _key(self, kind: inspect.Type) -> dict[str, Any]:
        """Return the schema of a mapping's keys.

        It is empty for text, which msgspec describes, and for keys of any type.
        """
        kind = _without_metadata(kind)
        if isinstance(kind, inspect.EnumType):
            return {"enum": sorted(one.value for one in kind.cls)}
        if isinstance(kind, inspect.LiteralType):
            return {"enum": list(kind.values)}
        key_type = _KEY_TYPES.get(type(kind))
        schema: dict[str, Any] = json.loads(schema_text(key_type)) if key_type else {}
        return schema


def _without_metadata(kind: inspect.Type) -> inspect.Type:
    """Return a type without its metadata."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    return kind


def _parts(
    kind: inspect.Type, schema: dict[str, Any]
) -> tuple[Iterable[inspect.Type], Iterable[dict[str, Any] | None]]:
    """Return the types in a type, and the schema of each.

    msgspec orders the schema of a union: first other types, then structs, and null comes last.
    """
    if isinstance(kind, inspect.UnionType):
        options = [one for option in schema["anyOf"] for one in option.get("anyOf", [option])]
        return sorted(map(_without_metadata, kind.types), key=_place_in_union), options
    if isinstance(kind, inspect.DictType):
        return [kind.value_type], [schema.get("additionalProperties")]
    if isinstance(kind, inspect.CollectionType):
        return [kind.item_type], [schema.get("items")]
    if isinstance(kind, inspect.TupleType):
        return kind.item_types, schema.get("prefixItems", ())
    fields = getattr(kind, "fields", ())
    schemas = schema.get("prefixItems") or list(schema.get("properties", {}).values())
    return [one.type for one in fields], schemas[len(schemas) - len(fields) :]  # a tag comes first


def _place_in_union(kind: inspect.Type) -> int:
    if isinstance(kind, inspect.NoneType):
        return 2
    return int(isinstance(kind, inspect.StructType) and not kind.array_like)
