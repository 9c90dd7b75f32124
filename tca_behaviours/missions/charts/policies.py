"""When a concurrence ends, and as what."""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

from tca_behaviours.missions.charts.user_data import OUTCOMES
from tca_module import MisuseError
from tca_module.checks import LABEL, check, check_function
from tca_wire.charts import StateKind

Until = Literal["any", "all", "all ended"] | Callable[[dict[str, str]], bool]
"""When a concurrence ends: "any", "all", "all ended", or a function of the endings so far."""
OutcomeMap = Mapping[str, Mapping[str, str]]
"""By outcome: the endings of states, by label, that make it the outcome."""

_KINDS = {"any": StateKind.ANY, "all": StateKind.ALL, "all ended": StateKind.ALL_ENDED}


class Policy(NamedTuple):
    """When a concurrence ends, and as what."""

    kind: StateKind
    until: Callable[[dict[str, str]], bool] | None = None
    """Returns whether the endings so far, by label, end the concurrence."""
    outcome_map: OutcomeMap = MappingProxyType({})
    default: str = ""
    """The outcome if no row of the map fits; "": the usual ending."""

    def ending(self, ended: dict[str, str], branches: int) -> str | None:
        """Return the ending of a concurrence; None if it continues.

        Args:
            ended: the endings of its states so far, by label, in their order.
            branches: the number of its states.
        """
        usual = next((ending for ending in ended.values() if ending != "completed"), "completed")
        is_over = (
            len(ended) == branches
            or self.kind is StateKind.ANY
            or (self.kind is StateKind.ALL and usual != "completed")
            or (self.until is not None and self.until(dict(ended)))
        )
        if not is_over:
            return None
        for outcome, row in self.outcome_map.items():
            if all(ended.get(label, "interrupted") == ending for label, ending in row.items()):
                return outcome
        return self.default or usual


def policy_of(until: Until, outcome_map: OutcomeMap | None, default: str) -> Policy:
    """Return the policy of these arguments. Raises MisuseError."""
    kind = StateKind.ALL_ENDED
    if isinstance(until, str) and until in _KINDS:
        kind = _KINDS[until]
    elif callable(until):
        check_function("a concurrence: until", until, "(endings)")
    else:
        raise MisuseError(
            "a concurrence: until must be 'any', 'all', 'all ended' or a function of the "
            f"endings, not {until!r:.60}"
        )
    rows = outcome_map or {}
    if not isinstance(rows, Mapping) or not all(
        LABEL.fits(outcome) and isinstance(row, Mapping) and row for outcome, row in rows.items()
    ):
        raise MisuseError(
            "a concurrence: outcome_map must have endings by label for each outcome, such as "
            f"{{'found': {{'Look': 'completed'}}}}, not {outcome_map!r:.60}"
        )
    if default:
        check("a concurrence", LABEL, default=default)
    return Policy(kind, until if callable(until) else None, rows, default)


def declared(outcomes: Iterable[str], policy: Policy | None = None) -> tuple[str, ...]:
    """Return the outcomes that a container declares. Raises MisuseError."""
    check("a container", OUTCOMES, outcomes=outcomes)
    implied = [*policy.outcome_map, policy.default] if policy is not None else []
    return tuple(filter(None, dict.fromkeys([*outcomes, *implied])))
