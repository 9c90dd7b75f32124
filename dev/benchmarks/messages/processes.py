"""The processes that a contestant starts: all in its own group, so that they end with it, whatever happens."""

import multiprocessing
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

_OF_A_PROCESS = 2
"""In the number of a clock of Linux, beside that of the process."""
_PATIENCE = 3.0  # seconds until what does not end is killed


class Children:
    """Servers in Python, and other programs."""

    def __init__(self) -> None:
        self._servers: list[multiprocessing.process.BaseProcess] = []
        self._programs: list[subprocess.Popen[bytes]] = []

    def serve(self, target: Callable[..., None], *arguments: Any) -> int:
        """Run a function of ours in a process of its own; the process' number."""
        server = multiprocessing.get_context("spawn").Process(target=target, args=arguments, daemon=True)
        server.start()
        self._servers.append(server)
        assert server.pid is not None
        return server.pid

    def program(self, *command: object, **options: Any) -> int:
        """Start a program that says nothing; the process' number."""
        words, silent = [str(word) for word in command], subprocess.DEVNULL
        running = subprocess.Popen(words, stdin=silent, stdout=silent, stderr=silent, **options)
        self._programs.append(running)
        return running.pid

    def central(self, folder: Path, *options: str) -> int:
        """Start central at ``address_in(folder)``."""
        return self.program(sys.executable, "-m", "tca_central", "--quiet", "--bind", address_in(folder), *options)

    def stop(self) -> None:
        """End the servers, then the programs."""
        for server in self._servers:
            server.terminate()
        for server in self._servers:
            server.join(_PATIENCE)
            if server.exitcode is None:
                server.kill()
        for program in self._programs:
            program.terminate()
        for program in self._programs:
            try:
                program.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                program.kill()
                program.wait()
        self._servers, self._programs = [], []


def address_in(folder: Path) -> str:
    """Central's address."""
    return f"ipc://{folder}/central.sock"


def program_path(name: str) -> str | None:
    """Where a program is: beside this Python, on the path, or where Debian has its daemons."""
    return shutil.which(name, path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"], "/usr/sbin"]))


def free_port() -> int:
    """A port of this machine that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def processor_seconds(process: int) -> float:
    """How long a process has used a processor."""
    return time.clock_gettime((~process << 3) | _OF_A_PROCESS)


def resident_bytes(process: int) -> int:
    """The memory that a process has."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
