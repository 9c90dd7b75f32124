"""Whether all data of one format can be decoded as another: for data that central passes on.

An exception handler gets the failure's data, an action the reply of the condition. The rules are
those of decoding (formats.py). Unknown fields are skipped, an integer is also a number, and each
alternative of a union needs a fitting one. Schemas do not describe everything; what they leave open
fits.
"""

import json
from typing import Any

from tca_wire.messages.formats import brief
from tca_wire.messages.schemas import TEXT_FORMATS

_AT_LEAST = ("minimum", "exclusiveMinimum", "minLength", "minItems", "minProperties")
_AT_MOST = ("maximum", "exclusiveMaximum", "maxLength", "maxItems", "maxProperties")
_LENGTHS = ("minLength", "minItems", "minProperties")
_EQUAL = ("multipleOf", "pattern")

_TYPES = {str: "string", int: "integer", float: "number", bool: "boolean", type(None): "null"}

_ANYTHING: dict[str, Any] = {}


def first_misfit(sent: str, wanted: str) -> str | None:
    """Return the first misfit of format *sent* to *wanted* (JSON Schemas), or None.

    For example ``"$.x: integer here, string there"``, where "here" is the wanted format.
    """
    if sent == wanted:
        return None
    try:
        left, right = json.loads(sent or "{}"), json.loads(wanted or "{}")
        found = _Fitting(left, right).misfit(left, right)
    except Exception:  # noqa: BLE001 - clients may send any text
        return "$: one of the two is not a JSON Schema"
    return found and f"${found}"


def alternatives(schema: str) -> list[str]:
    """Return the schemas of a union's alternatives; one schema if it is not a union."""
    whole = json.loads(schema)
    shared = {name: whole[name] for name in ("$defs",) if name in whole}
    texts = [(one, json.dumps(one)) for one in whole.get("anyOf", [whole])]
    return [json.dumps(one | shared) if "$ref" in text else text for one, text in texts]


