"""What can go wrong with turtles."""


class TurtleError(Exception):
    """Base of all of them."""


class NoSuchTurtle(TurtleError):
    """A turtle was named that is not there."""


class TurtleExists(TurtleError):
    """A turtle was to be made under a name that another has."""


class NoSuchPartner(TurtleError):
    """A partner was named that this turtle does not know."""


class BadTeam(TurtleError):
    """The file of a team can't be used, or a robot is not in it."""


class DamagedDatagram(TurtleError):
    """What came from a partner is no datagram of a robot."""
