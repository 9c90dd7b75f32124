"""State machines of tasks as data: what a machine that runs tells those who watch it.

A machine is a task. Its structure is the data of that task, and which of its states are active is its progress; so
whoever comes late, or reads the journal, has both.
"""

from enum import StrEnum

import msgspec


class StateKind(StrEnum):
    """What a state does while it is active."""

    TASK = "task"
    """Its task runs."""
    EPSILON = "epsilon"
    """Nothing: it is left as soon as it is entered."""
    SEQUENCE = "sequence"
    """One of its states is active; when that has completed, the next one."""
    MACHINE = "machine"
    """One of its states is active; only written transitions lead to another."""
    ANY = "any of"
    """All of its states are active, until one of them has ended."""
    ALL = "all of"
    """All of its states are active, until all have completed, or one has ended otherwise."""

    @property
    def is_concurrent(self) -> bool:
        """Whether its states are active together."""
        return self in (StateKind.ANY, StateKind.ALL)

    @property
    def is_container(self) -> bool:
        """Whether it holds states."""
        return self not in (StateKind.TASK, StateKind.EPSILON)


class ChartState(msgspec.Struct, frozen=True, omit_defaults=True):
    """A state of a machine. Its number is its place in ``MachineChart.states``."""

    label: str
    kind: StateKind
    parent: int
    """The state that holds it; -1 for the first, which is the whole machine."""
    task: str = ""
    parameters: dict[str, str] = {}
    """Of the task, as text."""
    next: dict[str, int] = {}
    """The state that follows each ending, where one does."""
    ends: list[str] = []
    """The endings with which it can end."""


class MachineChart(msgspec.Struct, frozen=True):
    """A whole machine; a state comes after the one that holds it."""

    name: str
    states: list[ChartState]

    def inside(self, number: int) -> list[int]:
        """The states that one holds, in their order."""
        return [inner for inner, state in enumerate(self.states) if state.parent == number]


class ActiveStates(msgspec.Struct, frozen=True):
    """The progress of a machine: the numbers of its active states, and for people how it came to them."""

    active: list[int]
    text: str = ""
