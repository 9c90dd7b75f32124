"""The processes that a contestant starts. They end with the contestant, whatever happens."""

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

_SCHEDULED_TIME = 2
"""Linux: the kind of a process's clock that counts its processor time, to the nanosecond."""
_PATIENCE = 3.0  # seconds until a process that does not end is killed


class Children:
    """Servers in Python, and other programs; each is identified by its process number."""

    def __init__(self) -> None:
        self._programs: Programs | None = None  #: None before the first
        self._names = itertools.count()

    def serve(self, target: Callable[..., None], *arguments: Any) -> int:
        """Run a function of ours in a process of its own; return the process number."""
        spec = sys.modules[target.__module__].__spec__
        assert spec is not None
        code = (
            f"from pathlib import PosixPath; from {spec.name} import {target.__name__} as serve;"
            f" serve(*{arguments})"
        )
        return self.program(sys.executable, "-c", code)

    def program(self, *command: object, **options: Any) -> int:
        """Start a program without output; return the process number."""
        if self._programs is None:
            self._programs = Programs(grace=_PATIENCE).__enter__()
        return self._programs.start(f"{next(self._names)}", *map(str, command), **options)

    def central(self, folder: Path, *options: str) -> int:
        """Start central at ``address_in(folder)``."""
        program = (sys.executable, "-m", "tca_central", "--quiet")
        where = ("--bind", address_in(folder))
        return self.program(*program, *where, *options, ends_last=True)

    def stop_one(self, process: int) -> None:
        """Stop one process."""
        assert self._programs is not None
        numbers = self._programs.numbers()
        self._programs.stop(*(name for name, number in numbers.items() if number == process))

    def close(self) -> None:
        """Stop all processes, central last."""
        if self._programs is not None:
            self._programs.__exit__()
            self._programs = None


def address_in(folder: Path) -> str:
    """Return central's address."""
    return f"ipc://{folder}/central.sock"


def program_path(name: str) -> str | None:
    """Return a program's path: beside this Python, on the PATH, or in /usr/sbin."""
    return shutil.which(
        name,
        path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"], "/usr/sbin"]),
    )


def free_port() -> int:
    """Return an unused port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def processor_seconds(process: int) -> float:
    """Return the processor time of a process."""
    return time.clock_gettime((~process << 3) | _SCHEDULED_TIME)


def resident_bytes(process: int) -> int:
    """Return the memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
