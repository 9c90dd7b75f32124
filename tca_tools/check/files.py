"""Properties from Python files: those of scenarios, too."""

from pathlib import Path
from typing import Any

import click

from tca_properties import BadProperty, Property, property_from
from tca_wire.user_file import CannotRun, names_of


def properties_in(path: Path) -> list[Property]:
    """The properties at the top level of a Python file: alone, in lists, in scenarios, or as texts in PROPERTIES."""
    try:
        names = names_of(path)
        found = [one for value in names.values() for one in _found(value)]
        texts = names.get("PROPERTIES")
        if isinstance(texts, list | tuple):
            found += [property_from(one) for one in texts if isinstance(one, str)]
    except CannotRun as error:
        raise click.UsageError(str(error)) from None
    except BadProperty as error:
        raise click.UsageError(f"{path}: {error}") from None
    if not found:
        raise click.UsageError(f"{path} has no property: put some at its top level, or texts into a list PROPERTIES")
    return found


def _found(value: Any) -> list[Property]:
    """The properties that a value is, or has."""
    if isinstance(value, Property):
        return [value]
    if isinstance(value, type):
        return []
    inside = getattr(value, "properties", value)
    return [one for one in inside if isinstance(one, Property)] if isinstance(inside, list | tuple) else []
