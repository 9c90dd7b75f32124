"""A process of ``tca run``, with its robot file and its output."""

import os
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from module.real_central import until
from processes import Process

from tca_tools.supervise import guard

SOON = 30.0
HASTY = "[run]\ndelay = 0.05\nlongest_delay = 0.2\ngrace = 20\n"
NO_CENTRAL = "[central]\nstart = false\naddress = 'ipc:///nowhere'\n"


class Running:
    """A running ``tca run``."""

    def __init__(self, folder: Path, text: str, *options: str) -> None:
        (folder / "robot.toml").write_text(text)
        self.process = Process("tca", "run", *options, str(folder / "robot.toml"))
        self.said = ""
        self.groups: dict[str, int] = {}  #: the newest process of each program

    def hear(self, pattern: str) -> re.Match[str]:
        """Read lines until one matches a pattern."""
        with self.process.killed_after(SOON):
            for line in self.process.stdout:
                self._record(line)
                if found := re.search(pattern, line):
                    return found
        raise AssertionError(f"no {pattern!r} in\n{self.said}")

    def _record(self, line: str) -> None:
        self.said += line
        if started := re.search(r"\| (\S+) started \(process (\d+)\)", line):
            self.groups[started[1]] = int(started[2])

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def end(self) -> tuple[int, str]:
        """Wait for the end. Return the exit code and standard error."""
        for line in self.process.stdout:
            self._record(line)
        errors = self.process.stderr.read()
        return self.process.wait(SOON), errors

    def leaves_nothing(self) -> None:
        """Wait until all processes that ``tca run`` started have ended."""
        for name, group in self.groups.items():
            _await_end(name, group)


def _await_end(name: str, group: int) -> None:
    until(lambda: not guard.is_alive(group), f"{name} has ended")


@contextmanager
def robot(folder: Path, text: str, *options: str) -> Iterator[Running]:
    running = Running(folder, text, *options)
    try:
        yield running
    finally:
        running.process.close()
        for group in running.groups.values():
            guard.send(group, signal.SIGKILL)


def guards_of(process: int) -> list[int]:
    """Return the current guards of a process ``tca run``."""
    children = [
        child
        for file in Path(f"/proc/{process}/task").glob("*/children")
        for child in file.read_text().split()
    ]
    return [
        int(child) for child in children if "guard.py" in Path(f"/proc/{child}/cmdline").read_text()
    ]


def kill(process: int, number: signal.Signals = signal.SIGKILL) -> None:
    os.kill(process, number)
