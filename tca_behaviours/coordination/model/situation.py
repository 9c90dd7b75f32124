"""The situation that guards, costs and likelihoods read."""

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
    """The state of a run at one time, as guards, costs and likelihoods read it."""

    state: str = ""
    """The label of the current state."""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    """The facts that hold. A fact that an activity is changing is absent."""
    variables: Mapping[str, Any] = field(default_factory=dict)
    """The values of the watched variables, by name; None if a variable was never set."""
    progress: float = 0.0
    """The progress of the current activity, in [0, 1]."""

    def variable(self, variable: Variable[Any], default: Any = None) -> Any:
        """Return the value of a variable.

        Args:
            variable: the variable; it must be watched.
            default: the value if it was never set.

        Raises:
            MisuseError: the variable is not watched.
        """
        if variable.name not in self.variables:
            advice = f"add it to Coordination(..., watch=[...]): a function reads {variable.name!r}"
            raise MisuseError(f"{variable.title} is not watched: {advice}")
        value = self.variables[variable.name]
        return default if value is None else value

    def confidence(self, variable: Variable[Any]) -> float | None:
        """Return the value of a variable as a number in [0, 1].

        Args:
            variable: the variable; it must be watched.

        Returns:
            The number; None if the variable was never set.

        Raises:
            MisuseError: the variable is not watched.
        """
        value = self.variable(variable)
        return None if value is None or isnan(value) else min(max(float(value), 0.0), 1.0)


def check_confidence(variable: Variable[Any], subject: str) -> None:
    """Raise MisuseError if a variable holds neither a number nor a bool."""
    if json.loads(variable.data.schema or "{}").get("type") not in ("boolean", "integer", "number"):
        raise MisuseError(
            f"{subject} needs a variable of bool or float: {variable.title} holds {variable.data}"
        )
