"""The states of a region, and the transitions between them, as they are written."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from tca_behaviours.statecharts.states import Arrow, State, Step, name_of
from tca_module import MisuseError
from tca_wire.charts import ChartArrow, StateKind
from tca_wire.text.measures import duration


def tick_text(period: float, estimate: float | None) -> str:
    """Return the period and the execution time of ticks, in words."""
    return f"every {duration(period)}" + (f", takes {duration(estimate)}" if estimate else "")


class RegionState(State["RegionState", "RegionTransition"]):
    """A state of a region: a leaf or a container. A container is entered together with its first
    state.
    """

    def __init__(self, label: str, parent: "RegionState | None") -> None:
        super().__init__(StateKind.WAIT, label, parent)
        self.by_name: dict[str, RegionState] = parent.by_name if parent is not None else {}
        """All states of the region, by name."""
        self.region: str = parent.region if parent is not None else label
        self.activity: Step | None = None
        self.period = 0.0
        self.estimate: float | None = None

    def __repr__(self) -> str:
        return f"'{self.region}.{self.label}'"

    def lines(self) -> Iterator[str]:
        """Yield a line for each function that the state calls."""
        if self.activity is not None:
            yield f"{name_of(self.activity)} {tick_text(self.period, self.estimate)}"
        if self.entry is not None:
            yield f"entry: {name_of(self.entry)}"
        if self.exit is not None:
            yield f"exit: {name_of(self.exit)}"

    def chart_arrows(self) -> Iterator[ChartArrow]:
        """Yield the transitions that lead out of this state, as data. The event and each condition
        have a line of their own.
        """
        for arrow in self.arrows:
            conditions = ",\n".join(arrow.conditions)
            symbol = f"{arrow.event}\n[{conditions}]".lstrip() if conditions else arrow.symbol
            yield ChartArrow(self.number, arrow.target.number, symbol)

    def state(
        self,
        name: str,
        *,
        entry: Step | None = None,
        exit: Step | None = None,  # noqa: A002 - the usual word in statecharts
        activity: Step | None = None,
        period: float | None = None,
        estimate: float | None = None,
    ) -> "RegionState":
        """Add a state inside this one. The state that is added first is entered first.

        Args:
            name: the state's name, unique in its region.
            entry: called when the state is entered.
            exit: called when the state is left.
            activity: ticked once a *period* while the state is active.
            period: the period of the activity in seconds.
            estimate: the longest execution time of the activity in seconds; None: measure it.

        Returns:
            The state; its ``to`` adds transitions, its ``state`` adds states inside.

        Raises:
            MisuseError: the name is in use or not allowed, or the activity has no period.
        """
        if name in self.by_name:
            raise MisuseError(
                f"'{self.region}' has two states '{name}': give one of them another name"
            )
        if name == "machine" or not name:
            raise MisuseError(f"'{self.region}': a state can't be called '{name}'")
        state = RegionState(name, self)
        if activity is not None and not (period or 0) > 0:
            raise MisuseError(f"the activity of {state!r} needs a period: add one, in seconds")
        self.by_name[name] = state
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
        """Add a transition to another state of the region.

        Args:
            target: the state that follows.
            on: the event; "": the transition is made as soon as the conditions allow it.
            when: a guard: the transition is made only if this function returns true.
            needs: states of other regions that must be active, such as "enabling.enabled".

        Raises:
            MisuseError: the target is in another region, or there is neither event nor condition.
        """
        self._check_target(target)
        needs = [needs] if isinstance(needs, str) else list(needs)
        if not (on or when or needs):
            raise MisuseError(f"{self!r} would go to {target!r} at once: add on, when or needs")
        self.add_arrow(RegionTransition(self, target, on, when, needs))

    def after(self, seconds: float, target: "RegionState") -> None:
        """Add a transition that is made when the region has been in this state for a time.

        Args:
            seconds: the time, from the entry into this state.
            target: the state that follows.

        Raises:
            MisuseError: the target is in another region, the time is not above 0, or the state has
                such a transition.

        Example::

            waiting.after(5.0, stopped)
        """
        self._check_target(target)
        self.add_arrow(RegionTransition(self, target, "", None, [], seconds))

    def _check_target(self, target: "RegionState") -> None:
        if self.by_name.get(target.label) is not target:
            raise MisuseError(
                f"{self!r} can't lead to {target!r}, in another region: "
                f"write a transition there that needs {self!r}"
            )


class RegionTransition(Arrow[RegionState]):
    """A transition from one state of a region to another."""

    def __init__(
        self,
        source: RegionState,
        target: RegionState,
        event: str,
        when: Callable[[], bool] | None,
        needs: list[str],
        after: float | None = None,
    ) -> None:
        guard = [name_of(when)] if when is not None else []
        super().__init__(source, target, event, (*guard, *needs), after)
        self.target = target
        self.when = when
        self.needs = needs
        self.needed: list[RegionState] = []
        """The states named in *needs*, once all regions of the component are known."""

    def __repr__(self) -> str:
        return f"the transition from {self.source!r} to {self.target!r}"

    @property
    def key(self) -> object:
        """The guard and the needs. The guard's name would not do: two guards may have the same
        name.
        """
        return self.when, self.needs

    def holds(self, _situation: Any = None) -> bool:
        """Return whether the guard and the states of other regions allow the transition now."""
        return all(state.is_active for state in self.needed) and (self.when is None or self.when())
