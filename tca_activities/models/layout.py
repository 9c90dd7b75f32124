"""Python as formatters lay it out, whatever their longest line is: short statements on one line, others opened up."""

import json
from collections.abc import Iterable, Iterator
from math import isfinite

_LONGEST = 88


def call(indent: int, head: str, arguments: Iterable[str], tail: str = ")") -> Iterator[str]:
    """A statement whose *head* ends with a bracket."""
    arguments = list(arguments)
    space = " " * indent
    line = f"{space}{head}{', '.join(arguments)}{tail}"
    if len(line) <= _LONGEST:
        yield line
        return
    yield f"{space}{head}"
    yield from (f"{space}    {argument}," for argument in arguments)
    yield f"{space}{tail}"


def imported(module: str, names: Iterable[str]) -> Iterator[str]:
    """An import of names."""
    names = sorted(set(names), key=lambda name: (not name.isupper(), name.lower()))
    if not names:
        return
    line = f"from {module} import {', '.join(names)}"
    if len(line) <= _LONGEST:
        yield line
        return
    yield f"from {module} import ("
    yield from (f"    {name}," for name in names)
    yield ")"


def literal(value: object) -> str:
    """A value as Python's source."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value) if not isinstance(value, float) or isfinite(value) else f'float("{value}")'
