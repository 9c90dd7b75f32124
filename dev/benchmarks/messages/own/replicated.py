"""Central with the library, on a replicated log of three servers, with a standby."""

import sys

from dev.benchmarks.messages.own.library import Library
from dev.benchmarks.messages.processes import free_port, program_path

SERVERS = 3


class Replicated(Library):
    """As the library, but each turn waits for the servers. They have a standby's reads, too.

    Args:
        sync: When servers bring messages to the disk, as ``sync_interval``.
    """

    def __init__(self, sync: str = "2m") -> None:
        super().__init__()
        self._sync = sync

    def log_options(self) -> tuple[str, ...]:
        ports, routes = ([free_port() for _ in range(SERVERS)] for _ in range(2))
        for number in range(SERVERS):
            file = self.folder / f"nats{number}.conf"
            others = ", ".join(f'"nats://127.0.0.1:{port}"' for port in routes)
            file.write_text(
                f'server_name: s{number}\nlisten: "127.0.0.1:{ports[number]}"\n'
                f'jetstream {{ store_dir: "{self.folder}/store{number}", '
                f"sync_interval: {self._sync} }}\n"
                f'cluster {{ name: bench, listen: "127.0.0.1:{routes[number]}", '
                f"routes: [{others}] }}\n"
            )
            self.children.program(program_path("nats-server"), "-c", file, ends_last=True)
        log = f"nats://{','.join(f'127.0.0.1:{port}' for port in ports)}/bench"
        self.children.program(
            sys.executable,
            "-c",
            "from tca_tools.live.central import standby; standby()",
            *("--quiet", "--log", log, "--bind", f"ipc://{self.folder}/standby.sock"),
            *("--journal", self.folder / "standby"),
        )
        return ("--log", log)
