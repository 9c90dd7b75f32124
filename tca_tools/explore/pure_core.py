"""The explorer copies the state of central and looks at all of it: it needs the core that is Python."""

import os

os.environ["TCA_PURE"] = "1"  # says central when it is first imported

from tca_central.loading import is_compiled
from tca_tools.explore.errors import ExplorerError


def check_core() -> None:
    """Raises ExplorerError if central's core is machine code."""
    if is_compiled():
        msg = "the explorer needs central's core in Python, and its machine code is loaded already: set TCA_PURE=1"
        raise ExplorerError(msg)
