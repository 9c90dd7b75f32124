"""Real NATS servers for tests: a cluster on this computer, whose servers die and return."""

import signal
import socket
import subprocess
import sysconfig
from collections.abc import Callable
from pathlib import Path

SERVER = Path(sysconfig.get_path("scripts")) / "nats-server"


class NatsServers:
    """A cluster of servers with JetStream.

    Args:
        folder: The folder for their files.
        number: The number of servers.
        store: Bytes that each one may store; 0: no JetStream.
        more: More lines of their configuration.
        route: Returns the port for a route from one server to another, and its port.
    """

    def __init__(
        self,
        folder: Path,
        number: int = 3,
        *,
        store: int = 1 << 30,
        more: str = "",
        route: Callable[[int, int, int], int] = lambda _one, _other, port: port,
    ) -> None:
        self._held: list[socket.socket] = []
        self.ports = [self.held_port() for _ in range(number)]
        listening = [self.held_port() for _ in range(number)]
        self._listening = listening
        self._routes = [
            [route(one, other, listening[other]) for other in range(number) if other != one]
            for one in range(number)
        ]
        self._folder, self.store, self._more = folder, store, more
        self.processes: list[subprocess.Popen[bytes] | None] = [None] * number
        for one in range(number):
            self.start(one)

    def address(self, name: str = "robot") -> str:
        """Return the address of a log on these servers."""
        return f"nats://{','.join(f'127.0.0.1:{port}' for port in self.ports)}/{name}"

    def start(self, number: int) -> None:
        """Start a server, or start it again."""
        folder = self._folder / f"nats{number}"
        folder.mkdir(parents=True, exist_ok=True)
        routes = ", ".join(f'"nats://127.0.0.1:{port}"' for port in self._routes[number])
        # Servers and clients use the addresses that they were given, and learn no others.
        cluster = (
            f'cluster {{ name: tests, listen: "127.0.0.1:{self._listening[number]}", '
            f'advertise: "127.0.0.1:1", no_advertise: true, routes: [{routes}] }}\n'
            if len(self.ports) > 1
            else ""
        )
        jetstream = f'jetstream {{ store_dir: "{folder}/store", max_file_store: {self.store} }}\n'
        (folder / "server.conf").write_text(
            f'server_name: s{number}\nlisten: "127.0.0.1:{self.ports[number]}"\n{cluster}'
            f"{jetstream if self.store else ''}{self._more}\n"
        )
        self.processes[number] = subprocess.Popen(
            [SERVER, "-c", folder / "server.conf", "-l", folder / "server.log"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def kill(self, number: int) -> None:
        """Kill a server, if it runs."""
        if (process := self.processes[number]) is not None:
            process.kill()
            process.wait()
            self.processes[number] = None

    def end(self, number: int) -> None:
        """Ask a server to end, and wait until it has ended."""
        if (process := self.processes[number]) is not None:
            process.send_signal(signal.SIGINT)
            process.wait()
            self.processes[number] = None

    def stop(self, number: int) -> None:
        """Let a server stand still."""
        self._signal(number, signal.SIGSTOP)

    def resume(self, number: int) -> None:
        """Let a server that stands still continue."""
        self._signal(number, signal.SIGCONT)

    def _signal(self, number: int, which: signal.Signals) -> None:
        if (process := self.processes[number]) is not None:
            process.send_signal(which)

    def close(self) -> None:
        """Kill all servers."""
        for number in range(len(self.processes)):
            self.kill(number)
        for one in self._held:
            one.close()

    def held_port(self) -> int:
        """Return a port that no other program gets, also while its server does not run."""
        held = socket.socket()
        held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # servers set it, too
        held.bind(("127.0.0.1", 0))
        self._held.append(held)
        return int(held.getsockname()[1])


def free_port() -> int:
    """Return a port that no program uses now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
