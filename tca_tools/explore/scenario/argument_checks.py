"""Checks of a scenario's arguments: the module library's, which raise ScenarioError here."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tca_module import checks
from tca_module.errors import MisuseError
from tca_tools.explore.errors import ScenarioError


@contextmanager
def as_scenario_error(subject: str = "") -> Iterator[None]:
    """Convert the library's MisuseError into a ScenarioError about *subject*."""
    try:
        yield
    except MisuseError as error:
        raise ScenarioError(f"{subject}: {error}" if subject else str(error)) from None


def check(call: str, kind: checks.ArgumentKind, **values: Any) -> None:
    """Raise ScenarioError for the first of the named values that is not of this kind."""
    with as_scenario_error():
        checks.check(call, kind, **values)
