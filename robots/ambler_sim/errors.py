"""What can go wrong in planning and moving; anything else that is raised is a bug.

AmblerError
    NoFootfall      no ground near the ideal foothold is fit to stand on and in reach
    PathBlocked     the leg cannot be lifted over what lies on its way
    TerrainContact  a leg met something on its way and was put down in front of it
    OutOfReach      a pose or foothold that some leg cannot reach
    UnstableMove    the centre of gravity would come too near to the edge of the support
    ArcFinished     a step was asked for on an arc that has been walked
"""

from robots.ambler_sim.vocabulary import Contact


class AmblerError(Exception):
    """The base of all errors of the simulated robot and its planners."""


class NoFootfall(AmblerError):
    """No cell near the ideal foothold can be used."""


class PathBlocked(AmblerError):
    """The highest ground on the leg's way is higher than the foot can be lifted."""


class TerrainContact(AmblerError):
    """Something stood in a leg's way."""

    def __init__(self, contact: Contact) -> None:
        where = f"x {contact.x:.2f}, y {contact.y:.2f}, z {contact.z:.2f}"
        super().__init__(f"leg {contact.leg} met something at {where} with {contact.force / 1000:.1f} kN")
        self.contact = contact


class OutOfReach(AmblerError):
    """Some leg is too short or too long for a pose."""


class UnstableMove(AmblerError):
    """The robot would be near to tipping over."""


class ArcFinished(AmblerError):
    """Nothing of the arc remains."""
