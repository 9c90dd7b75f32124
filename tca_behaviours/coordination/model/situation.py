"""What guards, costs and likelihoods may look at."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isnan
from typing import Any

from tca_module import MisuseError, Variable

Fact = str | bool | int | float
"""The value of a fact."""


@dataclass(frozen=True, eq=False)
class Situation:
    """How things are at one moment of a run."""

    state: str = ""
    """The label of the current state."""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """What is known to hold. A fact that an activity is changing just now is absent."""
    variables: Mapping[str, Any] = field(default_factory=dict)
    """By name, all those that are watched; the value of one that was never set is None."""
    progress: float = 0.0
    """Of the current activity, in [0, 1]."""

    def variable(self, variable: Variable[Any], default: Any = None) -> Any:
        """The value of a variable; the default if it was never set. Raises MisuseError if it is not
        watched.
        """
        if variable.name not in self.variables:
            advice = f"give Coordination(..., watch=[...]) the variables that functions read, {variable.name!r} too"
            raise MisuseError(f"{variable.title} is not watched: {advice}")
        value = self.variables[variable.name]
        return default if value is None else value

    def confidence(self, variable: Variable[Any]) -> float | None:
        """The value of a variable as a number in [0, 1]; None if it was never set."""
        value = self.variable(variable)
        return None if value is None or isnan(value) else min(max(float(value), 0.0), 1.0)


def check_confidence(variable: Variable[Any], what: str) -> None:
    """Raises MisuseError if a variable holds no number and no bool."""
    if json.loads(variable.data.schema or "{}").get("type") not in ("boolean", "integer", "number"):
        raise MisuseError(
            f"{what} wants a variable of bool or float: {variable.title} holds {variable.data}"
        )
