"""The messages of a coordinator, beside the command that it is."""

import msgspec

from tca_module import Broadcast, Failure


class MachineEvent(msgspec.Struct, frozen=True):
    """Something has happened that a machine has arrows for."""

    machine: str
    event: str


COORDINATION_EVENT = Broadcast("coordination event", MachineEvent)
"""Tells coordinators of an event. A machine whose current state has no arrow for it does
nothing.
"""


class CoordinationEnd(msgspec.Struct, frozen=True):
    """The result of a coordinator."""

    state: str
    """The final state that its machine has reached."""
    transitions: int
    """The number of those that it has taken."""
    kept: int
    """Tasks that were sent ahead, and whose state was entered then."""
    wasted: int
    """Tasks that were sent ahead in vain."""


ACTIVITY_STOPPED = Failure("activity stopped")
"""A task of the current activity was killed by somebody, and its state has no arrow for
"failed".
"""

NEEDS_NOT_MET = Failure("needs not met")
"""A fact that an activity needs does not hold when its state is entered, and the state has no arrow
for "failed".
"""
