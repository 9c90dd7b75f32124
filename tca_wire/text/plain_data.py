"""Plain values (JSON, or typed text) as data of a format that is known only as JSON Schema.

Programs such as the command line send messages that they did not declare. An unknown field is most
likely a typing error. It is therefore refused here, although a decoder would skip it.
"""

import base64
import binascii
import json
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import msgspec

from tca_wire.errors import BadData
from tca_wire.messages.formats import Format, brief
from tca_wire.messages.schemas import TEXT_FORMATS
from tca_wire.text.nearest import did_you_mean

_BOUNDS: dict[str, tuple[Callable[[Any, Any], bool], str]] = {
    "minimum": (lambda value, bound: value >= bound, "be at least {}"),
    "maximum": (lambda value, bound: value <= bound, "be at most {}"),
    "exclusiveMinimum": (lambda value, bound: value > bound, "be more than {}"),
    "exclusiveMaximum": (lambda value, bound: value < bound, "be less than {}"),
    "multipleOf": (lambda value, bound: value % bound == 0, "be a multiple of {}"),
    "minLength": (lambda value, bound: len(value) >= bound, "have at least {} characters"),
    "maxLength": (lambda value, bound: len(value) <= bound, "have at most {} characters"),
    "pattern": (lambda value, pattern: re.search(pattern, value) is not None, "match {}"),
    "minItems": (lambda value, bound: len(value) >= bound, "have at least {} items"),
    "maxItems": (lambda value, bound: len(value) <= bound, "have at most {} items"),
}
_TYPE_WORDS = {
    "object": "an object",
    "array": "a list",
    "string": "text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "null": "null",
    "date": "a date like 2024-02-03",
    "date-time": "a time like 2024-02-03T12:00:00Z",
    "partial-date-time": "a time like 2024-02-03T12:00:00",
    "any-date-time": "a time like 2024-02-03T12:00:00Z (or without Z)",
    "time": "a time of day like 12:00:00Z",
    "partial-time": "a time of day like 12:00:00",
    "any-time": "a time of day like 12:00:00",
    "duration": "a duration like PT1.5S",
    "uuid": "a UUID",
    "decimal": "a decimal number as text",
}
_PYTHON_TYPES: dict[str, Any] = {
    "integer": int,
    "number": int | float,
    "boolean": bool,
    "null": type(None),
}
_LONGEST_SHOWN = 40


class FieldMisfit(BadData):
    """A value does not fit. *path* names its field ("": the whole), *problem* says why."""

    def __init__(self, path: str, problem: str) -> None:
        super().__init__(f"field '{path}' {problem}" if path else f"the data {problem}")
        self.path, self.problem = path, problem


