"""Errors of turtles and their teams."""


class TurtleError(Exception):
    """The base of all errors of turtles."""


class NoSuchTurtle(TurtleError):
    """There is no turtle of this name."""


class TurtleExists(TurtleError):
    """There is already a turtle of this name."""


class NoSuchPartner(TurtleError):
    """The turtle has no partner of this name."""


class BadTeam(TurtleError):
    """The file of a team can't be used, or a robot is not in it."""


class DamagedDatagram(TurtleError):
    """The data from a partner are not a datagram of a robot."""
