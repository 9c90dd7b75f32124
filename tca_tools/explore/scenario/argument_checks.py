"""Checks of a scenario's arguments where users write them, after the module library's: with a
ScenarioError.
"""

from collections.abc import Iterator
from contextlib import contextmanager
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
