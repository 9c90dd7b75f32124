"""The failures of the simulated robot; anything else that is raised is a bug."""


class OfficeError(Exception):
    """The base of them."""


class NoPath(OfficeError):
    """Nothing leads to a place."""
