"""The states of a region, and the transitions between them, as they are written."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator

from tca_module import MisuseError

Step = Callable[[], object]


class HasStates(ABC):
    """A region, or a state that holds others."""

    @abstractmethod
    def _new(self, name: str) -> "RegionState": ...

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
        """A state inside it; the first one is entered first. Its *activity* is ticked while it is active, once a
        *period*, and takes *estimate* seconds at most. *entry* and *exit* are called when it is entered and left.
        """
        state = self._new(name)
        if activity is not None and not (period or 0) > 0:
            raise MisuseError(f"the activity of {state!r} needs a period: give period=..., in seconds")
        state.entry, state.exit, state.activity = entry, exit, activity
        state.period, state.estimate = period or 0.0, estimate
        return state


class RegionState(HasStates):
    """A state of a region: a leaf, or one that holds others, the first of which is entered with it."""

    def __init__(self, region: "StateList", name: str, parent: "RegionState | None") -> None:
        self.name = name
        self.parent = parent
        self.children: list[RegionState] = []
        self.is_active = False
        self.entry: Step | None = None
        self.exit: Step | None = None
        self.activity: Step | None = None
        self.period = 0.0
        self.estimate: float | None = None
        self.transitions: dict[str, list[RegionTransition]] = {}
        """By their events; those without one under the empty text."""
        self._region = region

    def __repr__(self) -> str:
        return f"'{self._region.title}.{self.name}'"

    def _new(self, name: str) -> "RegionState":
        return self._region.new_state(name, self)

    def to(
        self,
        target: "RegionState",
        *,
        on: str = "",
        when: Callable[[], bool] | None = None,
        needs: Iterable[str] = (),
    ) -> None:
        """A transition: by the event *on*, or without one, as soon as it may be made. It may be made when the guard
        *when* returns true and the states that it *needs*, such as "enabling.enabled", are active.
        """
        if self._region.states.get(target.name) is not target:
            raise MisuseError(
                f"{self!r} can't lead to {target!r}, in another region: let a transition there need {self!r}"
            )
        needs = [needs] if isinstance(needs, str) else list(needs)
        if not (on or when or needs):
            raise MisuseError(f"{self!r} would go to {target!r} at once: give on=..., when=... or needs=...")
        self.transitions.setdefault(on, []).append(RegionTransition(self, target, when, needs))

    def around(self) -> Iterator["RegionState"]:
        """The state itself, then those that hold it, the outermost last."""
        state: RegionState | None = self
        while state is not None:
            yield state
            state = state.parent

    def entered_leaf(self) -> "RegionState":
        """The leaf that becomes active when this state is entered."""
        return self.children[0].entered_leaf() if self.children else self


class RegionTransition:
    """A transition from one state of a region to another."""

    def __init__(
        self, source: RegionState, target: RegionState, when: Callable[[], bool] | None, needs: list[str]
    ) -> None:
        self.source = source
        self.target = target
        self.when = when
        self.needs = needs
        self.around = frozenset(source.around()) & frozenset(target.around()) - {source, target}
        """The states that hold both, and stay active."""
        self.needed: list[RegionState] = []
        """The states that *needs* names, once all regions of the component are known."""

    def may_be_made(self) -> bool:
        """Whether its guard and the other regions let it be made now."""
        for state in self.needed:
            if not state.is_active:
                return False
        return self.when is None or self.when()


class StateList:
    """The states of a region by their names, in the order in which they are written."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.states: dict[str, RegionState] = {}

    def new_state(self, name: str, parent: RegionState | None) -> RegionState:
        """Add a state. Raises MisuseError if its name can't be."""
        if name in self.states:
            raise MisuseError(f"'{self.title}' has two states '{name}': give one of them another name")
        if name == "machine" or not name:
            raise MisuseError(f"'{self.title}': a state can't be called '{name}'")
        state = self.states[name] = RegionState(self, name, parent)
        if parent is not None:
            parent.children.append(state)
        return state

    def unreached(self) -> list[RegionState]:
        """The states that no transition leads to, from the first one on."""
        if not self.states:
            return []
        todo = list(next(iter(self.states.values())).entered_leaf().around())
        reached = set(todo)
        while todo:
            for transitions in todo.pop().transitions.values():
                for transition in transitions:
                    new = set(transition.target.entered_leaf().around()) - reached
                    reached |= new
                    todo += new
        return [state for state in self.states.values() if state not in reached]