class Bare:
    """A value as a user typed it: JSON where that fits, else the text itself."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text

    @property
    def value(self) -> Any:
        """The JSON value of the text; the text itself if it is not JSON."""
        try:
            return json.loads(self.text)
        except (ValueError, RecursionError):
            return self.text


class PlainFormat(Format[Any]):
    """A format with a known schema only; its values are dicts, lists, texts, numbers and None."""

    def __init__(self, schema: str) -> None:
        try:
            self.shape: dict[str, Any] = _cleaned(json.loads(schema or "{}"))
        except (ValueError, RecursionError):
            self.shape = {}
        is_nothing = self.shape == {"type": "null"}
        super().__init__(type(None) if is_nothing else Any)
        self.schema = schema

    def __str__(self) -> str:
        return brief(self.shape)

    @property
    def takes_fields(self) -> bool:
        """Whether its values may have named fields."""
        return _Builder(self.shape).takes_fields(self.shape)

    def encode(self, value: Any) -> bytes:
        """Encode *value*, in which texts may be Bare. Raises BadData, naming the field."""
        try:
            data = _Builder(self.shape).fit(self.shape, value, "")
        except RecursionError:
            raise BadData("it is nested too deeply") from None
        return super().encode(data)


def _cleaned(schema: Any) -> dict[str, Any]:
    """Return a schema without its invalid parts: any client may have sent it."""
    if not isinstance(schema, dict):
        return {}
    parts = {
        key: _CLEANERS[key](part) if key in _CLEANERS else part for key, part in schema.items()
    }
    return {key: part for key, part in parts.items() if part is not None}


def _text(part: Any) -> str | None:
    return part if isinstance(part, str) else None


def _list(part: Any) -> list[Any] | None:
    return part or None if isinstance(part, list) else None


def _schemas(part: Any) -> list[Any] | None:
    return [_cleaned(one) for one in part] if isinstance(part, list) and part else None


def _fields(part: Any) -> dict[str, Any] | None:
    return {name: _cleaned(one) for name, one in part.items()} if isinstance(part, dict) else None


_CLEANERS: dict[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("type", "format", "contentEncoding", "$ref", "propertyName"), _text),
    **dict.fromkeys(("properties", "$defs"), _fields),
    **dict.fromkeys(("anyOf", "prefixItems"), _schemas),
    "enum": _list,
    "required": lambda part: (
        [one for one in part if isinstance(one, str)] if isinstance(part, list) else None
    ),
    "items": _cleaned,
    "propertyNames": _cleaned,
    "additionalProperties": lambda part: part if isinstance(part, bool) else _cleaned(part),
    "discriminator": lambda part: _cleaned(part) or None,
    "mapping": lambda part: (
        {name: to for name, to in part.items() if _text(to)} if isinstance(part, dict) else None
    ),
}


def field_misfit(schema: str, path: Sequence[str], value: Any) -> str:
    """Return why the field at *path* (empty: the whole) can't be *value*; "" if it can.

    Schemas do not describe everything: a value that is not described passes.
    """
    shape, problem = PlainFormat(schema).shape, ""
    builder = _Builder(shape)
    try:
        for option in builder.field_schemas(shape, path):
            try:
                builder.fit(option, value, ".".join(path))
            except (BadData, RecursionError) as error:
                problem = str(error)
            else:
                return ""
    except BadData as error:
        return str(error)
    return problem


def knows_field(schema: str, path: Sequence[str]) -> bool:
    """Return whether data of a format may have a field at *path*."""
    shape = PlainFormat(schema).shape
    try:
        _Builder(shape).field_schemas(shape, path)
    except BadData:
        return False
    return True


class _Builder:
    """Builds data from a value and its schema, side by side. It skips unknown parts of a schema."""

    def __init__(self, schema: dict[str, Any]) -> None:
        self._definitions = schema.get("$defs", {})
        self._build_by_type: dict[str, Callable[[dict[str, Any], Any, str], Any]] = {
            "object": self._object,
            "array": self._array,
            "string": self._string,
            **dict.fromkeys(_PYTHON_TYPES, self._simple),
        }

    def _resolve(self, schema: Any) -> dict[str, Any]:
        for _ in range(100):  # bounded: references may form a cycle
            if not isinstance(schema, dict) or "$ref" not in schema:
                break
            schema = self._definitions.get(str(schema["$ref"]).rpartition("/")[2], {})
        return schema if isinstance(schema, dict) else {}

    def takes_fields(self, schema: Any) -> bool:
        schema = self._resolve(schema)
        if options := schema.get("anyOf"):
            return any(self.takes_fields(option) for option in options)
        return schema.get("type", "object") == "object" and "enum" not in schema

    def field_schemas(self, schema: Any, path: Sequence[str]) -> list[Any]:
        """Return the schemas that the field at *path* may have.

        Raises BadData for an unknown field.
        """
        found = self._options(schema)
        for depth, name in enumerate(path, 1):
            known = [key for option in found for key in option.get("properties", ())]
            found = [one for option in found for one in self._fields_named(option, name)]
            if not found:
                raise FieldMisfit(".".join(path[:depth]), f"is unknown: {_advice(name, known)}")
        return found

    def _options(self, schema: Any) -> list[dict[str, Any]]:
        schema = self._resolve(schema)
        return [self._resolve(option) for option in schema.get("anyOf", [schema])]

    def _fields_named(self, schema: dict[str, Any], name: str) -> list[Any]:
        if schema.get("type", "object") != "object" or "enum" in schema:
            return []
        additional = schema.get("additionalProperties", "properties" not in schema)
        field = schema.get("properties", {}).get(name, additional)
        return [] if field is False else self._options(field)

    def fit(self, schema: Any, value: Any, path: str) -> Any:
        """Return the data for *value*. Raises BadData if it does not fit."""
        if isinstance(value, Bare):
            return self._fit_bare(schema, value, path)
        schema = self._resolve(schema)
        if "anyOf" in schema:
            return self._union(schema, value, path)
        if "enum" in schema and not any(
            value == one and type(value) is type(one) for one in schema["enum"]
        ):
            raise self._unfit(schema, value, path)
        build = self._build_by_type.get(str(schema.get("type")))
        data = build(schema, value, path) if build else _without_bare(value)
        _check_bounds(schema, value, path)
        return data

    def _fit_bare(self, schema: Any, typed: Bare, path: str) -> Any:
        try:
            return self.fit(schema, typed.value, path)
        except BadData:
            if not isinstance(typed.value, str):
                with suppress(BadData):
                    return self.fit(schema, typed.text, path)
            raise

    def _union(self, schema: dict[str, Any], value: Any, path: str) -> Any:
        options = schema["anyOf"]
        tag = schema.get("discriminator", {})
        kind = value.get(tag.get("propertyName")) if isinstance(value, dict) else None
        kind = kind.value if isinstance(kind, Bare) else kind
        if isinstance(kind, str) and kind in tag.get("mapping", {}):
            return self.fit({"$ref": tag["mapping"][kind]}, value, path)
        errors = []
        for option in options:
            try:
                return self.fit(option, value, path)
            except BadData as error:
                errors.append((option, error))
        if isinstance(value, dict):  # an error in a field says more than "fits none"
            with_fields = [error for option, error in errors if self.takes_fields(option)]
            if len(with_fields) == 1:
                raise with_fields[0]
        raise self._unfit(schema, value, path)

    # --- one type each ----------------------------------------------------------------------------

    def _object(self, schema: dict[str, Any], value: Any, path: str) -> Any:
        fields = schema.get("properties", {})
        additional = schema.get("additionalProperties", "properties" not in schema)
        if not isinstance(value, dict):
            raise self._unfit(schema, value, path)
        for name in value if additional is False else ():
            if name not in fields:
                raise FieldMisfit(_field(path, name), f"is unknown: {_advice(name, list(fields))}")
        for name in schema.get("required", ()):
            if name not in value:
                raise FieldMisfit(
                    _field(path, name), f"is missing: it must be {self._wanted(fields.get(name))}"
                )
        names = schema.get("propertyNames", {})
        return {
            self._key(names, name, path): self.fit(
                fields.get(name, additional), one, _field(path, name)
            )
            for name, one in value.items()
        }

    def _key(self, schema: dict[str, Any], name: Any, path: str) -> Any:
        """Return a key of a mapping: JSON writes all keys as text."""
        is_text = schema.get("type", "string") == "string" and "enum" not in schema
        return self.fit(
            schema, name if is_text or not isinstance(name, str) else Bare(name), _field(path, name)
        )

    def _array(self, schema: dict[str, Any], value: Any, path: str) -> Any:
        if schema.get("format") == "numpy":
            raise FieldMisfit(
                path, "is a numpy array, which can't be written as text: send it from Python"
            )
        if not isinstance(value, list | tuple):
            raise self._unfit(schema, value, path)
        places, rest = schema.get("prefixItems", []), schema.get("items", {})
        return [
            self.fit(places[index] if index < len(places) else rest, one, f"{path}[{index}]")
            for index, one in enumerate(value)
        ]

    def _string(self, schema: dict[str, Any], value: Any, path: str) -> Any:
        if not isinstance(value, str):
            raise self._unfit(schema, value, path)
        if schema.get("contentEncoding") == "base64":
            try:
                return base64.b64decode(value, validate=True)
            except (binascii.Error, ValueError):
                raise FieldMisfit(path, f"must be bytes in base64, not {_shown(value)}") from None
        if kind := TEXT_FORMATS.get(schema.get("format", "")):
            try:
                msgspec.convert(value, kind)
            except msgspec.ValidationError:
                raise self._unfit(schema, value, path) from None
        return value

    def _simple(self, schema: dict[str, Any], value: Any, path: str) -> Any:
        kind = schema["type"]
        if not isinstance(value, _PYTHON_TYPES[kind]) or (
            isinstance(value, bool) and kind != "boolean"
        ):
            raise self._unfit(schema, value, path)
        try:
            return float(value) if kind == "number" else value
        except OverflowError:
            raise self._unfit(schema, value, path) from None

    # --- in words ---------------------------------------------------------------------------------

    def _unfit(self, schema: dict[str, Any], value: Any, path: str) -> FieldMisfit:
        return FieldMisfit(path, f"must be {self._wanted(schema)}, not {_shown(value)}")

    def _wanted(self, schema: Any) -> str:
        schema = self._resolve(schema)
        if "enum" in schema:
            return brief(schema)
        if "anyOf" in schema:
            return " or ".join(self._wanted(option) for option in schema["anyOf"])
        if fields := schema.get("properties"):
            return f"an object with {', '.join(fields)}"
        return _TYPE_WORDS.get(
            schema.get("format") or schema.get("type"), "a value of another type"
        )


def _without_bare(value: Any) -> Any:
    """Return data without a schema: typed text becomes JSON where possible."""
    if isinstance(value, dict):
        return {name: _without_bare(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_without_bare(one) for one in value]
    return value.value if isinstance(value, Bare) else value


def _check_bounds(schema: dict[str, Any], value: Any, path: str) -> None:
    for key, (holds, words) in _BOUNDS.items():
        if key not in schema:
            continue
        try:
            is_met = holds(value, schema[key])
        except (TypeError, re.error, ZeroDivisionError):  # any client may have sent the schema
            continue
        if not is_met:
            raise FieldMisfit(path, f"must {words.format(schema[key])}, not {_shown(value)}")


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def _field(path: str, name: str) -> str:
    return f"{path}.{name}" if path else str(name)


def _advice(name: str, known: list[str]) -> str:
    all_fields = f"the fields are {', '.join(known)}" if known else "there are no fields"
    return did_you_mean(name, known) or all_fields
