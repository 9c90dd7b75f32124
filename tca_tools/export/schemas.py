"""JSON Schemas for viewers of MCAP files: a tree of named fields.

Foxglove reads objects with ``properties``, arrays of one type, and plain types. It refuses a topic
with references or alternatives in its schema. References are therefore replaced by their targets,
and "X or null" by X. A field that can't be described is left out of the schema, not of the data.
"""

import json
from typing import Any

Schema = dict[str, Any]

_NAMES = ((str, "string"), (int, "integer"))
_DEEPEST = 32
_MOST_PARTS = 5000
"""The most parts of a schema; replaced references may make a short schema endless."""


def plain_schema(text: str) -> Schema | None:
    """Return the plain schema of a message's data, from the text of its format.

    Return None if a plain schema can't describe the data.
    """
    try:
        schema = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return None
    definitions = schema.get("$defs") if isinstance(schema, dict) else None
    return _Plain(definitions if isinstance(definitions, dict) else {}).schema(schema, ())


def object_schema(title: str, **properties: Schema | None) -> Schema:
    """Return the schema of an object, without the fields whose schema is None."""
    known = {name: schema for name, schema in properties.items() if schema is not None}
    return {"title": title, "type": "object", "properties": known}


class _Plain:
    """Converts schemas to plain ones.

    *within* has the references around a part, and "" for each object or array around it.
    """

    def __init__(self, definitions: Schema) -> None:
        self._definitions = definitions
        self._parts = 0

    def schema(self, schema: Any, within: tuple[str, ...]) -> Schema | None:
        """Return the plain schema of a part; None if that is impossible."""
        self._parts += 1
        if not isinstance(schema, dict) or len(within) > _DEEPEST or self._parts > _MOST_PARTS:
            return None
        if reference := schema.get("$ref"):
            name = str(reference).rpartition("/")[2]
            if name in within:  # a type that contains itself
                return None
            return self.schema(self._definitions.get(name), (*within, name))
        if isinstance(alternatives := schema.get("anyOf"), list):
            parts = [part for part in alternatives if part != {"type": "null"}]
            return self._common(parts, within)
        return self._of_one_kind(schema, (*within, ""))

    def _common(self, alternatives: list[Any], within: tuple[str, ...]) -> Schema | None:
        """Return the plain schema of alternatives, if they all have the same."""
        plain = [self.schema(part, within) for part in alternatives]
        return plain[0] if plain and all(part == plain[0] for part in plain) else None

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
            case {"type": "array", "format": "numpy"}:  # its data are an ArrayInfo
                whole = {"type": "integer"}
                shape = {"type": "array", "items": whole}
                plain = object_schema("array", dtype={"type": "string"}, shape=shape, bytes=whole)
            case {"type": "array"}:
                plain = self._array(schema, within)
            case {"type": "string", "contentEncoding": _}:  # the data of bytes are an object
                plain = object_schema(
                    "bytes", base64={"type": "string", "contentEncoding": "base64"}
                )
            case {"type": "boolean" | "number" | "integer" | "string" as kind}:
                plain = {"type": kind}
        return plain

    def _array(self, schema: Schema, within: tuple[str, ...]) -> Schema | None:
        """Return the schema of an array whose items have one type, neither array nor null."""
        first = schema.get("prefixItems")
        kinds = [
            kind
            for kind in (*(first if isinstance(first, list) else ()), schema.get("items"))
            if kind
        ]
        if any(isinstance(kind, dict) and "anyOf" in kind for kind in kinds):
            return None
        item = self._common(kinds, within)
        return {"type": "array", "items": item} if item and item["type"] != "array" else None
