"""A module that observes the states of all tasks: what it was told must be so, and it must miss no
change.
"""

import msgspec

from tca_tools.check.world import JournalWorld
from tca_wire.packets.headers import Answer
from tca_wire.packets.parts import StateChange


class Observer:
    """What an observer was told."""

    def __init__(self) -> None:
        self._told: dict[int, StateChange] = {}  #: the newest of each task
        self._missed = ""

    def hear(self, header: object, body: bytes) -> None:
        """The observer is told something."""
        if not isinstance(header, Answer) or not body:
            return
        change = msgspec.msgpack.decode(body, type=StateChange)
        known = self._told.get(change.task)
        expected = known.serial + 1 if known is not None else 0
        if change.serial != expected:
            self._missed = (
                f"change {change.serial} of task {change.task} was told where {expected} comes next"
            )
        self._told[change.task] = change

    def breach(self, world: JournalWorld) -> str:
        """The error in what the observer knows; "" if there is none."""
        for task in world.tasks:
            if not task.message_class.is_monitor:
                told = self._told.get(task.id)
                if told is None or (told.state, told.goal) != (task.state, task.body):
                    return (
                        f"{task} is {task.state}, and who observes was told {told and told.state}"
                    )
                if task.is_over:
                    del self._told[task.id]
        return self._missed
