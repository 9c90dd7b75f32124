"""Headers between modules and central about the states of tasks. headers.py lists all headers."""

from typing import Annotated

from tca_wire.packets.parts import MANY, Numbered, OfDelivery, OfTask
from tca_wire.points import TaskId


class ChangeState(OfTask, frozen=True, tag=31):
    """Take a transition of a task's life cycle; the body is the new goal or intermediate result.

    The sender acts as the handler if *origin* is the task itself, else as a client. Answered by
    Accepted with the task's new serial number.
    """

    transition: str
    serial: int = -1
    """The newest serial number that the sender has seen (-1: any will do)."""
    text: str = ""
    """The reason, for display."""
    origin: int = 0


class Observe(Numbered, frozen=True, tag=32):
    """Report each change of state of a task, of a message's tasks, of tasks under a task, or of
    all.

    First each living task is reported as it stands. Each report is an Answer with *more* and a
    StateChange. The last Answer follows the end of *task* or *below*. GiveUp ends the observation.
    """

    task: TaskId = TaskId(0)
    message: str = ""
    below: TaskId = TaskId(0)
    states: Annotated[list[str], MANY] = []
    """Report only changes to these states (empty: to any)."""
    origin: int = 0


class Requested(OfDelivery, frozen=True, tag=52):
    """A client has taken a transition that the handler of this delivery wants to decide."""

    transition: str
    serial: int
    text: str = ""
