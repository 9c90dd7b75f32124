"""TOML files of the user: each key is checked, and an error names the key and the remedy."""

import json
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec

from tca_tools.errors import BadUserFile
from tca_wire.text.nearest import nearest_or_all

_LONGEST_SHOWN = 60


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a file. Raises BadUserFile."""
    try:
        return tomllib.loads(path.read_text())
    except OSError as error:
        raise BadUserFile(f"{path} can't be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadUserFile(f"{path}: {error}") from None


_T = TypeVar("_T", bound=msgspec.Struct)


def read_table(
    kind: type[_T], place: str, given: Any, defaults: dict[str, Any] | None = None
) -> _T:
    """Check a table of the file, with the tables inside it, and convert it.

    Args:
        kind: the struct to convert it to; the type of each field has a description for errors.
        place: the path of the table in the file, as in "modules.legs".
        given: the content of the table.
        defaults: values for missing keys.

    Raises:
        BadUserFile: the table is wrong.
    """
    check_table(place, given)
    given = {**(defaults or {}), **given}
    _check_table(kind, place, given)
    return msgspec.convert(given, kind)


def _check_table(kind: type[msgspec.Struct], place: str, given: Any) -> None:
    check_table(place, given)
    check_keys(kind, place, given)
    for field in msgspec.structs.fields(kind):
        if field.required and field.encode_name not in given:
            raise BadUserFile(f"{place}.{field.encode_name} is missing: add {_description(field)}")


def check_table(place: str, given: Any) -> None:
    """Check that a value is a table. Raises BadUserFile."""
    if not isinstance(given, dict):
        raise BadUserFile(f"{place} must be a table: write [{place}]")


def check_keys(kind: type[msgspec.Struct], place: str, given: dict[str, Any]) -> None:
    """Check that each key is known and has a valid value. Raises BadUserFile."""
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    for key, value in given.items():
        if key not in fields:
            raise BadUserFile(f"{place}.{key} is unknown: {nearest_or_all(key, fields)}")
        for name, row in _tables_in(value):
            if inner := _kind_inside(fields[key]):
                _check_table(inner, f"{place}.{key}.{name}", row)
        try:
            msgspec.convert(value, fields[key].type)
        except msgspec.ValidationError:
            raise BadUserFile(
                f"{place}.{key} must be {_description(fields[key])}, not {shown(value)}"
            ) from None


def _kind_inside(field: msgspec.structs.FieldInfo) -> type[msgspec.Struct] | None:
    """Return the struct of a field's tables, by name or in a list; None if it has no tables."""
    inner = get_args(get_args(field.type)[0])[-1:]
    return next(
        (kind for kind in inner if isinstance(kind, type) and issubclass(kind, msgspec.Struct)),
        None,
    )


def _tables_in(value: Any) -> Iterable[tuple[Any, Any]]:
    """Return tables by name; a table in a list has its own name, or its number."""
    if isinstance(value, list):
        return [
            (row.get("name", number), row)
            for number, row in enumerate(value, 1)
            if isinstance(row, dict)
        ]
    return value.items() if isinstance(value, dict) else ()


def shown(value: Any) -> str:
    """Return a value of the file as text, for an error."""
    return json.dumps(value, ensure_ascii=False, default=str)[:_LONGEST_SHOWN]


def _description(field: msgspec.structs.FieldInfo) -> str:
    (meta,) = field.type.__metadata__
    return str(meta.description)


def check_known(place: str, what: str, name: str, known: Iterable[str]) -> None:
    """Check that a name is known. Raises BadUserFile."""
    if name not in known:
        raise BadUserFile(f"{place}: {what} '{name}' is unknown: {nearest_or_all(name, known)}")
