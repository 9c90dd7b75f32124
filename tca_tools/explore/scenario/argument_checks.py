"""Checks of a scenario's arguments where users write them: each ScenarioError says what, which and what fits."""

from collections.abc import Collection
from difflib import get_close_matches
from typing import Any

from tca_tools.explore.errors import ScenarioError

MOST = 64
"""Slots of a resource, as in the module library."""


def checked_number(number: Any, what: str, *, least: int, most: int | None = None) -> int:
    """*number*, if it is a whole one in that range. Raises ScenarioError."""
    is_number = isinstance(number, int) and not isinstance(number, bool)
    if not is_number or not least <= number <= (number if most is None else most):
        fits = f"{least} to {most}" if most is not None else f"{least} or more"
        raise ScenarioError(f"{what} can't be {number!r:.60}: {fits}, a whole number")
    return int(number)


def checked_name(name: Any, what: str) -> str:
    """*name*, if something may be called so. Raises ScenarioError."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise ScenarioError(f"{name!r:.60} is no name of {what}: give printable characters")
    return name


def name_or_none(name: Any, what: str) -> str:
    """The value of an option that is a name; None is "". Raises ScenarioError for what is none, an empty one, too."""
    if name is None:
        return ""
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise ScenarioError(f"{what} can't be {name!r:.60}: give a name, or None")
    return name


def nearest(name: str, known: Collection[str]) -> str:
    """The names that somebody may have meant, for the end of a message."""
    near = ", ".join(f"'{one}'" for one in get_close_matches(name, sorted(known)))
    return f"did you mean {near}?" if near else f"there are {', '.join(map(repr, sorted(known))) or 'none'}"


def checked_flag(flag: Any, what: str) -> bool:
    """*flag*, if it says yes or no. Raises ScenarioError."""
    if not isinstance(flag, bool):
        raise ScenarioError(f"{what} can't be {flag!r:.60}: True or False")
    return flag
