"""Central's default address and journal folder: a socket and folders of its user's own."""

import os
import time
from collections.abc import Iterable
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path

VARIABLE = "TCA_CENTRAL"

_DIGITS = 6
_HERE = (
    "tcp://127.0.0.1",
    "tcp://localhost",
    "tcp://[::1]",
    "tcp://0.0.0.0",
    "tcp://*",
    "tcp://[::]",
)


def default_folder() -> Path:
    """The folder of the default socket: ``$XDG_RUNTIME_DIR/tca``, or ``/tmp/tca-<user id>``. It may
    not exist.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "tca" if runtime else Path("/tmp") / f"tca-{os.getuid()}"  # noqa: S108


def default_endpoint() -> str:
    """The ZeroMQ address of central: ``$TCA_CENTRAL`` or the default socket."""
    return os.environ.get(VARIABLE) or f"ipc://{default_folder() / 'central.sock'}"


class NoHome(RuntimeError):
    """The user has no home folder, and the variable that names another folder is not set."""


def home(instead: str) -> Path:
    """The user's home folder. Raises NoHome, which names the variable that can be set *instead*."""
    try:
        return Path.home()
    except RuntimeError:
        msg = f"the user {os.getuid()} has no home folder: set HOME, or {instead} to a folder"
        raise NoHome(msg) from None


def default_journals() -> Path:
    """The folder that holds a journal per run: ``$XDG_STATE_HOME/tca/journals``, or below
    ``~/.local/state``.
    """
    state = os.environ.get("XDG_STATE_HOME") or home("XDG_STATE_HOME") / ".local" / "state"
    return Path(state) / "tca" / "journals"


def new_journal() -> Path:
    """The folder of a run that begins now. Its name begins with a number: a robot's clock may not
    order runs.
    """
    folder = default_journals()
    last = max(map(run_number, folder.iterdir()), default=0) if folder.is_dir() else 0
    return folder / f"{last + 1:0{_DIGITS}}-{time.strftime('%Y-%m-%dT%H-%M-%S')}-{os.getpid()}"


def run_number(folder: Path) -> int:
    """The number of the run in a folder that ``new_journal`` has named: a later run has a larger
    one; else 0.
    """
    number, _, _ = folder.name.partition("-")
    return int(number) if len(number) >= _DIGITS and number.isdecimal() else 0


def by_number(folders: Iterable[Path]) -> list[Path]:
    """Folders of runs as they began; those without a number come first, by name."""
    return sorted(folders, key=lambda folder: (run_number(folder), folder.name))


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches an address. Names may lead anywhere, so only that of
    ``localhost`` counts.
    """
    host = address.removeprefix("tcp://").rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def journal_link(address: str) -> Path:
    """The link that the central at an address leaves to its journal, if any. All names of a local
    port are one.
    """
    host, _, port = address.rpartition(":")
    key = f"port {port}" if host in _HERE else address
    return default_journals().parent / "centrals" / sha256(key.encode()).hexdigest()[:16]
