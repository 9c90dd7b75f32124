"""Central's default address and journal folder: a socket and folders of its user's own."""

import os
from hashlib import sha256
from pathlib import Path

VARIABLE = "TCA_CENTRAL"

_HERE = ("tcp://127.0.0.1", "tcp://localhost", "tcp://[::1]", "tcp://0.0.0.0", "tcp://*", "tcp://[::]")


def default_folder() -> Path:
    """The folder of the default socket: ``$XDG_RUNTIME_DIR/tca``, or ``/tmp/tca-<user id>``. It may not exist."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "tca" if runtime else Path("/tmp") / f"tca-{os.getuid()}"  # noqa: S108


def default_endpoint() -> str:
    """The ZeroMQ address of central: ``$TCA_CENTRAL`` or the default socket."""
    return os.environ.get(VARIABLE) or f"ipc://{default_folder() / 'central.sock'}"


def default_journals() -> Path:
    """The folder that holds a journal per run: ``$XDG_STATE_HOME/tca/journals``, or below ``~/.local/state``."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "tca" / "journals"


def journal_link(address: str) -> Path:
    """The link that the central at an address leaves to its journal, if any. All names of a local port are one."""
    host, _, port = address.rpartition(":")
    key = f"port {port}" if host in _HERE else address
    return default_journals().parent / "centrals" / sha256(key.encode()).hexdigest()[:16]
