"""What can't be planned; anything else that is raised is a failure of messages.py, or a bug."""


class AmblerError(Exception):
    """The base of all errors of the simulated robot and its planners."""


class NoFootfall(AmblerError):
    """No ground near the ideal foothold is fit to stand on and in reach."""


class PathBlocked(AmblerError):
    """The highest ground on the leg's way is higher than the foot can be lifted."""


class OutOfReach(AmblerError):
    """A pose or foothold that some leg cannot reach."""


class UnstableMove(AmblerError):
    """The centre of gravity would come too near to the edge of the support."""


class NoStep(AmblerError):
    """No leg can take a footstep from here, or the arc has been walked."""
