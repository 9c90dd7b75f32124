"""What a script can do next, and what it got back for what it did. A script's life is the tuple of what it got.

Tasks are named by their place in the script, not by central's ids, so that what a script does next depends on nothing
but its data and what it got: ``OWN`` is the task that it handles, ``sent(0)`` the first task that it sent.
"""

from typing import Any

import msgspec

from tca_wire.constraints import Constraint, Flags
from tca_wire.declarations import Message
from tca_wire.points import Point, TaskId
from tca_wire.vocabulary import Outcome, Refusal

OWN = TaskId(-2)
"""The task that a script handles."""


def sent(place: int) -> TaskId:
    """The task that a script sent as number *place* (0, 1, ...)."""
    return TaskId(-3 - place)


def place_of(task: TaskId) -> int:
    """The inverse of ``sent``."""
    return -3 - task


class _Step(msgspec.Struct, frozen=True):
    @property
    def kind(self) -> str:
        """By which a script is held to doing the same each time."""
        return type(self).__name__


class Say(_Step, frozen=True):
    """Send a message of any class."""

    message: Message[Any, Any]
    body: bytes
    flags: Flags = Flags.NONE
    constraints: tuple[Constraint, ...] = ()
    priority: int = 0
    maximum: int = 0

    @property
    def kind(self) -> str:
        """Its class and name."""
        return f"{self.message.message_class} {self.message.name}"


class WaitUntil(_Step, frozen=True):
    """Wait until a point is reached."""

    point: Point


class KillTask(_Step, frozen=True):
    """End a task and everything under it."""

    task: TaskId


class AddConstraints(_Step, frozen=True):
    """Add constraints between tasks that exist."""

    constraints: tuple[Constraint, ...]


class Return(_Step, frozen=True):
    """The script is over; of a handler, *body* is its reply or result."""

    body: bytes


class Fail(_Step, frozen=True):
    """The handler fails."""

    failure: str
    text: str
    body: bytes


class Hang(_Step, frozen=True):
    """The script never goes on."""


Step = Say | WaitUntil | KillTask | AddConstraints | Return | Fail | Hang


class Got(msgspec.Struct, frozen=True):
    """What came back for a step of that kind, or how the script decided (*kind* "choose" or "cancelled": *choice*)."""

    kind: str
    outcome: Outcome | Refusal = Outcome.DONE
    failure: str = ""
    bodies: tuple[bytes, ...] = ()
    choice: int = 0
    words: str = ""
    """Of a choice: what was chosen."""


History = tuple[Got, ...]


class Branch(msgspec.Struct, frozen=True):
    """One way in which a script may go on: what it decides, and then does."""

    decisions: History
    step: Step
