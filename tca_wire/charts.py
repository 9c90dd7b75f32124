"""State machines as data: what a running machine reports to its observers.

A machine is a task. Its structure is the data of that task, and its progress names the active
states. A late observer and the journal therefore have the structure and the progress.
"""

from enum import StrEnum
from typing import Literal, TypeVar

import msgspec

Ending = Literal["completed", "failed", "timeout", "interrupted"]
"""The possible outcomes of a task. A container of tasks, and a Python state, may have others."""


class StateKind(StrEnum):
    """The kind of a state: what it does while it is active."""

    TASK = "task"
    """Its task runs."""
    EPSILON = "epsilon"
    """Nothing: it ends as soon as it is entered."""
    SEQUENCE = "sequence"
    """One of its states is active; when that state has completed, the next one is entered."""
    MACHINE = "machine"
    """One of its states is active; only explicit transitions lead to another."""
    ANY = "any of"
    """All of its states are active, until one of them has ended."""
    ALL = "all of"
    """All of its states are active, until all have completed, or one has ended in another way."""
    ALL_ENDED = "all ended"
    """All of its states are active, until each has ended in any way, or a function says so."""
    CALL = "call"
    """It calls a function of Python."""
    ACTIVITY = "activity"
    """It runs an activity."""
    WAIT = "wait"
    """It has no activity: it waits for an event."""
    COMPOUND = "compound"
    """It holds other states; the first of them is entered."""
    FINAL = "final"
    """It ends its compound or, at the top, the machine."""

    @property
    def is_concurrent(self) -> bool:
        """Whether its states are active together."""
        return self in (StateKind.ANY, StateKind.ALL, StateKind.ALL_ENDED)

    @property
    def is_container(self) -> bool:
        """Whether it holds states."""
        return self.is_concurrent or self in (
            StateKind.SEQUENCE,
            StateKind.MACHINE,
            StateKind.COMPOUND,
        )


class ChartState(msgspec.Struct, frozen=True, omit_defaults=True):
    """A state of a machine. Its number is its place in ``MachineChart.states``."""

    label: str
    kind: StateKind
    parent: int = -1
    """The state that holds it; -1: none."""
    note: str = ""
    """A description that the label lacks: the name of its task, the kind of container."""
    lines: list[str] = []
    """Its parameters, tasks and activities."""
    completes: bool = False
    """Whether the completion of this state also completes the state that holds it."""


class ChartArrow(msgspec.Struct, frozen=True):
    """A transition between two states."""

    source: int
    target: int
    symbol: str
    """Its event, with the guard in brackets: ``"done [box B is free]"``; "" for the completion of a
    task or of a container of tasks.
    """


class MachineChart(msgspec.Struct, frozen=True, omit_defaults=True):
    """A whole machine; each state comes after the one that holds it."""

    name: str
    states: list[ChartState]
    arrows: list[ChartArrow] = []
    is_coordinated: bool = False
    """Whether a coordinator runs it. Then its progress is a ``CoordinationReport``, else
    ``ActiveStates``.
    """
    agents: list[str] = []
    """The agents that the coordinator has for its tasks."""

    def __post_init__(self) -> None:
        numbers = range(len(self.states))
        if not self.states:
            raise ValueError("a machine needs at least one state")
        containers = {-1}
        for number, state in enumerate(self.states):
            if state.parent not in containers:
                raise ValueError(
                    f"state {number} is in {state.parent}, which is not an earlier container"
                )
            if state.kind.is_container:
                containers.add(number)
        for arrow in self.arrows:
            if arrow.source not in numbers or arrow.target not in numbers:
                raise ValueError(
                    f"an arrow leads from {arrow.source} to {arrow.target}:"
                    f" there are only {len(numbers)} states"
                )

    def inside(self, number: int) -> list[int]:
        """Return the states that a state holds, in order; for -1 the top-level states."""
        return [inner for inner, state in enumerate(self.states) if state.parent == number]

    def around(self, number: int) -> list[int]:
        """Return a state and the containers around it, innermost first."""
        found = []
        while number >= 0:
            found.append(number)
            number = self.states[number].parent
        return found

    def entered(self, number: int) -> int:
        """Return the innermost state that is entered together with a state."""
        while inside := self.inside(number):
            number = inside[0]
        return number


class ActiveStates(msgspec.Struct, frozen=True):
    """The progress of a machine, for display."""

    running: list[str]
    """The labels of the states whose tasks run."""
    after: str
    """The event that led to these states: "GoTo has completed"."""
    active: list[int]
    """The numbers of all active states."""


_T = TypeVar("_T")
_MACHINE_REFERENCE = "#/$defs/MachineChart"


def read_machine(data_format: str, body: bytes) -> MachineChart | None:
    """Return the machine of a task, recognised by the format of the task's data; None otherwise."""
    return decoded(body, MachineChart) if _MACHINE_REFERENCE in data_format else None


def read_active(body: bytes) -> ActiveStates:
    """Return the progress of a machine; without any report, no state is active."""
    return decoded(body, ActiveStates) or ActiveStates([], "", [])


def decoded(body: bytes, kind: type[_T]) -> _T | None:
    """Decode bytes as that kind of data; return None if they don't fit."""
    try:
        return msgspec.msgpack.decode(body, type=kind)
    except (msgspec.MsgspecError, RecursionError):
        return None
