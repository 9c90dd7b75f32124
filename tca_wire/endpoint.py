"""Central's default address and journal folder, which belong to the user."""

import os
import time
from collections.abc import Iterable
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path

VARIABLE = "TCA_CENTRAL"

IS_STARTED_VARIABLE = "TCA_CENTRAL_IS_STARTED"
"""Set for a program whose starter also starts central: a short wait for central needs no advice."""

_NUMBER_DIGITS = 6
_LOCAL_HOSTS = (
    "tcp://127.0.0.1",
    "tcp://localhost",
    "tcp://[::1]",
    "tcp://0.0.0.0",
    "tcp://*",
    "tcp://[::]",
)


def default_folder() -> Path:
    """Return the folder of the default socket: ``$XDG_RUNTIME_DIR/tca``, or ``/tmp/tca-<user id>``.

    It may not exist.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "tca" if runtime else Path("/tmp") / f"tca-{os.getuid()}"  # noqa: S108


def default_endpoint() -> str:
    """Return the ZeroMQ address of central: ``$TCA_CENTRAL`` or the default socket."""
    return os.environ.get(VARIABLE) or f"ipc://{default_folder() / 'central.sock'}"


class NoHome(RuntimeError):
    """The user has no home folder, and the variable that names another folder is not set."""


def home(variable: str) -> Path:
    """Return the user's home folder. Raises NoHome, which names the *variable* to set instead."""
    try:
        return Path.home()
    except RuntimeError:
        msg = f"the user {os.getuid()} has no home folder: set HOME, or {variable} to a folder"
        raise NoHome(msg) from None


def default_journals() -> Path:
    """Return the folder with one journal per run: ``$XDG_STATE_HOME/tca/journals``.

    Without that variable it is below ``~/.local/state``.
    """
    state = os.environ.get("XDG_STATE_HOME") or home("XDG_STATE_HOME") / ".local" / "state"
    return Path(state) / "tca" / "journals"


def new_journal() -> Path:
    """Return the folder for a run that starts now.

    Its name begins with a number, by which the runs are ordered: a robot's clock may jump.
    """
    folder = default_journals()
    newest = max(map(run_number, folder.iterdir()), default=0) if folder.is_dir() else 0
    return (
        folder
        / f"{newest + 1:0{_NUMBER_DIGITS}}-{time.strftime('%Y-%m-%dT%H-%M-%S')}-{os.getpid()}"
    )


def run_number(folder: Path) -> int:
    """Return the number of the run in a folder from ``new_journal``; later runs have larger ones.

    For other folders it is 0.
    """
    number, _, _ = folder.name.partition("-")
    return int(number) if len(number) >= _NUMBER_DIGITS and number.isdecimal() else 0


def by_number(folders: Iterable[Path]) -> list[Path]:
    """Sort folders of runs by their start; those without a number come first, by name."""
    return sorted(folders, key=lambda folder: (run_number(folder), folder.name))


def is_loopback(address: str) -> bool:
    """Return whether only this machine reaches an address.

    The only name that counts is ``localhost``: other names may resolve to any machine.
    """
    host = address.removeprefix("tcp://").rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def journal_link(address: str) -> Path:
    """Return the link that the central at an address leaves to its journal, if any.

    All names of a local port share one link.
    """
    host, _, port = address.rpartition(":")
    key = f"port {port}" if host in _LOCAL_HOSTS else address
    return default_journals().parent / "centrals" / sha256(key.encode()).hexdigest()[:16]
