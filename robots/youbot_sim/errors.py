"""The failures of the simulated robot; anything else that is raised is a bug."""


class YouBotError(Exception):
    """The base of all errors of the robot."""


class PoseUnreachable(YouBotError):
    """A pose that the arm can't take."""
