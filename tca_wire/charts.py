"""State machines as data: what a machine that runs tells those who watch it.

A machine is a task. Its structure is the data of that task, and its progress says which of its
states are active. So a late observer has both, and so has the journal.
"""

from enum import StrEnum
from typing import Literal, TypeVar

import msgspec

Ending = Literal["completed", "failed", "timeout", "interrupted"]
"""How a task, or a container of tasks, can end."""


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
    ACTIVITY = "activity"
    """It has an activity."""
    WAIT = "wait"
    """It has none: it waits for an event."""
    COMPOUND = "compound"
    """It holds other states, of which the first is entered."""
    FINAL = "final"
    """Its compound is done; at the top, the machine has ended."""

    @property
    def is_concurrent(self) -> bool:
        """Whether its states are active together."""
        return self in (StateKind.ANY, StateKind.ALL)

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
    """The state that holds it; -1: none does."""
    note: str = ""
    """What it is, where the label does not say it: the name of its task, the kind of container."""
    lines: list[str] = []
    """What it does: parameters, tasks, activities."""
    completes: bool = False
    """Whether its completion is that of the state that holds it."""


class ChartArrow(msgspec.Struct, frozen=True):
    """A transition between two states."""

    source: int
    target: int
    symbol: str
    """Its event, with the guard in brackets: ``"done [box B is free]"``; "" where a task, or a
    container of tasks, has completed.
    """


class MachineChart(msgspec.Struct, frozen=True, omit_defaults=True):
    """A whole machine; a state comes after the one that holds it."""

    name: str
    states: list[ChartState]
    arrows: list[ChartArrow] = []
    is_coordinated: bool = False
    """Whether a coordinator runs it: then its progress is a ``CoordinationReport``, and else
    ``ActiveStates``.
    """
    agents: list[str] = []
    """The agents that a coordinator has for its tasks."""

    def __post_init__(self) -> None:
        numbers = range(len(self.states))
        if not self.states:
            raise ValueError("a machine needs at least one state")
        for number, state in enumerate(self.states):
            is_held = (
                state.parent in numbers[:number] and self.states[state.parent].kind.is_container
            )
            if not is_held and state.parent != -1:
                raise ValueError(
                    f"state {number} is in {state.parent}, which is not an earlier container"
                )
        for arrow in self.arrows:
            if arrow.source not in numbers or arrow.target not in numbers:
                raise ValueError(
                    f"an arrow leads from {arrow.source} to {arrow.target}: there are only {len(numbers)} states"
                )

    def inside(self, number: int) -> list[int]:
        """The states that one holds, in their order; of -1, those that none holds."""
        return [inner for inner, state in enumerate(self.states) if state.parent == number]

    def around(self, number: int) -> list[int]:
        """A state, and the containers that it stands in, innermost first."""
        found = []
        while number >= 0:
            found.append(number)
            number = self.states[number].parent
        return found

    def entered(self, number: int) -> int:
        """The innermost state that is entered with one."""
        while inside := self.inside(number):
            number = inside[0]
        return number


class ActiveStates(msgspec.Struct, frozen=True):
    """The progress of a machine: what it does now, for people and for pictures."""

    running: list[str]
    """The labels of the states whose tasks run."""
    after: str
    """What led to them: "GoTo has completed"."""
    active: list[int]
    """The numbers of all active states."""


_T = TypeVar("_T")
_MARK = "#/$defs/MachineChart"


def read_machine(data_format: str, body: bytes) -> MachineChart | None:
    """The machine that a task is, by the format of its data; None if it is none."""
    return decoded(body, MachineChart) if _MARK in data_format else None


def read_active(body: bytes) -> ActiveStates:
    """The progress of a machine; that none of its states is active, if it has not told any."""
    return decoded(body, ActiveStates) or ActiveStates([], "", [])


def decoded(body: bytes, kind: type[_T]) -> _T | None:
    """The bytes as that kind of data; None if they are none."""
    try:
        return msgspec.msgpack.decode(body, type=kind)
    except (msgspec.MsgspecError, RecursionError):
        return None
