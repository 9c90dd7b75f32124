"""The messages of what watches over the walk and mends it. The modules that walk have never heard of them."""

from dataclasses import dataclass

from robots.ambler_sim.vocabulary import Contact, LegMove
from tca_module import Command, ExceptionHandler, Failure


@dataclass(frozen=True, slots=True)
class Margins:
    """How far the robot stays from tipping over: its centre of gravity from the nearest support edge (m), the same when
    the worst further leg fails, and how far it would have to rise to tip (m).
    """

    support: float
    conservative: float
    energy: float

    def __str__(self) -> str:
        return (
            f"{self.support:.2f} m to the edge, {self.conservative:.2f} m without one more leg, {self.energy:.3f} m up"
        )


# Checks, sent by wiretaps.
STABILITY_CHECK = Command("stability check", result=Margins)
FOOTFALL_CHECK = Command("footfall check", LegMove)

UNSTABLE_MOVE = Failure("unstable move", Margins)
UNSTABLE_FOOTHOLD = Failure("unstable foothold", Contact)

# The ladder, from the leg to the whole walk.
RAISE_LEG = ExceptionHandler("raise leg", Contact)
REPLAN_MOVE = ExceptionHandler("replan move", Contact)
SHUFFLE_FEET = ExceptionHandler("shuffle feet")
DO_AGAIN = ExceptionHandler("do again")
GIVE_UP = ExceptionHandler("give up")

LOST = Failure("module lost")
"""Raised by central: a module died with something in hand; also where it can't be known how far that had come."""

STUCK = Failure("stuck", str)
WALK_GIVEN_UP = Failure("walk given up", str)
