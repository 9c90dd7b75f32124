"""Errors of planning. Any other error is a failure declared in messages.py, or a bug."""


class AmblerError(Exception):
    """The base of all errors of the simulated robot and its planners."""


class NoFootfall(AmblerError):
    """No ground near the ideal foothold is within reach and fit to stand on."""


class PathBlocked(AmblerError):
    """The highest ground on the leg's way is higher than the foot can be lifted."""


class OutOfReach(AmblerError):
    """A leg cannot reach the pose or foothold."""


class UnstableMove(AmblerError):
    """The centre of gravity would come too near to the edge of the support."""


class NoStep(AmblerError):
    """No leg can step from here, or the arc has been walked."""
