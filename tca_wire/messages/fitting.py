"""Whether all data of one format can be decoded as another: for data that central passes on.

For example, an exception handler gets the failure's data, and an action gets the reply of the
condition. The rules are those of decoding (formats.py). Unknown fields are skipped, and an integer
is also a number. Each alternative of a union must fit one of the wanted alternatives. Anything that
a schema does not describe fits.
"""

import json
from itertools import chain, repeat
from typing import Any

from tca_wire.messages.formats import here_and_there
from tca_wire.messages.schemas import TEXT_FORMATS

_AT_LEAST = ("minimum", "exclusiveMinimum", "minLength", "minItems", "minProperties")
_AT_MOST = ("maximum", "exclusiveMaximum", "maxLength", "maxItems", "maxProperties")
_ZERO_BY_DEFAULT = ("minLength", "minItems", "minProperties")
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
    shared = {"$defs": whole["$defs"]} if "$defs" in whole else {}
    texts = [(one, json.dumps(one)) for one in whole.get("anyOf", [whole])]
    return [json.dumps(one | shared) if "$ref" in text else text for one, text in texts]


class _Fitting:
    """Compares two schemas side by side, following references.

    Each result is the first misfit, None if all fits: the place in the data, then the reason.

    Types may be recursive. A pair of named types that is met again inside itself counts as fitting
    there. If the outer pair does not fit in the end, the pairs that seemed to fit inside it are
    forgotten. They are checked again when they are next met.
    """

    def __init__(self, sent: Any, wanted: Any) -> None:
        self._definitions = [schema.get("$defs", {}) for schema in (sent, wanted)]
        self._fits: dict[tuple[str, str], None] = {}
        self._misfits: dict[tuple[str, str], str] = {}

    def misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the first misfit of *sent*: ``".x: integer here, string there"``."""
        pair = (sent.get("$ref", ""), wanted.get("$ref", ""))
        if not all(pair):
            return self._union_misfit(self._resolve(0, sent), self._resolve(1, wanted))
        if pair in self._fits or pair in self._misfits:
            return self._misfits.get(pair)
        outer_pairs = len(self._fits)
        self._fits[pair] = None
        found = self._union_misfit(self._resolve(0, sent), self._resolve(1, wanted))
        if found:
            self._misfits[pair] = found
            while len(self._fits) > outer_pairs:
                self._fits.popitem()
        return found

    def _resolve(self, side: int, schema: Any) -> Any:
        name = schema.get("$ref", "")
        return self._definitions[side][name.rpartition("/")[2]] if name else schema

    def _union_misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of two schemas that may be unions."""
        choices = wanted.get("anyOf", [wanted])
        for one in _alternatives(sent):
            if one is sent and choices == [wanted]:
                return self._plain_misfit(sent, wanted)
            found = [self.misfit(one, choice) for choice in choices]
            if None not in found:
                return found[0] if len(found) == 1 else here_and_there(wanted, one)
        return None

    def _plain_misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of two schemas that are not unions."""
        if _accepts_any(sent) or _accepts_any(wanted):
            return None
        if "enum" in sent or "enum" in wanted:
            return None if _accepts_value(sent, wanted) else here_and_there(wanted, sent)
        kinds = (sent.get("type"), wanted.get("type"))
        fits_kind = kinds[0] == kinds[1] or kinds == ("integer", "number")
        if not fits_kind or not _accepts_form(sent, wanted):
            return here_and_there(wanted, sent)
        found = _out_of_bounds(sent, wanted)
        if kinds[1] == "object":
            names = [one.get("propertyNames", _ANYTHING) for one in (sent, wanted)]
            found = found or self.misfit(*names) or self._field_misfit(sent, wanted)
            return found or self._other_field_misfit(sent, wanted)
        return found or (self._item_misfit(sent, wanted) if kinds[1] == "array" else None)

    def _field_misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of the wanted fields."""
        sent_fields, required = sent.get("properties", {}), wanted.get("required", ())
        other_values = _value_schema(sent)
        for name, field in wanted.get("properties", {}).items():
            sent_field = sent_fields.get(name, other_values)
            if name in required and name not in sent_fields:
                return f".{name}: a field here, none there"
            if name in required and name not in sent.get("required", ()):
                return f".{name}: required here, optional there"
            if sent_field is not None and (found := self.misfit(sent_field, field)):
                return f".{name}{found}"
        return None

    def _other_field_misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of other fields.

        A decoder skips such fields, unless *wanted* describes or forbids them.
        """
        accepted = wanted.get("additionalProperties", _ANYTHING)
        for name, field in sent.get("properties", {}).items():
            if name in wanted.get("properties", {}):
                continue
            if accepted is False:
                return f".{name}: no field here, one there"
            if found := self.misfit(field, accepted):
                return f".{name}{found}"
        other_values = _value_schema(sent)
        if other_values is None:
            return None
        if accepted is False:
            return "[...]: no further fields here, any there"
        found = self.misfit(other_values, accepted)
        return found and f"[...]{found}"

    def _item_misfit(self, sent: Any, wanted: Any) -> str | None:
        """Return the misfit of the items of a list: first those with a place, then the others."""
        sent_items, wanted_items = (one.get("prefixItems", []) for one in (sent, wanted))
        other_sent = sent.get("items", False if sent_items else _ANYTHING)
        other_wanted = wanted.get("items", _ANYTHING)
        for sent_item, wanted_item, _ in zip(
            chain(sent_items, repeat(other_sent)),
            chain(wanted_items, repeat(other_wanted)),
            range(max(len(sent_items), len(wanted_items)) + 1),
            strict=False,
        ):
            if sent_item is False:
                return None
            if wanted_item is False:
                return "[...]: none here, some there"
            if found := self.misfit(sent_item, wanted_item):
                return f"[...]{found}"
        return None


def _alternatives(schema: Any) -> list[Any]:
    """Return the alternatives of a schema, one by one."""
    if len(schema.get("enum", ())) > 1:
        return [{"enum": [value]} for value in schema["enum"]]
    whole: list[Any] = schema.get("anyOf", [schema])
    return whole


def _accepts_any(schema: Any) -> bool:
    """Return whether a schema accepts any value."""
    return not any(key in schema for key in ("type", "enum", "anyOf"))


def _accepts_value(sent: Any, wanted: Any) -> bool:
    """Return whether *sent* has exactly one value, and *wanted* accepts it."""
    if "enum" not in sent:
        return False
    value = sent["enum"][0]
    if "enum" in wanted:
        return any(type(one) is type(value) and one == value for one in wanted["enum"])
    kind = _TYPES.get(type(value))
    kinds = (kind, "number") if kind == "integer" else (kind,)
    if wanted["type"] not in kinds or not _accepts_form({}, wanted):
        return False
    size = len(value) if isinstance(value, str) else None
    exact = {"minimum": value, "maximum": value, "minLength": size, "maxLength": size}
    return _out_of_bounds(exact, wanted) is None


def _accepts_form(sent: Any, wanted: Any) -> bool:
    """Return whether values are written in a form (encoding, format of times) that can be read."""
    if sent.get("contentEncoding") != wanted.get("contentEncoding"):
        return False
    wanted_format, sent_format = wanted.get("format"), sent.get("format")
    if wanted_format is None:
        return sent_format is None or sent_format in TEXT_FORMATS
    # "any-" accepts times with and without a zone, "partial-" has none (schemas.py).
    with_zone = wanted_format.removeprefix("any-")
    is_time = with_zone != wanted_format and sent_format in (with_zone, f"partial-{with_zone}")
    return bool(wanted_format == sent_format or is_time)


def _out_of_bounds(sent: Any, wanted: Any) -> str | None:
    """Return the wanted bound that *sent* does not keep."""
    for key in (*_AT_LEAST, *_AT_MOST, *_EQUAL):
        default = 0 if key in _ZERO_BY_DEFAULT else None
        wanted_bound, sent_bound = wanted.get(key), sent.get(key, default)
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


def _value_schema(schema: Any) -> Any:
    """Return the schema of a mapping's values; None for a type with fields only."""
    if "properties" in schema:
        return None
    return schema.get("additionalProperties", _ANYTHING)
