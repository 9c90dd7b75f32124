"""Where central is found when nobody says so: a Unix socket in a folder that only its owner can enter."""

import os
from pathlib import Path

VARIABLE = "TCA_CENTRAL"


def default_folder() -> Path:
    """The folder of the default socket: ``$XDG_RUNTIME_DIR/tca``, or ``/tmp/tca-<user id>``. It may not exist."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "tca" if runtime else Path("/tmp") / f"tca-{os.getuid()}"  # noqa: S108


def default_endpoint() -> str:
    """The ZeroMQ address of central: ``$TCA_CENTRAL`` or the default socket."""
    return os.environ.get(VARIABLE) or f"ipc://{default_folder() / 'central.sock'}"
