"""Readers of foreign files and data: journals, user data and formats.

Unreadable input must raise JournalDamaged or BadData, never another exception. The text that tools
show of readable input must not control a terminal.
"""

import io
import json
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from dev.fuzz.choices import Choices
from dev.fuzz.grammar import Grammar, damaged
from tca_tools.journal.fold import History
from tca_wire.errors import BadData, JournalDamaged
from tca_wire.journal.causes import Cause
from tca_wire.journal.facts import JOURNAL_VERSION, Entry, Fact, Opened
from tca_wire.journal.records import JournalReader, record
from tca_wire.messages.fitting import first_misfit
from tca_wire.messages.formats import Format, decode_untyped, first_difference
from tca_wire.text.bodies import data_text, plain_data
from tca_wire.text.plain_data import PlainFormat, field_misfit, knows_field

MOST_RECORDS = 40
_OPENED = record(Entry(0, 0.0, [Opened(JOURNAL_VERSION, "test", 0, 0.0, "fuzz")]))
_FACTS = Fact.__args__
_CAUSES = Cause.__args__


def _segment(data: bytes) -> bytes:
    """Return a segment of records with any facts; some are damaged."""
    choices = Choices(data)
    grammar = Grammar(
        choices,
        {"number": lambda: range(1, 9), "id": lambda: range(1, 9), "task": lambda: range(9)},
    )
    parts = [_OPENED]
    while not choices.is_over and len(parts) < MOST_RECORDS:
        kind = choices.below(12)
        facts = [grammar.header(choices.one_of(_FACTS)) for _ in range(1 + choices.below(2))]
        entry = Entry(len(parts), len(parts) / 4, facts, grammar.header(choices.one_of(_CAUSES)))
        whole = record(entry)
        if kind == 0:
            parts.append(damaged(whole, choices))
        else:
            parts.append(choices.take(30) if kind == 1 else whole)
    if choices.once_in(8):
        parts[0] = damaged(parts[0], choices)
    return b"".join(parts)


def _read(segment: bytes) -> list[Entry]:
    stream, found = io.BytesIO(segment), []
    reader = JournalReader(stream)
    try:
        for entry in reader:
            found.append(entry)
            assert reader.offset < len(segment), "read beyond the end"
    except JournalDamaged:
        pass
    return found


def attack_journal(data: bytes) -> None:
    """Read a foreign or damaged segment twice, and fold it as the tools do."""
    segment, history = _segment(data), History()
    entries = _read(segment)
    again = _read(segment)
    assert list(map(record, entries)) == list(map(record, again)), (
        "a segment reads differently the second time"
    )
    for entry in entries:
        history.apply(entry)
    history.extend_to(None)


def attack_journal_with_bytes(data: bytes) -> None:
    """Read a segment of any bytes."""
    _read(data)


def seeds_of_journals() -> list[bytes]:
    """Return undamaged segments."""
    return [_segment(bytes(range(start, start + 120))) for start in (0, 60, 120)]


# --- data and formats -----------------------------------------------------------------------------


@dataclass
class _Leg:
    number: int
    joints: list[float]
    name: str | None = None


_KINDS: tuple[Any, ...] = (
    int,
    float,
    str,
    bytes,
    _Leg,
    list[_Leg],
    dict[str, int],
    _Leg | None,
    Any,
)
_FORMATS: tuple[Format[Any], ...] = tuple(map(Format, _KINDS))


def attack_data(data: bytes) -> None:
    """Decode data of a type that was not declared."""
    for one in _FORMATS:
        with suppress(BadData):
            one.encode(one.decode(data))
    with suppress(BadData):
        decode_untyped(data)
    json.dumps(plain_data(data), allow_nan=False)
    assert data_text(data).isprintable(), "data control a terminal"


def seeds_of_data() -> list[bytes]:
    """Return data of several types."""
    values: tuple[Any, ...] = (
        7,
        0.5,
        "leg",
        b"\x00",
        _Leg(1, [0.5]),
        [_Leg(2, [], "left")],
        {"a": 1},
        None,
        [[{}]],
    )
    return [_FORMATS[-1].encode(value) for value in values]


_KEYS = (
    "type",
    "properties",
    "required",
    "items",
    "prefixItems",
    "anyOf",
    "enum",
    "$ref",
    "$defs",
    "additionalProperties",
    "minimum",
    "maxItems",
    "minLength",
    "format",
    "contentEncoding",
    "discriminator",
    "propertyName",
    "mapping",
    "a",
    "b",
)
_VALUES = (
    "object",
    "array",
    "string",
    "integer",
    "number",
    "null",
    "date-time",
    "base64",
    "a",
    "b",
    "#/$defs/a",
    "#/$defs/b",
    0,
    -1,
    1e400,
    None,
    True,
    False,
    "",
    "\ud800",
)
_DEEPEST = 6


def _json(choices: Choices, depth: int = 0) -> Any:
    """Return a value like a JSON Schema."""
    kind = choices.below(8) if depth < _DEEPEST else 7
    if kind < 5:
        return {choices.one_of(_KEYS): _json(choices, depth + 1) for _ in range(choices.below(5))}
    if kind < 7:
        return [_json(choices, depth + 1) for _ in range(choices.below(4))]
    return choices.one_of(_VALUES)


def _schema(choices: Choices) -> str:
    schema = _json(choices)
    if choices.once_in(2) and isinstance(schema, dict):
        schema["$defs"] = {"a": _json(choices), "b": _json(choices)}
    text = json.dumps(schema)
    return text[: choices.below(200)] if choices.once_in(16) else text


def attack_formats(data: bytes) -> None:
    """Compare and use formats that others declared."""
    choices = Choices(data)
    one, other = _schema(choices), _schema(choices)
    for difference in (first_difference, first_misfit):
        assert isinstance(difference(one, other), str | None)
        assert difference(one, one) is None, "a format differs from itself"
    plain = PlainFormat(one)
    assert isinstance(str(plain), str)
    assert isinstance(plain.takes_fields, bool)
    for value in ({"a": 1, "b": [0.5]}, [1, "a"], "a", 1, None):
        with suppress(BadData):
            plain.encode(value)
        assert isinstance(field_misfit(one, ["a"], value), str)
    assert isinstance(knows_field(one, ["a", "b"]), bool)
