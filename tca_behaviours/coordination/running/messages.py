"""The messages of a coordinator, except its command."""

import msgspec

from tca_module import Broadcast, Failure


class MachineEvent(msgspec.Struct, frozen=True):
    """An event for a machine."""

    machine: str
    event: str


COORDINATION_EVENT = Broadcast("coordination event", MachineEvent)
"""Sends an event to coordinators. A machine ignores the event if its current state has no arrow for
it.
"""


class CoordinationEnd(msgspec.Struct, frozen=True):
    """The result of a coordinator."""

    state: str
    """The final state that the machine has reached."""
    transitions: int
    """The number of transitions that the machine has taken."""
    kept: int
    """The number of tasks that were sent early and kept, because their state was entered."""
    wasted: int
    """The number of tasks that were sent early and wasted."""


ACTIVITY_STOPPED = Failure("activity stopped")
"""A task of the current activity was killed, and its state has no arrow for "failed"."""

NEEDS_NOT_MET = Failure("needs not met")
"""The activity of an entered state needs a fact that does not hold, and the state has no arrow for
"failed".
"""
