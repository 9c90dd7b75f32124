"""Checks of a scenario's arguments where users write them, after the module library's: with a ScenarioError."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any

from tca_module import checks
from tca_module.errors import MisuseError
from tca_tools.explore.errors import ScenarioError


@contextmanager
def as_scenario_error(what: str = "") -> Iterator[None]:
    """Raise the library's complaint of an argument as a ScenarioError about *what*."""
    try:
        yield
    except MisuseError as error:
        raise ScenarioError(f"{what}: {error}" if what else str(error)) from None


def check(call: str, kind: checks.ArgumentKind, **values: Any) -> None:
    """Raise ScenarioError for the first of these named values that is of another kind."""
    with as_scenario_error():
        checks.check(call, kind, **values)


def nearest(name: str, known: Collection[str]) -> str:
    """The names that somebody may have meant, for the end of a message."""
    near = ", ".join(f"'{one}'" for one in get_close_matches(name, sorted(known)))
    return f"did you mean {near}?" if near else f"there are {', '.join(map(repr, sorted(known))) or 'none'}"
