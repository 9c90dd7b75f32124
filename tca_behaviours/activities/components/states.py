"""The states of a region, and the transitions between them, as they are written."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from tca_behaviours.statecharts.states import Arrow, State, Step, name_of
from tca_module import MisuseError
from tca_wire.charts import ChartArrow, StateKind
from tca_wire.text.measures import duration


def every(period: float, estimate: float | None) -> str:
    """How often something is ticked, and how long that takes, in words."""
    return f"every {duration(period)}" + (f", takes {duration(estimate)}" if estimate else "")


class RegionState(State["RegionState", "RegionTransition"]):
    """A state of a region: a leaf, or one that holds others, the first of which is entered with
    it.
    """

    def __init__(self, label: str, parent: "RegionState | None") -> None:
        super().__init__(StateKind.WAIT, label, parent)
        self.beside: dict[str, RegionState] = parent.beside if parent is not None else {}
        """All states of its region, by their names."""
        self.region: str = parent.region if parent is not None else label
        self.activity: Step | None = None
        self.period = 0.0
        self.estimate: float | None = None

    def __repr__(self) -> str:
        return f"'{self.region}.{self.label}'"

    def lines(self) -> Iterator[str]:
        """What it does, a line for each function."""
        if self.activity is not None:
            yield f"{name_of(self.activity)} {every(self.period, self.estimate)}"
        if self.entry is not None:
            yield f"entry: {name_of(self.entry)}"
        if self.exit is not None:
            yield f"exit: {name_of(self.exit)}"

    def chart_arrows(self) -> Iterator[ChartArrow]:
        """The transitions that lead out of it, as data: a line for the event, and for each
        condition.
        """
        for arrow in self.arrows:
            conditions = ",\n".join(arrow.conditions)
            symbol = "\n".join(filter(None, [arrow.event, conditions and f"[{conditions}]"]))
            yield ChartArrow(self.number, arrow.target.number, symbol)

    def state(
        self,
        name: str,
        *,
        entry: Step | None = None,
        exit: Step | None = None,  # noqa: A002 - the word of statecharts
        activity: Step | None = None,
        period: float | None = None,
        estimate: float | None = None,
    ) -> "RegionState":
        """A state inside it; the first one is entered first. Its *activity* is ticked while it is
        active, once a *period*, and takes *estimate* seconds at most. *entry* and *exit* are called
        when it is entered and left.
        """
        if name in self.beside:
            raise MisuseError(
                f"'{self.region}' has two states '{name}': give one of them another name"
            )
        if name == "machine" or not name:
            raise MisuseError(f"'{self.region}': a state can't be called '{name}'")
        state = RegionState(name, self)
        if activity is not None and not (period or 0) > 0:
            raise MisuseError(f"the activity of {state!r} needs a period: add one, in seconds")
        self.beside[name] = state
        self.kind = StateKind.COMPOUND
        state.kind = StateKind.ACTIVITY if activity is not None else StateKind.WAIT
        state.entry, state.exit, state.activity = entry, exit, activity
        state.period, state.estimate = period or 0.0, estimate
        return state

    def to(
        self,
        target: "RegionState",
        *,
        on: str = "",
        when: Callable[[], bool] | None = None,
        needs: Iterable[str] = (),
    ) -> None:
        """A transition: by the event *on*, or without one, as soon as it may be made. It may be
        made when the guard *when* returns true and the states that it *needs*, such as
        "enabling.enabled", are active.
        """
        if self.beside.get(target.label) is not target:
            raise MisuseError(
                f"{self!r} can't lead to {target!r}, in another region: let a transition there need {self!r}"
            )
        needs = [needs] if isinstance(needs, str) else list(needs)
        if not (on or when or needs):
            raise MisuseError(f"{self!r} would go to {target!r} at once: add on, when or needs")
        self.add_arrow(RegionTransition(self, target, on, when, needs))


class RegionTransition(Arrow[RegionState]):
    """A transition from one state of a region to another."""

    def __init__(
        self,
        source: RegionState,
        target: RegionState,
        event: str,
        when: Callable[[], bool] | None,
        needs: list[str],
    ) -> None:
        guard = [name_of(when)] if when is not None else []
        super().__init__(source, target, event, (*guard, *needs))
        self.target = target
        self.when = when
        self.needs = needs
        self.needed: list[RegionState] = []
        """The states that *needs* names, once all regions of the component are known."""

    def __repr__(self) -> str:
        return f"the transition from {self.source!r} to {self.target!r}"

    @property
    def key(self) -> object:
        """Guards of one name may be several functions."""
        return self.when, self.needs

    def holds(self, _now: Any = None) -> bool:
        """Whether its guard and the other regions let it be made now."""
        for state in self.needed:
            if not state.is_active:
                return False
        return self.when is None or self.when()
