"""Random headers: every type of the protocol by its type hints, mostly with plausible fields.

A new header or field needs no change here. The type of a field defines its allowed values, the name
its plausible values.
"""

import types
from collections.abc import Callable, Mapping, Sequence
from enum import Enum, IntFlag
from functools import cache
from typing import Any, Literal, NewType, Union, get_args, get_origin, get_type_hints

import msgspec

from dev.fuzz.choices import Choices

INTEGERS = (
    0,
    -1,
    -2,
    1,
    2,
    1 << 31,
    -(1 << 31),
    (1 << 53) + 1,
    (1 << 63) - 1,
    -(1 << 63),
    (1 << 64) - 1,
)
FLOATS = (
    0.0,
    -0.0,
    -1.0,
    0.5,
    3.0,
    1e-300,
    1e300,
    3.2e8,
    3.3e8,
    float("nan"),
    float("inf"),
    float("-inf"),
)
TEXTS = (
    "",
    " ",
    "\x1b[2J\x1b]0;mine\x07",
    "two\nlines\r\n",
    "../../etc/passwd",
    "/abs",
    "a\x00b",
    "\u202etxt",
    "'quoted'",
    '"',
    "%s%n{0}{}",
    "<script>alert(1)</script>",
    "x" * 128,
    "x" * 129,
    "é" * 128,
    "\u2028",
    "tca: ",
    "central",
    "?",
    "{" * 50,
    '{"$ref":"#/$defs/a","$defs":{"a":{"$ref":"#/$defs/a"}}}',
    "[" * 600,
)
MOST_ITEMS = 4  # one more than a list may have
MOST_CHANGED = 4  # one more than the fields of a struct that may lose their default

Pools = Mapping[str, Callable[[], Sequence[Any]]]
"""The plausible values now, by the name of a field."""


class Grammar:
    """Creates values of types."""

    def __init__(self, choices: Choices, pools: Pools) -> None:
        self._choices = choices
        self._pools = pools

    def make(self, kind: Any, name: str = "") -> Any:
        """Return a value that fits a type hint, for a field of that name."""
        kind = get_args(kind)[0] if hasattr(kind, "__metadata__") else kind
        kind = kind.__supertype__ if isinstance(kind, NewType) else kind
        choices, origin = self._choices, get_origin(kind)
        if origin in (Union, types.UnionType):
            return self.make(choices.one_of(get_args(kind)), name)
        if origin is Literal:
            return choices.one_of(get_args(kind))
        if origin in (list, tuple):
            return self._items(kind, name)
        if issubclass(kind, msgspec.Struct):
            return self.header(kind)
        return self._field_value(kind, name)

    def _items(self, kind: Any, name: str) -> Any:
        collection, parts = get_origin(kind), get_args(kind)
        if collection is list or parts[-1] is Ellipsis:
            number = self._choices.below(MOST_ITEMS)
            return collection(self.make(parts[0], name) for _ in range(number))
        return tuple(self.make(part, name) for part in parts)

    def header(self, kind: type[msgspec.Struct]) -> Any:
        """Return a struct. Most fields with a default keep it."""
        hints, required = _fields(kind)
        made = {name: self.make(hint, name) for name, hint in hints[:required]}
        for _ in range(self._choices.below(MOST_CHANGED) if len(hints) > required else 0):
            name, hint = self._choices.one_of(hints[required:])
            made[name] = self.make(hint, name)
        return kind(**made)

    def _field_value(self, kind: type, name: str) -> Any:
        choices = self._choices
        if kind is bool:
            return choices.once_in(2)
        if kind is type(None):
            return None
        if issubclass(kind, IntFlag):
            return kind(choices.below(64))
        if issubclass(kind, Enum):
            return choices.one_of(list(kind))
        known = self._pools[name]() if name in self._pools and not choices.once_in(16) else ()
        if known and isinstance(known[0], kind):
            return choices.one_of(known)
        return self._any_value(kind)

    def _any_value(self, kind: type) -> Any:
        choices = self._choices
        if kind is int:
            return choices.below(8) if choices.once_in(2) else choices.one_of(INTEGERS)
        if kind is float:
            return float(choices.below(8)) if choices.once_in(2) else choices.one_of(FLOATS)
        if kind is str:
            return choices.one_of(TEXTS)
        assert kind is bytes, kind
        return choices.take(choices.below(12))


@cache
def _fields(kind: type[msgspec.Struct]) -> tuple[tuple[tuple[str, Any], ...], int]:
    """Return the fields of a struct with their hints, and the number of required fields."""
    hints = get_type_hints(kind, include_extras=True)
    fields = msgspec.structs.fields(kind)
    required = sum(field.required for field in fields)
    return tuple((field.name, hints[field.name]) for field in fields), required


def damaged(packet: bytes, choices: Choices) -> bytes:
    """Return a damaged packet: a byte is changed, or bytes are removed, inserted or cut off."""
    if not packet:
        return choices.take(8)
    at, kind = choices.below(min(len(packet), 1 << 16)), choices.below(4)
    if kind == 0:
        return packet[:at] + bytes([packet[at] ^ (1 << choices.below(8))]) + packet[at + 1 :]
    if kind == 1:
        return packet[:at] + choices.take(choices.below(8)) + packet[at + choices.below(8) :]
    if kind == 2:
        return packet[:at]
    return packet[:at] + packet[at : at + choices.below(64)] + packet[at:]
