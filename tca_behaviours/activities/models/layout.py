"""Python as formatters lay it out, whatever their longest line is: short statements on one line, others opened up."""

import json
from collections.abc import Iterable
from math import isfinite

_LONGEST = 88


def call(indent: int, head: str, arguments: Iterable[str], tail: str = ")") -> list[str]:
    """A statement whose *head* ends with a bracket."""
    arguments, space = list(arguments), " " * indent
    return _laid_out(f"{space}{head}{', '.join(arguments)}{tail}", space, head, arguments, tail)


def imported(module: str, names: Iterable[str]) -> list[str]:
    """An import of names."""
    names = sorted(set(names), key=lambda name: (not name.isupper(), name.lower()))
    line = f"from {module} import {', '.join(names)}"
    return _laid_out(line, "", f"from {module} import (", names, ")") if names else []


def _laid_out(line: str, space: str, head: str, parts: list[str], tail: str) -> list[str]:
    """The line; or where it is too long, *head*, a line for each part, and *tail*."""
    if len(line) <= _LONGEST:
        return [line]
    return [f"{space}{head}", *(f"{space}    {part}," for part in parts), f"{space}{tail}"]


def literal(value: object) -> str:
    """A value as Python's source."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value) if not isinstance(value, float) or isfinite(value) else f'float("{value}")'
