"""Headers between modules and central about the states of tasks. The lists of all headers are in
headers.py.
"""

from typing import Annotated

from tca_wire.packets.parts import MANY, Numbered, OfDelivery, OfTask
from tca_wire.points import TaskId


class ChangeState(OfTask, frozen=True, tag=31):
    """Take a transition of a task's life cycle: as its handler if *origin* is the task itself, else
    as a client. The body is the new goal, or the intermediate result. Answered by Accepted with the
    task's new serial number.
    """

    transition: str
    serial: int = -1
    """The newest serial number of the task that the sender has seen (-1: it takes the task as it
    is).
    """
    text: str = ""
    """The reason, for people."""
    origin: int = 0


class Observe(Numbered, frozen=True, tag=32):
    """Tell of each change of state of one task, of a message's tasks, of those under a task, or
    (without any) of all; and first of each living one how it stands. Each is an Answer with *more*
    and a StateChange; where the *task*, or that *below* which they are, has ended, comes the end.
    GiveUp ends it.
    """

    task: TaskId = TaskId(0)
    message: str = ""
    below: TaskId = TaskId(0)
    states: Annotated[list[str], MANY] = []
    """Only the changes to one of these (none: to any)."""
    origin: int = 0


class Requested(OfDelivery, frozen=True, tag=52):
    """A client has taken a transition of the task of this delivery, which the handler has said that
    it takes.
    """

    transition: str
    serial: int
    text: str = ""
