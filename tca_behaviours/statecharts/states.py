"""States and the transitions between them, as they are written."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, Generic, TypeVar, cast

from tca_module import MisuseError
from tca_module.checks import DURATION, check
from tca_wire.charts import ChartArrow, ChartState, MachineChart, StateKind
from tca_wire.text.measures import duration

S = TypeVar("S", bound="State[Any, Any]")
A = TypeVar("A", bound="Arrow[Any]")

Step = Callable[[], object]


class UnsoundMachine(MisuseError):
    """The machine can't be run as it is written. The text says which state is wrong, and what to
    do.
    """


def name_of(function: Callable[..., object]) -> str:
    """Return the name of a guard or step, for texts."""
    return getattr(function, "__name__", type(function).__name__)


class State(Generic[S, A]):
    """A state of a machine. *S* and *A* are the classes of the machine's states and arrows."""

    entry: Step | None = None
    """Called when the state is entered."""
    exit: Step | None = None
    """Called when the state is left."""

    def __init__(self, kind: StateKind, label: str, parent: S | None) -> None:
        self.kind = kind
        self.label = label
        self.parent = parent
        self.children: list[S] = []
        self.arrows: list[A] = []
        self.by_event: dict[str, list[A]] = {}
        """Its arrows, by event."""
        self.timed: A | None = None
        """The arrow that is taken after a time."""
        self.is_active = False
        self.number = -1
        """Its place in the chart; -1 until the machine is built."""
        if parent is not None:
            parent.children.append(self)

    def __repr__(self) -> str:
        return f"'{self.label}'"

    def add_arrow(self, arrow: A) -> A:
        """Add a transition that leads out of this state."""
        if arrow.after is not None:
            if self.timed is not None:
                raise MisuseError(f"{self!r}: after(...) is given twice: remove one")
            self.timed = arrow
        self.arrows.append(arrow)
        self.by_event.setdefault(arrow.event, []).append(arrow)
        return arrow

    def lines(self) -> Iterator[str]:
        """Yield the lines that describe the state in a picture."""
        yield from ()

    def chart_state(self) -> ChartState:
        """Return the state as data, once the states are numbered."""
        parent = self.parent.number if self.parent is not None else -1
        return ChartState(self.label, self.kind, parent, lines=list(self.lines()))

    def chart_arrows(self) -> Iterator[ChartArrow]:
        """Yield the transitions that lead out of this state, as data."""
        for arrow in self.arrows:
            yield ChartArrow(self.number, arrow.target.number, arrow.symbol)

    def containers(self) -> Iterator[S]:
        """Yield the containers around this state, innermost first."""
        state = self.parent
        while state is not None:
            yield state
            state = state.parent

    @cached_property
    def path(self) -> tuple[S, ...]:
        """This state and the containers around it, innermost first, except the whole machine."""
        return (
            cast("S", self),
            *(state for state in self.containers() if state.parent is not None),
        )

    def all(self) -> Iterator[S]:
        """This state and all states inside it, in writing order."""
        yield cast("S", self)
        for child in self.children:
            yield from child.all()

    @property
    def leaf(self) -> S:
        """The leaf that is entered with this state, because each container enters its first
        state.
        """
        state = cast("S", self)
        while state.children:
            state = state.children[0]
        return state


class Arrow(Generic[S]):
    """A transition from a source state to a target state. The target may be given by its label."""

    def __init__(
        self,
        source: S,
        target: S | str,
        event: str,
        conditions: tuple[str, ...] = (),
        after: float | None = None,
    ) -> None:
        """*conditions*: the names of further conditions, such as a guard. *after*: the seconds in
        the source after which the arrow is taken; *event* is then "".
        """
        if after is not None:
            check(f"{source!r}.after(...)", DURATION, seconds=after)
            # Nothing else causes this event: no other arrow of the machine has it.
            event = f"after {after!r} s in {source!r}"
        self.source = source
        self.after = after
        self.event = event
        self.conditions = conditions
        self.symbol = f"{event} [{', '.join(conditions)}]".lstrip() if conditions else event
        """The event, with the further conditions in brackets."""
        if after is not None:
            self.symbol = f"after {duration(after)}"
        self._given_target = target
        if not isinstance(target, State | str):
            raise MisuseError(
                f"{source!r}: a transition leads to a state or its label, not {target!r:.60}"
            )
        self.target: S
        """The state that the arrow leads to, once the machine is built."""

    def __repr__(self) -> str:
        """Return the transition as it is written."""
        if self.after is not None:
            return f"{self.source!r}.after({self.after!r}, {self.label!r})"
        return f"{self.source!r}.to({self.label!r}, on='{self.event}')"

    @property
    def label(self) -> str:
        """The label of the target."""
        return (
            self._given_target if isinstance(self._given_target, str) else self._given_target.label
        )

    @property
    def key(self) -> object:
        """The event and conditions of the arrow. If two arrows of a state have the same key, the
        second is never taken.
        """
        return self.symbol

    @property
    def is_inherited(self) -> bool:
        """Whether the arrow also leads out of the states inside its source. False for an arrow that
        waits for the end of a compound.
        """
        return True

    @cached_property
    def shared_containers(self) -> frozenset[S]:
        """The containers that are around both source and target. They stay active."""
        both = frozenset(self.source.containers()) & frozenset(self.target.containers())
        return both - {self.source, self.target}

    def holds(self, _situation: Any = None) -> bool:
        """Return whether the guard allows the transition in the present situation."""
        return True

    def resolve(self, labelled: dict[str, S]) -> None:
        """Find the target. Raises UnsoundMachine if it is not a state of this machine."""
        target = labelled.get(self.label)
        if target is None or (
            isinstance(self._given_target, State) and target is not self._given_target
        ):
            known = ", ".join(f"'{label}'" for label in labelled)
            raise UnsoundMachine(f"{self!r} names no state of this machine; its states are {known}")
        self.target = target

    def is_hidden_by(self, other: "Arrow[S]") -> bool:
        """Return whether this arrow is never taken if *other* comes first."""
        return self.event == other.event and (not other.conditions or self.key == other.key)


def chart_of(name: str, states: Sequence[State[Any, Any]]) -> MachineChart:
    """Return the machine as data. Numbers its states by their places."""
    for number, state in enumerate(states):
        state.number = number
    arrows = [arrow for state in states for arrow in state.chart_arrows()]
    return MachineChart(name, [state.chart_state() for state in states], arrows)
