"""Programs that a show, a benchmark or a test starts and ends: central and others, each with a log file of its own.

``tca run`` keeps programs running; here it is the caller who says what is to start, stop or be killed.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from tca_module import Message, Sender, SentTask, TcaError, Timeout
from tca_tools.supervise import guard
from tca_tools.supervise.guarded import GuardedProcesses
from tca_wire.endpoint import VARIABLE

GRACE = 10.0
"""Seconds that a program has to finish what it is doing."""

START_TIME = 60.0
"""Seconds within which all programs must be there."""

_LOOK = 1.0
"""Seconds between two looks at whether they still are."""


class ProgramEnded(TcaError):
    """A program has ended by itself."""


class Programs:
    """Programs by name. Leaving the block ends them, central last; if this process is killed they end, too."""

    def __init__(self, folder: Path | None = None, *, address: str = "", grace: float = GRACE) -> None:
        """*folder*: the place of their logs; without one what they print is dropped. *address*: central's, for all."""
        self._folder = folder
        self._environment = {**os.environ, VARIABLE: address} if address else None
        self._grace = grace
        self._guarded: GuardedProcesses | None = None
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._starts: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all."""
        try:
            for ends_last in (False, True):
                self.stop(*(name for name in self._running if self._starts[name][1]["ends_last"] == ends_last))
        finally:
            for name in list(self._running):  # Ctrl-C: somebody does not want to wait
                self.kill(name)
            if self._guarded is not None:
                self._guarded.__exit__()
                self._guarded = None

    # --- what is to run ----------------------------------------------------------------------------------------------

    def start(self, name: str, *command: str, ends_last: bool = False, **options: Any) -> int:
        """Start a program under this name, with options of ``subprocess.Popen``; the number of its process."""
        if self._guarded is None:
            self._guarded = GuardedProcesses("their starter", self._grace).__enter__()
        self._starts[name] = command, {"ends_last": ends_last, **options}
        with Path(os.devnull).open("ab") if self._folder is None else self.log(name).open("ab") as output:
            options = {"env": self._environment, "stdout": output, "stderr": output, **options}
            self._running[name] = self._guarded.start(command, ends_last=ends_last, **options)
        return self._running[name].pid

    def start_module(self, name: str, module: str, *arguments: str, ends_last: bool = False) -> int:
        """Start a Python module under this name; the number of its process."""
        return self.start(name, sys.executable, "-m", module, *arguments, ends_last=ends_last)

    def stop(self, *names: str) -> list[int]:
        """Let programs finish, and wait; those that do not end in time are killed. Their exit codes."""
        guard.end_all({self._running[name].pid: self._grace for name in names})
        return [self.kill(name) for name in names]

    def kill(self, name: str) -> int:
        """Kill a program; its exit code, if it has ended already."""
        assert self._guarded is not None
        process = self._running.pop(name)
        process.kill()
        return self._guarded.wait(process)

    def kill_and_restart(self, name: str) -> int:
        """Kill a program, and run it once more; the number of the new process."""
        self.kill(name)
        command, options = self._starts[name]
        return self.start(name, *command, **options)

    def halt(self, name: str) -> None:
        """Have a program stand still: it takes what it is sent, and does nothing."""
        guard.send(self._running[name].pid, signal.SIGSTOP)

    # --- how they are ------------------------------------------------------------------------------------------------

    def numbers(self) -> dict[str, int]:
        """The numbers of the programs' processes."""
        return {name: process.pid for name, process in list(self._running.items())}

    def check(self) -> None:
        """Raise ProgramEnded if one has ended by itself."""
        for name, process in list(self._running.items()):
            if process.poll() is not None:
                raise ProgramEnded(f"{name} has ended: see {self.log(name)}")

    def wait_until_handled(self, sender: Sender, *messages: Message[Any, Any], timeout: float = START_TIME) -> None:
        """Wait until programs handle each of these messages. Raises ProgramEnded and Timeout."""
        deadline = time.monotonic() + timeout
        while True:
            self.check()
            try:
                return sender.wait_until_handled(*messages, timeout=_LOOK)
            except Timeout:
                if time.monotonic() > deadline:
                    raise

    def looks(self, task: SentTask[Any], period: float = 0.1) -> Iterator[bool]:
        """Time to look at a task, until it has ended: whether it has. Raises ProgramEnded if a program does before."""
        while True:
            try:
                task.wait(period)
            except Timeout:
                self.check()
                yield False
            else:
                yield True
                return

    def log(self, name: str) -> Path:
        """The file that a program's output goes to."""
        assert self._folder is not None, "there are no logs without a folder"
        return self._folder / f"{name.replace(' ', '_')}.log"


@contextmanager
def central_in(folder: Path, prefix: str = "", *, is_fresh: bool = True) -> Iterator[tuple[str, Programs]]:
    """Central, with a journal in the folder: its address, and the programs beside it.

    Args:
        folder: the place of the journal and of what the programs print.
        prefix: the beginning of their names there.
        is_fresh: a new run begins also where one is unfinished. False: it continues, as after central was killed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="show") as sockets:
        address = f"ipc://{sockets}/central.sock"
        with Programs(folder, address=address) as programs:
            options = ["--journal", str(folder / f"{prefix}journal"), *["--fresh"] * is_fresh]
            programs.start_module(f"{prefix}central", "tca_central", *options, ends_last=True)
            yield address, programs
