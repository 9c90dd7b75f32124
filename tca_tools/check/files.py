"""Properties from Python files: those of the explorer as they are, and those made here."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from tca_tools.check.errors import BadProperty
from tca_tools.check.language import property_from
from tca_tools.check.properties import Property, never_stuck, words_of
from tca_tools.check.records import Item
from tca_tools.check.world import World
from tca_wire.user_file import CannotRun, names_of


class Foreign(Property):
    """A property of the explorer (tca_explorer.Property), asked of a journal: it remembers a number."""

    def __init__(self, stated: Any) -> None:
        super().__init__(words_of(stated))
        self._stated = stated
        self._memory = 0

    def after(self, world: World, changed: Iterable[Item]) -> str:
        """After an event: what is wrong."""
        del changed
        self.had_case = self.had_case or bool(self._stated.has_case(world))
        self._memory, wrong = self._stated.seen(world, self._memory)
        if not wrong:
            return ""
        found = self._stated.predicates[-1](world) if self._stated.predicates else ()
        if not (world.is_whole or (isinstance(found, list | tuple) and self._stated.is_certain)):
            return ""
        items = [one for one in (found if isinstance(found, list | tuple) else ()) if hasattr(one, "id")]
        self.blame(items, max((one.id for one in items), default=0) if self._stated.counts else 0)
        return str(wrong)

    @property
    def vacuous(self) -> str:
        """Why it says nothing that it holds."""
        return "" if self.had_case else f"in this run there never was '{self._stated.case}'"

    def at_end(self, world: World) -> str:
        """When the journal is read: what is wrong. Of what was to be within some time, that may not be over."""
        is_owed = world.is_whole and self._stated.is_owed(self._memory)
        return "it never did" if is_owed and not self._memory else ""


def properties_in(path: Path) -> list[Property]:
    """The properties at the top level of a Python file: alone, in lists, in scenarios, or as texts in PROPERTIES."""
    try:
        names = names_of(path)
        found = [one for value in names.values() for one in _found(value)]
        texts = names.get("PROPERTIES")
        found += (
            [property_from(one) for one in texts if isinstance(one, str)] if isinstance(texts, list | tuple) else []
        )
    except CannotRun as error:
        raise click.UsageError(str(error)) from None
    except BadProperty as error:
        raise click.UsageError(f"{path}: {error}") from None
    if not found:
        raise click.UsageError(f"{path} has no property: put some at its top level, or texts into a list PROPERTIES")
    return found


def _found(value: Any) -> list[Property]:
    if isinstance(value, Property):
        return [value]
    if isinstance(value, type):
        return []
    if callable(getattr(value, "seen", None)) and callable(getattr(value, "is_owed", None)):
        return [never_stuck() if words_of(value) == str(never_stuck()) else Foreign(value)]
    inside = getattr(value, "properties", value)
    if isinstance(inside, list | tuple):
        return [one for item in inside if not isinstance(item, list | tuple) for one in _found(item)]
    return []
