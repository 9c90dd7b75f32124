"""What is wrong with a machine."""

from tca_module import MisuseError


class UnsoundCoordination(MisuseError):
    """A machine that can't be run as it is written; the text says which state is wrong, and what to do."""
