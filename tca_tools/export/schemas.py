"""JSON Schemas as viewers of MCAP files read them: a tree of named fields. Pure.

Foxglove reads objects with ``properties``, arrays of one type, and plain types; it knows neither
references nor alternatives, and refuses a whole topic where it meets one. So references are filled
in, "X or null" becomes X, and a field that can't be said is left out: the data still have it.
"""

import json
from typing import Any

Schema = dict[str, Any]

_NAMES = ((str, "string"), (int, "integer"))
_DEEPEST = 32
_MOST_PARTS = 5000
"""Filling in references may make a schema of a few lines endless."""


def plain_schema(text: str) -> Schema | None:
    """The schema of the plain values of a message's data, from the text of a format; None if it
    can't be said.
    """
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
    """Makes schemas plain; *within* are the references that a part is in, and "" for each object or
    array.
    """

    def __init__(self, definitions: Schema) -> None:
        self._definitions = definitions
        self._parts = 0

    def schema(self, schema: Any, within: tuple[str, ...]) -> Schema | None:
        """A part made plain; None if it can't be."""
        self._parts += 1
        if not isinstance(schema, dict) or len(within) > _DEEPEST or self._parts > _MOST_PARTS:
            return None
        if reference := schema.get("$ref"):
            name = str(reference).rpartition("/")[
                2
            ]  # of a type that holds itself the inner one is left out
            return (
                None
                if name in within
                else self.schema(self._definitions.get(name), (*within, name))
            )
        if isinstance(ways := schema.get("anyOf"), list):
            return self._one_of([way for way in ways if way != {"type": "null"}], within)
        return self._of_one_kind(schema, (*within, ""))

    def _one_of(self, ways: list[Any], within: tuple[str, ...]) -> Schema | None:
        """Alternatives, if they are all the same."""
        plain = [self.schema(way, within) for way in ways]
        return plain[0] if plain and all(way == plain[0] for way in plain) else None

    def _of_one_kind(self, schema: Schema, within: tuple[str, ...]) -> Schema | None:
        plain: Schema | None = None
        match schema:
            case {"enum": list(values)}:
                names = [
                    name for kind, name in _NAMES if all(type(value) is kind for value in values)
                ]
                plain = {"type": names[0], "enum": values} if names else None
            case {"type": "object"}:
                fields = schema.get("properties")
                named = fields.items() if isinstance(fields, dict) else ()
                parts = {name: self.schema(field, within) for name, field in named}
                plain = {
                    "type": "object",
                    "properties": {name: part for name, part in parts.items() if part},
                }
            case {"type": "array", "format": "numpy"}:  # shown by its type and shape
                shape = {"type": "array", "items": {"type": "integer"}}
                plain = object_schema("array", dtype={"type": "string"}, shape=shape)
            case {"type": "array"}:
                plain = self._array(schema, within)
            case {"type": "string", "contentEncoding": _}:  # bytes are shown as an object
                plain = object_schema(
                    "bytes", base64={"type": "string", "contentEncoding": "base64"}
                )
            case {"type": "boolean" | "number" | "integer" | "string" as kind}:
                plain = {"type": kind}
        return plain

    def _array(self, schema: Schema, within: tuple[str, ...]) -> Schema | None:
        """An array whose items are all of one type that is no array, nor null."""
        first = schema.get("prefixItems")
        kinds = [
            kind
            for kind in (*(first if isinstance(first, list) else ()), schema.get("items"))
            if kind
        ]
        if any(isinstance(kind, dict) and "anyOf" in kind for kind in kinds):
            return None
        item = self._one_of(kinds, within)
        return {"type": "array", "items": item} if item and item["type"] != "array" else None
