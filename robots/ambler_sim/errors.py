"""What can go wrong in planning and moving; anything else that is raised is a bug.

AmblerError
    NoFootfall      no ground near the ideal foothold is fit to stand on and in reach
    PathBlocked     the leg cannot be lifted over what lies on its way
    OutOfReach      a pose or foothold that some leg cannot reach
    UnstableMove    the centre of gravity would come too near to the edge of the support
    ArcFinished     a step was asked for on an arc that has been walked
"""


class AmblerError(Exception):
    """The base of all errors of the simulated robot and its planners."""


class NoFootfall(AmblerError):
    """No cell near the ideal foothold can be used."""


class PathBlocked(AmblerError):
    """The highest ground on the leg's way is higher than the foot can be lifted."""


class OutOfReach(AmblerError):
    """Some leg is too short or too long for a pose."""


class UnstableMove(AmblerError):
    """The robot would be near to tipping over."""


class ArcFinished(AmblerError):
    """Nothing of the arc remains."""
