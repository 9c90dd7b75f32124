"""Starting and stopping the programs of a robot on this machine, each a process with a log file of its own."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Self

GRACE = 10.0
"""Seconds that a program has to finish what it is doing."""


class Processes:
    """The programs that were started, in that order; leaving the block stops them in the opposite order."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._environment = {**os.environ, **environment}
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._commands: dict[str, tuple[str, ...]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            for name in reversed(list(self._running)):
                self.stop(name)
        except KeyboardInterrupt:  # somebody does not want to wait
            for process in self._running.values():
                process.kill()
                process.wait()
            raise

    def start(self, name: str, module: str, *arguments: str) -> None:
        """Run a Python module under this name."""
        self._commands[name] = module, *arguments
        with self.log(name).open("ab") as log:
            # A session of its own: Ctrl-C in the terminal is for the one who started it, who stops the others in order.
            self._running[name] = subprocess.Popen(
                [sys.executable, "-m", module, *arguments], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                env=self._environment, start_new_session=True,
            )  # fmt: skip

    def stop(self, name: str) -> int:
        """Let a program finish, and wait; one that does not end in time is killed. Its exit code."""
        process = self._running.pop(name)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            process.send_signal(signal.SIGCONT)  # it may have been halted
        try:
            return process.wait(GRACE)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()
        except KeyboardInterrupt:
            process.kill()
            process.wait()
            raise

    def kill_and_restart(self, name: str) -> int:
        """Kill a program, and run it once more; the number of the new process."""
        process = self._running.pop(name)
        process.kill()
        process.wait()
        self.start(name, *self._commands[name])
        return self._running[name].pid

    def numbers(self) -> dict[str, int]:
        """The numbers of the programs' processes."""
        return {name: process.pid for name, process in list(self._running.items())}

    def halt(self, name: str) -> None:
        """Have a program stand still: it takes what it is sent, and does nothing."""
        self._running[name].send_signal(signal.SIGSTOP)

    def ended(self) -> str | None:
        """The name of a program that ended by itself, if any has."""
        return next((name for name, process in list(self._running.items()) if process.poll() is not None), None)

    def log(self, name: str) -> Path:
        """The file that a program's output goes to."""
        return self._folder / f"{name.replace(' ', '_')}.log"
