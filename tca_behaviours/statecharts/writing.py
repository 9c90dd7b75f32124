"""Machines that are written inside a ``with`` block, and checked at its end."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, Generic, Self, TypeVar, cast

from tca_behaviours.statecharts.states import A, State, UnsoundMachine, chart_of
from tca_module import MisuseError
from tca_module.checks import LABEL, check
from tca_tools.drawing.pictures import write_machine
from tca_tools.errors import ToolError
from tca_wire.charts import MachineChart, StateKind
from tca_wire.text.printable import shortened

B = TypeVar("B", bound="BlockState[Any, Any]")

_LONGEST = 48
"""The most characters of a line of a state in a picture."""


class BlockState(State[B, A]):
    """A state. If it is a container, it holds the states written inside its ``with`` block."""

    def __init__(self, kind: StateKind, label: str, parent: B | None) -> None:
        super().__init__(kind, label, parent)
        self.open_blocks: list[B] = parent.open_blocks if parent is not None else []
        """The containers of the machine whose blocks are open, innermost last."""

    def __enter__(self) -> Self:
        if self.number != -1 or self.children or not self.kind.is_container:
            raise MisuseError(f"{self!r} can't be opened here: make a new container")
        self.open_blocks.append(cast("B", self))
        return self

    def __exit__(self, *_: object) -> None:
        self.open_blocks.pop()

    def add_arrow(self, arrow: A) -> A:
        """Add a transition that leads out of this state.

        Args:
            arrow: the transition.

        Returns:
            The same transition.

        Raises:
            MisuseError: the machine is built.
        """
        if self.number != -1:
            raise MisuseError(
                f"{self!r} is built: write its transitions inside the machine's with block"
            )
        return super().add_arrow(arrow)


class BlockMachine(ABC, Generic[B]):
    """A machine whose states are written inside its ``with`` block. The first is entered first."""

    def __init__(self, name: str, root: B) -> None:
        """*root*: the container that is the whole machine."""
        check("a machine", LABEL, name=name)
        self.name = name
        self.root = root
        self._labelled: dict[str, B] = {}
        self._states: list[B] = []

    def __enter__(self) -> Self:
        self.root.__enter__()
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self.root.__exit__()
        if kind is None:
            self._build()

    def _container_for(self, label: object) -> B:
        """Return the container that gets a new state of this label. Raises MisuseError."""
        if not self.root.open_blocks:
            raise MisuseError(f"{self!r}: write its states inside its with block")
        check(self, LABEL, label=label)
        if label in self._labelled:
            raise UnsoundMachine(
                f"{self!r} has two states '{label}': give one of them another label"
            )
        return cast("B", self.root.open_blocks[-1])

    def _register(self, state: B) -> B:
        self._labelled[state.label] = state
        return state

    @property
    def states(self) -> list[B]:
        """All states, by number.

        Raises:
            MisuseError: the machine is being written.
        """
        if not self._states:
            raise MisuseError(f"{self!r} is not built yet: use it after its with block")
        return self._states

    @property
    def chart(self) -> MachineChart:
        """The machine as data.

        Raises:
            MisuseError: the machine is being written.
        """
        return chart_of(self.name, self.states)

    def _build(self) -> None:
        for state in self.root.all():
            if state.kind.is_container and not state.children:
                raise UnsoundMachine(f"{state!r} is empty: write a state inside it")
        states = self._numbered()
        for number, state in enumerate(states):
            state.number = number
        for state in states:
            for arrow in state.arrows:
                arrow.resolve(self._labelled)
        self._check(states)
        self._states = states

    def _draw(self, path: str | Path, source: str) -> None:
        try:
            write_machine(Path(path), source)
        except ToolError as error:
            raise MisuseError(error.message) from None

    def _numbered(self) -> list[B]:
        """Return the states in the order of their numbers."""
        return list(self.root.all())

    @abstractmethod
    def _check(self, states: list[B]) -> None:
        """Raise UnsoundMachine if the machine can't be run."""


def short_line(text: str) -> str:
    """Shorten a line of a state's description, for pictures."""
    return shortened(text, _LONGEST)
