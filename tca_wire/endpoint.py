"""Central's default address and journal folder, which belong to the user."""

import os
import re
import time
from collections.abc import Iterable
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path

VARIABLE = "TCA_CENTRAL"

IS_STARTED_VARIABLE = "TCA_CENTRAL_IS_STARTED"
"""Set for a program whose starter also starts central: a short wait for central needs no advice."""

_NUMBER_DIGITS = 6
_TCP = re.compile(r"tcp://[A-Za-z0-9\[][A-Za-z0-9.:%;_\[\]-]*:([0-9]{1,5})")
_LONGEST_SOCKET = len("ipc://") + 107
"""Bytes in the address of a Unix socket."""
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
    """Return the ZeroMQ address of central: ``$TCA_CENTRAL`` or the default socket.

    The variable may have several addresses; see ``addresses_in``.
    """
    return os.environ.get(VARIABLE) or f"ipc://{default_folder() / 'central.sock'}"


class BadAddresses(ValueError):
    """A list of central's addresses is invalid. The message names the address and what to do."""


def addresses_in(text: str) -> list[str]:
    """Return the addresses in a list with commas. One central at a time leads at one of them.

    A text without a comma is one address, which is not checked. Raises BadAddresses.

    Example:
        >>> addresses_in("tcp://10.0.0.1:7400, tcp://10.0.0.2:7400")
        ['tcp://10.0.0.1:7400', 'tcp://10.0.0.2:7400']
    """
    if "," not in text:
        return [text]
    addresses = [one.strip() for one in text.split(",")]
    for number, one in enumerate(addresses):
        if not one:
            why = "an address is empty: give one on both sides of each comma"
        elif not _is_address(one):
            why = f"'{one}' is not an address: use ipc:///path/of/socket or tcp://host:port"
        elif one in addresses[:number]:
            why = f"'{one}' is there twice: leave one out"
        elif one[:3] != addresses[0][:3]:
            why = f"'{one}' is not of the kind of '{addresses[0]}': use only ipc:// or only tcp://"
        else:
            continue
        raise BadAddresses(f"the list of central's addresses, '{text}': {why}")
    return addresses


def _is_address(text: str) -> bool:
    if text.startswith("ipc:///"):
        return len(os.fsencode(text)) <= _LONGEST_SOCKET
    found = _TCP.fullmatch(text)
    return found is not None and 0 < int(found[1]) < 1 << 16


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
