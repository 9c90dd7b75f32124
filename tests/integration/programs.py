"""Real centrals and modules as processes, for tests: started here, stopped here, their output kept."""

import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

MODULE = (sys.executable, "-m", "tca_central")


class Central:
    """A running daemon."""

    def __init__(self, folder: Path, *options: str, bind: str = "", command: Sequence[str] = MODULE) -> None:
        folder.mkdir(exist_ok=True)
        self.address = bind or f"ipc://{folder}/central.sock"
        self.journal = folder / "journal"
        if bind.startswith("tcp://") and "TCA_KEYS" not in os.environ:
            options = (*options, "--insecure")
        command = [*command, "--bind", self.address, "--journal", str(self.journal), *options]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        assert self.process.stderr
        self.first_line = "" if "--quiet" in options else self.process.stderr.readline().strip()

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def stop(self) -> str:
        """End it; everything that it said since the first line."""
        if self.process.poll() is None:
            self.process.terminate()
        return self.process.communicate(timeout=10)[1]


@contextmanager
def central(folder: Path, *options: str, bind: str = "", command: Sequence[str] = MODULE) -> Iterator[Central]:
    running = Central(folder, *options, bind=bind, command=command)
    try:
        yield running
    finally:
        running.signal(signal.SIGCONT)
        running.stop()


@contextmanager
def program(text: str, address: str) -> Iterator[subprocess.Popen[str]]:
    """A Python program as a module's process. It runs when it has printed a line."""
    running = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(text)], text=True, env={**os.environ, "TCA_CENTRAL": address, "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield running
    finally:
        if running.poll() is None:
            running.send_signal(signal.SIGCONT)
            running.kill()
        running.communicate()


def run(*command: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """A command of ours, to its end."""
    return subprocess.run(
        [sys.executable, "-m", *command], capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, **environment},
    )  # fmt: skip


def tca(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """The command ``tca`` as it was installed."""
    command = str(Path(sys.executable).with_name("tca"))
    return subprocess.run([command, *arguments], capture_output=True, text=True, timeout=60, check=False)