class _Fitting:
    """Walks two schemas side by side, following references. Results start with the place in the
    data.

    A pair of named types that is met again within itself fits, if nothing else speaks against it.
    If something does, the pairs that seemed to fit since then are checked again.
    """

    def __init__(self, sent: Any, wanted: Any) -> None:
        self._definitions = [schema.get("$defs", {}) for schema in (sent, wanted)]
        self._fits: dict[tuple[str, str], None] = {}
        self._misfits: dict[tuple[str, str], str] = {}

    def misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the first misfit of *sent*, with place and reason: ``".x: integer here, string
        there"``.
        """
        pair = (sent.get("$ref", ""), wanted.get("$ref", ""))
        if not all(pair):
            return self._resolved(self._resolve(0, sent), self._resolve(1, wanted))
        if pair in self._fits or pair in self._misfits:
            return self._misfits.get(pair)
        mark = len(self._fits)
        self._fits[pair] = None
        found = self._resolved(self._resolve(0, sent), self._resolve(1, wanted))
        if found:
            self._misfits[pair] = found
            while len(self._fits) > mark:
                self._fits.popitem()
        return found

    def _resolve(self, side: int, schema: Any) -> Any:
        name = schema.get("$ref", "")
        return self._definitions[side][name.rpartition("/")[2]] if name else schema

    def _resolved(self, sent: Any, wanted: Any) -> str | None:
        choices = wanted.get("anyOf", [wanted])
        for one in _alternatives(sent):
            if one is sent and choices == [wanted]:
                return self._single(sent, wanted)
            found = [self.misfit(one, choice) for choice in choices]
            if None not in found:
                return found[0] if len(found) == 1 else _differ(one, wanted)
        return None

    def _single(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of two schemas that are not unions."""
        if _is_open(sent) or _is_open(wanted):
            return None
        if "enum" in sent or "enum" in wanted:
            return None if _takes_value(sent, wanted) else _differ(sent, wanted)
        kinds = (sent.get("type"), wanted.get("type"))
        if kinds[0] != kinds[1] and kinds != ("integer", "number"):
            return _differ(sent, wanted)
        if not _takes_form(sent, wanted):
            return _differ(sent, wanted)
        found = _out_of_bounds(sent, wanted)
        if found is None and kinds[1] == "object":
            found = self.misfit(
                sent.get("propertyNames", _ANYTHING), wanted.get("propertyNames", _ANYTHING)
            )
        if found is None and kinds[1] == "object":
            found = self._fields(sent, wanted) or self._other_fields(sent, wanted)
        if found is None and kinds[1] == "array":
            found = self._items(sent, wanted)
        return found

    def _fields(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of the wanted fields."""
        sent_fields, required = sent.get("properties", {}), wanted.get("required", ())
        other_values = _values(sent)
        for name, field in wanted.get("properties", {}).items():
            there = sent_fields.get(name, other_values)
            if name in required and name not in sent_fields:
                return f".{name}: a field here, none there"
            if name in required and name not in sent.get("required", ()):
                return f".{name}: required here, optional there"
            if there is not None and (found := self.misfit(there, field)):
                return f".{name}{found}"
        return None

    def _other_fields(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of other fields.

        They are skipped, unless their values or names matter.
        """
        accepted = wanted.get("additionalProperties", _ANYTHING)
        for name, field in sent.get("properties", {}).items():
            if name in wanted.get("properties", {}):
                continue
            if accepted is False:
                return f".{name}: no field here, one there"
            if found := self.misfit(field, accepted):
                return f".{name}{found}"
        other_values = _values(sent)
        if other_values is None:
            return None
        found = (
            ": no further fields here, any there"
            if accepted is False
            else self.misfit(other_values, accepted)
        )
        return found and f"[...]{found}"

    def _items(self, sent: Any, wanted: Any) -> str | None:
        wanted_items, sent_items = wanted.get("prefixItems", []), sent.get("prefixItems", [])
        for place in range(max(len(wanted_items), len(sent_items)) + 1):
            sent_item = (
                sent_items[place]
                if place < len(sent_items)
                else sent.get("items", False if sent_items else _ANYTHING)
            )
            wanted_item = (
                wanted_items[place] if place < len(wanted_items) else wanted.get("items", _ANYTHING)
            )
            if sent_item is False:
                return None
            found = (
                ": none here, some there"
                if wanted_item is False
                else self.misfit(sent_item, wanted_item)
            )
            if found:
                return f"[...]{found}"
        return None


def _alternatives(schema: Any) -> list[Any]:
    """Return the alternatives of a schema, one by one."""
    if len(schema.get("enum", ())) > 1:
        return [{"enum": [value]} for value in schema["enum"]]
    whole: list[Any] = schema.get("anyOf", [schema])
    return whole


def _is_open(schema: Any) -> bool:
    """Return whether a schema accepts any value."""
    return not any(key in schema for key in ("type", "enum", "anyOf"))


def _takes_value(sent: Any, wanted: Any) -> bool:
    """Return whether *sent* has exactly one value, and *wanted* accepts it."""
    if "enum" not in sent:
        return False
    value = sent["enum"][0]
    if "enum" in wanted:
        return any(type(one) is type(value) and one == value for one in wanted["enum"])
    kind = _TYPES.get(type(value))
    if wanted["type"] not in (kind, "number" if kind == "integer" else kind) or not _takes_form(
        {}, wanted
    ):
        return False
    size = len(value) if isinstance(value, str) else None
    exact = {"minimum": value, "maximum": value, "minLength": size, "maxLength": size}
    return _out_of_bounds(exact, wanted) is None


def _takes_form(sent: Any, wanted: Any) -> bool:
    """Return whether values written as text, or as a list, can be read as wanted."""
    if sent.get("contentEncoding") != wanted.get("contentEncoding"):
        return False
    wanted_format, sent_format = wanted.get("format"), sent.get("format")
    is_any_zone = (
        wanted_format is not None
        and wanted_format.startswith("any-")
        and sent_format in (wanted_format[4:], f"partial-{wanted_format[4:]}")
    )
    return bool(
        wanted_format == sent_format
        or is_any_zone
        or (wanted_format is None and sent_format in TEXT_FORMATS)
    )


def _out_of_bounds(sent: Any, wanted: Any) -> str | None:
    """Return the wanted bound that *sent* does not keep."""
    for key in (*_AT_LEAST, *_AT_MOST, *_EQUAL):
        wanted_bound, sent_bound = wanted.get(key), sent.get(key, 0 if key in _LENGTHS else None)
        if key == "maxItems" and sent_bound is None and "prefixItems" in sent:
            sent_bound = len(sent["prefixItems"])
        if wanted_bound is None or wanted_bound == sent_bound:
            continue
        is_kept = sent_bound is not None and (
            (key in _AT_LEAST and sent_bound >= wanted_bound)
            or (key in _AT_MOST and sent_bound <= wanted_bound)
        )
        if not is_kept:
            shown = "none" if sent_bound is None else json.dumps(sent_bound)
            return f": {key} {json.dumps(wanted_bound)} here, {shown} there"
    return None


def _values(schema: Any) -> Any:
    """Return the schema of a mapping's values; None for a type with fields only."""
    return schema.get("additionalProperties", _ANYTHING) if "properties" not in schema else None


def _differ(sent: Any, wanted: Any) -> str:
    return f": {brief(wanted)} here, {brief(sent)} there"
