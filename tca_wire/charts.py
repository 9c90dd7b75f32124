"""State machines of tasks as data: what a machine that runs tells those who watch it.

A machine is a task. Its structure is the data of that task, and which of its states are active is its progress; so
whoever comes late, or reads the journal, has both.
"""

from enum import StrEnum
from typing import Literal

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
    next: dict[Ending, int] = {}
    """The state that follows each ending, where one does."""
    ends: list[Ending] = []
    """The endings with which it can end."""


class MachineChart(msgspec.Struct, frozen=True):
    """A whole machine; a state comes after the one that holds it."""

    name: str
    states: list[ChartState]

    def __post_init__(self) -> None:
        numbers = range(len(self.states))
        for number, state in enumerate(self.states):
            is_held = state.parent in numbers[:number] and self.states[state.parent].kind.is_container
            if not is_held and (number or state.parent != -1):
                raise ValueError(f"state {number} stands in {state.parent}, which is no container before it")
            if not set(state.next.values()) <= set(numbers):
                raise ValueError(
                    f"state {number} leads to {sorted(state.next.values())}: there are {len(numbers)} states"
                )
        if not self.states:
            raise ValueError("a machine has a state, at least")

    def inside(self, number: int) -> list[int]:
        """The states that one holds, in their order."""
        return [inner for inner, state in enumerate(self.states) if state.parent == number]


class ActiveStates(msgspec.Struct, frozen=True):
    """The progress of a machine: what it does now, for people and for pictures."""

    running: list[str]
    """The labels of the states whose tasks run."""
    after: str
    """What led to them: "GoTo has completed"."""
    active: list[int]
    """The numbers of all active states."""


_MARK = "#/$defs/MachineChart"


def read_machine(data_format: str, body: bytes) -> MachineChart | None:
    """The machine that a task is, by the format of its data; None if it is none."""
    if _MARK not in data_format:
        return None
    try:
        return msgspec.msgpack.decode(body, type=MachineChart)
    except (msgspec.MsgspecError, RecursionError):
        return None


def read_active(body: bytes) -> ActiveStates:
    """The progress of a machine; that none of its states is active, if it has not told any."""
    try:
        return msgspec.msgpack.decode(body, type=ActiveStates)
    except (msgspec.MsgspecError, RecursionError):
        return ActiveStates([], "", [])
