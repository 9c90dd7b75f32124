"""The processes that a contestant starts: they end with it, whatever happens."""

import itertools
import os
import shutil
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tca_tools.supervise.programs import Programs

_OF_A_PROCESS = 2
"""In the number of a clock of Linux, beside that of the process."""
_PATIENCE = 3.0  # seconds until what does not end is killed


class Children:
    """Servers in Python, and other programs; each is named by the number of its process."""

    def __init__(self) -> None:
        self._programs: Programs | None = None  #: while there are any
        self._names = itertools.count()

    def serve(self, target: Callable[..., None], *arguments: Any) -> int:
        """Run a function of ours in a process of its own; the process' number."""
        spec = sys.modules[target.__module__].__spec__
        assert spec is not None
        code = f"from pathlib import PosixPath; from {spec.name} import {target.__name__} as serve; serve(*{arguments})"
        return self.program(sys.executable, "-c", code)

    def program(self, *command: object, **options: Any) -> int:
        """Start a program that says nothing; the process' number."""
        if self._programs is None:
            self._programs = Programs(grace=_PATIENCE).__enter__()
        return self._programs.start(f"{next(self._names)}", *map(str, command), **options)

    def central(self, folder: Path, *options: str) -> int:
        """Start central at ``address_in(folder)``."""
        command = (
            sys.executable,
            "-m",
            "tca_central",
            "--quiet",
            "--bind",
            address_in(folder),
            *options,
        )
        return self.program(*command, ends_last=True)

    def end(self, process: int) -> None:
        """End one."""
        assert self._programs is not None
        self._programs.stop(
            *(name for name, number in self._programs.numbers().items() if number == process)
        )

    def stop(self) -> None:
        """End all, central last."""
        if self._programs is not None:
            self._programs.__exit__()
            self._programs = None


def address_in(folder: Path) -> str:
    """Central's address."""
    return f"ipc://{folder}/central.sock"


def program_path(name: str) -> str | None:
    """Where a program is: beside this Python, on the path, or where Debian has its daemons."""
    return shutil.which(
        name,
        path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"], "/usr/sbin"]),
    )


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
