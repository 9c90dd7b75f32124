"""A module that observes the states of all tasks. Its reports must be true and complete."""

import msgspec

from tca_tools.check.world import JournalWorld
from tca_wire.packets.headers import Answer
from tca_wire.packets.parts import StateChange


class Observer:
    """The state changes that central has reported to an observer."""

    def __init__(self) -> None:
        self._reported: dict[int, StateChange] = {}  #: the newest change of each task
        self._missed = ""  #: the error if a change was missed

    def receive(self, header: object, body: bytes) -> None:
        """Record a state change that central reports."""
        if not isinstance(header, Answer) or not body:
            return
        change = msgspec.msgpack.decode(body, type=StateChange)
        known = self._reported.get(change.task)
        expected = known.serial + 1 if known is not None else 0
        if change.serial != expected:
            self._missed = (
                f"change {change.serial} of task {change.task} was reported instead of {expected}"
            )
        self._reported[change.task] = change

    def breach(self, world: JournalWorld) -> str:
        """Return the error in the reports so far; "" if they match *world*."""
        for task in world.tasks:
            if not task.message_class.is_monitor:
                reported = self._reported.get(task.id)
                if reported is None or (reported.state, reported.goal) != (task.state, task.body):
                    return f"{task} is {task.state}; reported: {reported and reported.state}"
                if task.is_over:
                    del self._reported[task.id]
        return self._missed
