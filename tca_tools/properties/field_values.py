"""The conditions of properties on a message's data.

The grammar::

    FIELD=VALUE   FIELD may have dots for nested fields; VALUE is JSON, or a text
    data=VALUE    compares the whole data, unless they have a field "data"
"""

import json
import re
from collections.abc import Sequence
from typing import Any

from tca_tools.properties.world import BadProperty, MessageView
from tca_wire.text.bodies import plain_data
from tca_wire.text.plain_data import Bare, PlainFormat, field_misfit, knows_field

QUOTED = re.compile(r"""'[^']*'|"(?:[^"\\]|\\.)*\"""")
_WHOLE = ["data"]
_WITH = re.compile(r" with (?=[\w.]+ ?=)")
_NEXT = re.compile(r" ?, ?(?=[\w.]+ ?=)")
_PAIR = re.compile(r"([\w.]+) ?= ?(.*)", re.DOTALL)


class FieldValue:
    """The condition of a property on one field of a message's data."""

    def __init__(self, field: str, text: str) -> None:
        typed = Bare(unquoted(text))
        try:
            self.value = json.loads(text)
        except (ValueError, RecursionError):
            self.value = typed.value
        self._typed = self.value if isinstance(self.value, str) else typed
        self._values = [self.value, *([] if isinstance(self.value, str) else [typed.text])]
        self._field = field
        self._path = field.split(".")
        self._has_occurred = False
        """Whether a message had the field."""

    def __str__(self) -> str:
        return f"{self._field}={self.value!r}"

    def fits(self, message: MessageView) -> bool:
        """Whether a message's field has the value."""
        data = plain_data(message.body)
        if self._path == _WHOLE and not (isinstance(data, dict) and "data" in data):
            return self._is_equal(data)
        for part in self._path:
            if not isinstance(data, dict) or part not in data:
                return False
            data = data[part]
        self._has_occurred = True
        return self._is_equal(data)

    def _is_equal(self, data: Any) -> bool:
        if isinstance(data, dict) and data.keys() == {"base64"}:  # bytes
            data = data["base64"]
        return any(
            data == one and isinstance(data, bool) == isinstance(one, bool) for one in self._values
        )

    def misfit(self, schemas: Sequence[str]) -> str:
        """Return why no data of the given formats can fit; "" if some can."""
        problem = f"no message has a field '{self._field}'" if len(schemas) > 1 else ""
        for schema in schemas:
            is_whole = self._path == _WHOLE and not knows_field(schema, self._path)
            path = [] if is_whole else self._path
            is_known = knows_field(schema, path)
            # Data that central passes on may have more fields than the receiver declares
            if not is_known and self._has_occurred:
                return ""
            wrong = field_misfit(schema, path, self._typed)
            if not wrong:
                return ""
            if not is_known and not PlainFormat(schema).takes_fields:
                wrong += f"; to compare the whole, write data={self._typed!r}"
            problem = wrong if is_known else problem or wrong
        return problem


def split_data(text: str) -> tuple[str, list[FieldValue]]:
    """Split a predicate into its head and its conditions on data. Raises BadProperty."""
    text = in_one_line(text)
    found = [*_WITH.finditer(blanked(text))]
    if not found:
        return text, []
    place = found[0]
    head, tail = text[: place.start()], text[place.end() :]
    starts = [0, *(one.end() for one in _NEXT.finditer(blanked(tail)))]
    ends = [*(one.start() for one in _NEXT.finditer(blanked(tail))), len(tail)]
    return head, [_field_value(tail[start:end]) for start, end in zip(starts, ends, strict=True)]


def _field_value(text: str) -> FieldValue:
    pair = _PAIR.fullmatch(text)
    if pair is None or not pair[2]:
        raise BadProperty(f"'{text}' is not FIELD=VALUE")
    return FieldValue(pair[1], pair[2])


def in_one_line(text: str) -> str:
    """Return a text with single blanks, except in quotes."""
    quoted = QUOTED.findall(text)
    parts = [re.sub(r"\s+", " ", part) for part in QUOTED.split(text)]
    return "".join(part + quote for part, quote in zip(parts, [*quoted, ""], strict=True)).strip()


def blanked(text: str) -> str:
    """Return a text with its quoted parts blanked out, for searching."""
    return QUOTED.sub(lambda quoted: "_" * len(quoted.group()), text)


def unquoted(text: str) -> str:
    """Return a name or value without its quotes, if it has some."""
    text = text.strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"" else text
