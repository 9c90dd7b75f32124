"""JSON Schemas as viewers of MCAP files read them: a tree of named fields. Pure.

Foxglove reads objects with ``properties``, arrays of one type, and plain types; it knows neither references nor
alternatives, and refuses a whole topic where it meets one. So references are filled in, "X or null" becomes X, and a
field that can't be said is left out: the data still have it.
"""

import json
from typing import Any

Schema = dict[str, Any]

_PLAIN = {"boolean", "number", "integer"}
_DEEPEST = 32
_MOST_PARTS = 5000
"""Filling in references may make a schema of a few lines endless."""


def plain_schema(text: str) -> Schema | None:
    """The schema of data as data.py shows them, from the text of a format; None if it can't be said."""
    try:
        schema = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return None
    definitions = schema.get("$defs") if isinstance(schema, dict) else None
    return _Plain(definitions if isinstance(definitions, dict) else {}).schema(schema, ())


def object_schema(title: str, **properties: Schema | None) -> Schema:
    """The schema of an object; of a field without one nothing is said."""
    known = {name: schema for name, schema in properties.items() if schema is not None}
    return {"title": title, "type": "object", "properties": known}


class _Plain:
    """Makes schemas plain; *within* are the references that a part is in, and "" for each object or array."""

    def __init__(self, definitions: Schema) -> None:
        self._definitions = definitions
        self._parts = 0

    def schema(self, schema: Any, within: tuple[str, ...]) -> Schema | None:
        """A part made plain; None if it can't be."""
        self._parts += 1
        if not isinstance(schema, dict) or len(within) > _DEEPEST or self._parts > _MOST_PARTS:
            return None
        if reference := schema.get("$ref"):
            name = str(reference).rpartition("/")[2]  # of a type that holds itself the inner one is left out
            return None if name in within else self.schema(self._definitions.get(name), (*within, name))
        if isinstance(ways := schema.get("anyOf"), list):
            return self._one_of([way for way in ways if way != {"type": "null"}], within)
        return self._of_one_kind(schema, (*within, ""))

    def _of_one_kind(self, schema: Schema, within: tuple[str, ...]) -> Schema | None:
        kind, values = schema.get("type"), schema.get("enum")
        if isinstance(values, list):
            return _of_values(values)
        if kind == "object":
            return self._object(schema, within)
        if kind == "array":
            return self._array(schema, within)
        if kind == "string":
            return _string(schema)
        return {"type": kind} if kind in _PLAIN else None

    def _one_of(self, ways: list[Any], within: tuple[str, ...]) -> Schema | None:
        """Alternatives, if they are all the same."""
        plain = [self.schema(way, within) for way in ways]
        return plain[0] if plain and all(way == plain[0] for way in plain) else None

    def _object(self, schema: Schema, within: tuple[str, ...]) -> Schema:
        fields = schema.get("properties")
        named = fields.items() if isinstance(fields, dict) else ()
        plain = {name: self.schema(field, within) for name, field in named}
        return {"type": "object", "properties": {name: field for name, field in plain.items() if field}}

    def _array(self, schema: Schema, within: tuple[str, ...]) -> Schema | None:
        """An array whose items are all of one type that is no array."""
        if schema.get("format") == "numpy":
            shape = {"type": "array", "items": {"type": "integer"}}
            return object_schema("array", dtype={"type": "string"}, shape=shape)
        first = schema.get("prefixItems")
        kinds = [kind for kind in (*(first if isinstance(first, list) else ()), schema.get("items")) if kind]
        if any(isinstance(kind, dict) and "anyOf" in kind for kind in kinds):
            return None  # an item may be null, and then it is of no type
        plain = [self.schema(kind, within) for kind in kinds]
        item = plain[0] if plain and all(kind == plain[0] for kind in plain) else None
        return {"type": "array", "items": item} if item and item["type"] != "array" else None


def _of_values(values: list[Any]) -> Schema | None:
    if all(isinstance(value, str) for value in values):
        return {"type": "string", "enum": values}
    return {"type": "integer", "enum": values} if all(type(value) is int for value in values) else None


def _string(schema: Schema) -> Schema:
    """A text; bytes are shown as an object that says how they are written."""
    if "contentEncoding" in schema:
        return object_schema("bytes", base64={"type": "string", "contentEncoding": "base64"})
    return {"type": "string"}
