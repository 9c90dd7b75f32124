"""States and the transitions between them, as they are written."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, Generic, TypeVar, cast

from tca_module import MisuseError
from tca_wire.charts import ChartArrow, ChartState, MachineChart, StateKind

S = TypeVar("S", bound="State[Any, Any]")
A = TypeVar("A", bound="Arrow[Any]")

Step = Callable[[], object]


class UnsoundMachine(MisuseError):
    """A machine that can't be run as it is written; the text says which state is wrong, and what to
    do.
    """


def name_of(function: Callable[..., object]) -> str:
    """The name of a guard or step, for texts."""
    return getattr(function, "__name__", type(function).__name__)


class State(Generic[S, A]):
    """A state of a machine. *S* and *A* are the classes of all states and arrows of that
    machine.
    """

    entry: Step | None = None
    """Called when it is entered."""
    exit: Step | None = None
    """Called when it is left."""

    def __init__(self, kind: StateKind, label: str, parent: S | None) -> None:
        self.kind = kind
        self.label = label
        self.parent = parent
        self.children: list[S] = []
        self.arrows: list[A] = []
        self.by_event: dict[str, list[A]] = {}
        """Its arrows, by their events."""
        self.is_active = False
        self.number = -1
        """Its place in the chart, when the machine is built."""
        if parent is not None:
            parent.children.append(self)

    def __repr__(self) -> str:
        return f"'{self.label}'"

    def lead(self, arrow: A) -> A:
        """Add a transition that leads out of it."""
        self.arrows.append(arrow)
        self.by_event.setdefault(arrow.event, []).append(arrow)
        return arrow

    def lines(self) -> Iterator[str]:
        """What it does, for its chart."""
        yield from ()

    def row(self) -> ChartState:
        """It as data, once the machine is numbered."""
        parent = self.parent.number if self.parent is not None else -1
        return ChartState(self.label, self.kind, parent, lines=list(self.lines()))

    def ways(self) -> Iterator[ChartArrow]:
        """The transitions that lead out of it, as data."""
        for arrow in self.arrows:
            yield ChartArrow(self.number, arrow.target.number, arrow.symbol)

    def around(self) -> Iterator[S]:
        """The containers that it stands in, innermost first."""
        state = self.parent
        while state is not None:
            yield state
            state = state.parent

    @cached_property
    def path(self) -> tuple[S, ...]:
        """It and the containers that it stands in, innermost first, without the one that is the
        whole machine.
        """
        return (cast("S", self), *(state for state in self.around() if state.parent is not None))

    def all(self) -> Iterator[S]:
        """Itself and all inside, in the order in which they were written."""
        yield cast("S", self)
        for child in self.children:
            yield from child.all()

    @property
    def leaf(self) -> S:
        """The innermost state that is entered with it: a container is entered with its first
        state.
        """
        state = cast("S", self)
        while state.children:
            state = state.children[0]
        return state


class Arrow(Generic[S]):
    """A transition from one state to another, or to the one of that label."""

    def __init__(
        self, source: S, target: S | str, event: str, conditions: tuple[str, ...] = ()
    ) -> None:
        """*conditions*: the names of what else must be true, in words."""
        self.source = source
        self.event = event
        self.conditions = conditions
        self.symbol = f"{event} [{', '.join(conditions)}]".lstrip() if conditions else event
        """Its event, with what else must be true in brackets."""
        self._named = target
        if not isinstance(target, State | str):
            raise MisuseError(
                f"{source!r}: a transition takes a state or its label, not {target!r:.60}"
            )
        self.target: S
        """The state that it leads to, when the machine is built."""

    def __repr__(self) -> str:
        """As it is written."""
        return f"{self.source!r}.to({self.label!r}, on='{self.event}')"

    @property
    def label(self) -> str:
        """The label of the state that it leads to."""
        return self._named if isinstance(self._named, str) else self._named.label

    @property
    def key(self) -> object:
        """Of two arrows of one state with the same key the second is never taken."""
        return self.symbol

    @property
    def is_inherited(self) -> bool:
        """Whether the states inside its own obey it; not where it leads on from the end of a
        compound.
        """
        return True

    @cached_property
    def around(self) -> frozenset[S]:
        """The containers that hold both its ends, and stay active."""
        both = frozenset(self.source.around()) & frozenset(self.target.around())
        return both - {self.source, self.target}

    def holds(self, _now: Any = None) -> bool:
        """Whether it may be taken, as things are."""
        return True

    def resolve(self, labelled: dict[str, S]) -> None:
        """Find the state that it leads to. Raises UnsoundMachine if it is none of the machine's."""
        target = labelled.get(self.label)
        if target is None or (isinstance(self._named, State) and target is not self._named):
            known = ", ".join(f"'{label}'" for label in labelled)
            raise UnsoundMachine(f"{self!r} names no state of this machine; there are {known}")
        self.target = target

    def is_hidden_by(self, other: "Arrow[S]") -> bool:
        """Whether it is never taken where the *other* one comes before it."""
        return self.event == other.event and (not other.conditions or self.key == other.key)


def chart_of(name: str, states: Sequence[State[Any, Any]]) -> MachineChart:
    """A machine as data. Its states get the numbers of their places."""
    for number, state in enumerate(states):
        state.number = number
    ways = [way for state in states for way in state.ways()]
    return MachineChart(name, [state.row() for state in states], ways)
