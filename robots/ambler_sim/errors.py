"""The failures of planning and moving; anything else that is raised is a bug."""

import math

from robots.ambler_sim.vocabulary import LEGS, Contact


class AmblerError(Exception):
    """The base of all errors of the simulated robot and its planners."""


class NoFootfall(AmblerError):
    """No ground near the ideal foothold is fit to stand on and in reach."""


class PathBlocked(AmblerError):
    """The highest ground on the leg's way is higher than the foot can be lifted."""


class TerrainContact(AmblerError):
    """A leg met something on its way and was put down in front of it, or the body met something and went back."""

    def __init__(self, contact: Contact) -> None:
        where = f"x {contact.x:.2f}, y {contact.y:.2f}, z {contact.z:.2f}"
        what = f"leg {contact.leg}" if contact.leg in LEGS else "the body"
        super().__init__(f"{what} met something at {where} with {contact.force / 1000:.1f} kN")
        self.contact = contact


class JointFault(AmblerError):
    """A leg's joint does not follow: by *error* (m or rad)."""

    def __init__(self, leg: int, error: float) -> None:
        super().__init__(f"leg {leg} does not follow: it is {error:.2f} m or rad behind")
        self.leg, self.error = leg, error


class Tilting(AmblerError):
    """The body tilts more than is safe: the move was stopped, with all feet on the ground."""

    def __init__(self, tilt: float) -> None:
        super().__init__(f"the body tilts by {math.degrees(tilt):.1f} degrees")
        self.tilt = tilt


class AmplifierTripped(AmblerError):
    """The amplifier of a leg is off; its brakes hold it."""

    def __init__(self, leg: int) -> None:
        super().__init__(f"the amplifier of leg {leg} is off")
        self.leg = leg


class OutOfReach(AmblerError):
    """A pose or foothold that some leg cannot reach."""


class UnstableMove(AmblerError):
    """The centre of gravity would come too near to the edge of the support."""


class NoStep(AmblerError):
    """No leg can take a footstep from here, or the arc has been walked."""
