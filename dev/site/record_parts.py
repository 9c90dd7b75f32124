"""The generated parts about records: the facts of the journal, and the tables of exports."""

import inspect
import re
from collections.abc import Iterator
from enum import Enum
from typing import get_args

import msgspec

from dev.site.markdown import code, sentence, table
from dev.site.python_parts import OLDER_NAMES
from dev.site.sources import fields
from tca_tools.export.tables import TABLES, ColumnType
from tca_wire.journal.causes import Cause
from tca_wire.journal.facts import Entry, Fact, kind_of
from tca_wire.points import MOMENTS, describe_moments

TYPES = {
    ColumnType.TEXT: "text",
    ColumnType.INTEGER: "integer",
    ColumnType.SECONDS: "seconds",
    ColumnType.FLAG: "true or false",
    ColumnType.JSON: "JSON",
}
NAMES = re.compile(r"\b(?:[a-z_]+\.)+(?=[A-Za-z])")
MEMBER = re.compile(
    r"^ +(?P<name>[A-Z_]+) = [^#\n]+?(?:  # (?P<remark>.+))?$",
    re.MULTILINE,
)
"""A member of an enumeration, with the comment behind it."""
ATTRIBUTE = re.compile(r"^ +(?P<name>[A-Z_]+): (?P<text>.+)$", re.MULTILINE)
"""A member of an enumeration in its docstring."""
MEANINGS = {
    "at": "The task to which it was attached",
    "attachment": "The number of the attached exception handler",
    "blocking": "Whether the sender waits",
    "body": "The bytes of the data",
    "by": "The party or module that caused it",
    "constraints": "The constraints of the task",
    "copy_of": "The message, if only one receiver's copy was dropped (0: none)",
    "data": "The format of the data, as JSON Schema",
    "dropping": "The reason, for programs",
    "due": "The kind of the timer",
    "failure": "The failure's name",
    "handler": "The task of the exception handler",
    "id": "The number of the message or delivery",
    "leader": "The process that leads",
    "message": "The message's name",
    "message_class": "The message's class",
    "message_id": "The number of the message",
    "module": "The module's name",
    "origin": "The delivery whose handler sent it (0: none)",
    "outcome": "How the handling ended",
    "parent": "The task above it",
    "priority": "The priority in the queue",
    "process": 'The process, as "host:pid"',
    "reply": "The format of the reply, as JSON Schema",
    "resource": "The resource's name",
    "role": "The reason why central made the message",
    "sender": "The sending module's name",
    "standbys": "The processes that follow",
    "state": "The state after it",
    "task": "The task",
    "transition": "The transition's name",
    "why": "The reason, for display",
}
"""The meanings of fields that have no docstring."""
TYPES_OF_FIELDS = {
    "TaskId": "the number of a task, or 0 for the root.",
    "Point": "an array of a task's number and a moment.",
    "Constraint": "an array of two points and a delay in seconds. The second point is reached no "
    "earlier than this delay after the first. From a point of the root, it counts from time 0.",
    "moment": "an integer: "
    + ", ".join(f"{int(one)} {describe_moments(one)[0]}" for one in MOMENTS)
    + ". The field *moments* has their sum.",
}


def facts() -> str:
    """Return the entry, its causes and all facts, with their fields."""
    parts = ["## Entries and causes\n", _struct("entry", Entry)]
    parts += [_struct(f"cause: {_tag(one)}", one) for one in get_args(Cause)]
    parts += ["## Facts\n", *(_struct(kind_of(one), one) for one in get_args(Fact))]
    types = [f"- {code(name)}: {meaning}\n" for name, meaning in TYPES_OF_FIELDS.items()]
    parts += ["## Types\n", "".join(types)]
    parts += [_enumeration(one) for one in _enumerations()]
    return "\n".join(parts)


def _enumerations() -> list[type[Enum]]:
    """Return the enumerations among the types of fields, by name."""
    found = {
        one.type
        for kind in (*get_args(Cause), *get_args(Fact))
        for one in msgspec.structs.fields(kind)
        if inspect.isclass(one.type) and issubclass(one.type, Enum)
    }
    return sorted(found, key=lambda one: one.__name__)


def _enumeration(kind: type[Enum]) -> str:
    """Return an enumeration with its values."""
    first, _, rest = (inspect.getdoc(kind) or "").partition("\n\n")
    heading = f"### {kind.__name__}\n\n{sentence(OLDER_NAMES.sub('', first))}\n\n"
    rows = list(_members(kind, f"{rest}\n"))
    if all(meaning for _, meaning in rows):
        return heading + table(("value", "meaning"), rows)
    return f"{heading}Values: {', '.join(value for value, _ in rows)}.\n"


def _members(kind: type[Enum], described: str) -> Iterator[tuple[str, str]]:
    """Yield the values of an enumeration with their meanings, from docstring or comments."""
    texts = {one["name"]: one["text"] for one in ATTRIBUTE.finditer(described)}
    remarks = {one["name"]: one["remark"] for one in MEMBER.finditer(inspect.getsource(kind))}
    for name, one in kind.__members__.items():
        meaning = texts.get(name) or remarks.get(name) or ""
        yield code(one.value) or '`""`', sentence(meaning)


def _tag(kind: type[msgspec.Struct]) -> str:
    return str(kind.__struct_config__.tag)


def _struct(title: str, kind: type[msgspec.Struct]) -> str:
    texts = fields(kind)
    found = {one.name: code(_type(one)) for one in msgspec.structs.fields(kind)}
    heading = f"### {title}\n\n{sentence(kind.__doc__ or '')}\n\n"
    if not any(texts.get(name) for name in found):
        listed = [f"{code(name)} ({kind})" for name, kind in found.items()]
        return f"{heading}Fields: {', '.join(listed)}\n" if listed else f"{heading}No fields.\n"
    rows = [
        (code(name), kind, sentence(texts.get(name) or MEANINGS[name]))
        for name, kind in found.items()
    ]
    return heading + table(("field", "type", "meaning"), rows)


def _type(field: msgspec.structs.FieldInfo) -> str:
    hint = field.type
    while hasattr(hint, "__metadata__"):
        hint = hint.__origin__
    if get_args(hint) == (Fact,):
        return "list[Fact]"
    text = getattr(hint, "__name__", str(hint)) if isinstance(hint, type) else str(hint)
    return NAMES.sub("", text)


def export_tables() -> str:
    """Return the tables of exports, with their columns."""
    return "\n".join(
        f"### {one.name}\n\n{one.meaning}\n\n"
        + table(
            ("column", "type", "meaning"),
            [
                (code(name), TYPES[kind], sentence(one.meanings[name]))
                for name, kind in one.columns.items()
            ],
        )
        for one in TABLES
    )
