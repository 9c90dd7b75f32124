"""The generated parts about records: the facts of the journal, and the tables of exports."""

import re
from typing import get_args

import msgspec

from dev.site.markdown import code, sentence, table
from dev.site.sources import fields
from tca_tools.export.tables import TABLES, ColumnType
from tca_wire.journal.causes import Cause
from tca_wire.journal.facts import Entry, Fact, kind_of

TYPES = {
    ColumnType.TEXT: "text",
    ColumnType.INTEGER: "integer",
    ColumnType.SECONDS: "seconds",
    ColumnType.FLAG: "true or false",
    ColumnType.JSON: "JSON",
}
NAMES = re.compile(r"\b(?:[a-z_]+\.)+(?=[A-Za-z])")


def facts() -> str:
    """Return the entry, its causes and all facts, with their fields."""
    parts = ["## Entries and causes\n", _struct("entry", Entry)]
    parts += [_struct(f"cause: {_tag(one)}", one) for one in get_args(Cause)]
    parts += ["## Facts\n", *(_struct(kind_of(one), one) for one in get_args(Fact))]
    return "\n".join(parts)


def _tag(kind: type[msgspec.Struct]) -> str:
    return str(kind.__struct_config__.tag)


def _struct(title: str, kind: type[msgspec.Struct]) -> str:
    texts = fields(kind)
    found = {one.name: code(_type(one)) for one in msgspec.structs.fields(kind)}
    heading = f"### {title}\n\n{sentence(kind.__doc__ or '')}\n\n"
    if not any(texts.get(name) for name in found):
        listed = [f"{code(name)} ({kind})" for name, kind in found.items()]
        return f"{heading}Fields: {', '.join(listed)}\n" if listed else f"{heading}No fields.\n"
    rows = [(code(name), kind, sentence(texts.get(name, ""))) for name, kind in found.items()]
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
