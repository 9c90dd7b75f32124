"""The robots of a team and their addresses: a file with a line for each.

::

    turtle1 = "192.168.1.11:7500"
    turtle2 = "192.168.1.12:7500"
"""

import socket
import tomllib
from contextlib import ExitStack
from pathlib import Path

from robots.turtle_sim.errors import BadTeam

Address = tuple[str, int]
Team = dict[str, Address]


def free_team(*names: str) -> Team:
    """Return a team on this machine, at free ports, for shows and tests."""
    with ExitStack() as stack:
        sockets = [
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in names
        ]
        for opened in sockets:
            opened.bind(("127.0.0.1", 0))
        return dict(zip(names, (opened.getsockname() for opened in sockets), strict=True))


def save_team(team: Team, path: Path) -> None:
    """Write a team's file."""
    path.write_text("".join(f'"{name}" = "{host}:{port}"\n' for name, (host, port) in team.items()))


def load_team(path: Path | str) -> Team:
    """Read a team's file, and resolve the host names. Raises BadTeam."""
    try:
        addresses = tomllib.loads(Path(path).read_text())
    except (OSError, ValueError) as error:
        raise BadTeam(f"the team's file {path} can't be read: {error}") from None
    return {name: parse_address(name, text) for name, text in addresses.items()}


def parse_address(name: str, text: object) -> Address:
    """Parse the address of the robot *name*. Raises BadTeam."""
    host, _, port = text.rpartition(":") if isinstance(text, str) else ("", "", "")
    if not host or not port.isdecimal() or int(port) >= 2**16:
        raise BadTeam(
            f"the address of '{name}' is HOST:PORT, as in {name} = \"127.0.0.1:7500\","
            f" not {text!r:.60}"
        )
    try:
        return socket.gethostbyname(host), int(port)
    except OSError as error:
        raise BadTeam(f"the host '{host}' of '{name}' does not exist: {error}") from None
