"""``tca replay`` on a real terminal: which keys end it, however fast they are typed."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from tools.runs import encoded, walk

pytestmark = pytest.mark.slow

SOON = 30.0
ENTER, LINE_END, CONTROL_C = "\r", "\n", "\x03"


class Terminal:
    """A program that runs on a terminal of its own."""

    def __init__(self, process: "subprocess.Popen[bytes]", end: int) -> None:
        self.process = process
        self._end = end

    def type(self, keys: str) -> None:
        os.write(self._end, keys.encode())

    def wait_for(self, text: str) -> None:
        """Read what it draws until *text* is among it."""
        seen = ""
        while text not in seen:
            drawn = self._read()
            assert drawn, f"{text!r} was never drawn: {seen[-500:]!r}"
            seen += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", drawn.decode(errors="replace"))

    def exit_code(self) -> int:
        """Let it draw until it ends."""
        deadline = time.monotonic() + SOON
        while self.process.poll() is None and time.monotonic() < deadline:
            self._read(0.1)
        return self.process.wait(timeout=0)

    def _read(self, seconds: float = SOON) -> bytes:
        ready, _, _ = select.select([self._end], [], [], seconds)
        try:
            return os.read(self._end, 65536) if ready else b""
        except OSError:  # the program has gone
            return b""


@contextmanager
def replaying(path: Path) -> Iterator[Terminal]:
    ours, its = pty.openpty()
    command = [sys.executable, "-c", "from tca_tools.command_line import main; main()", "replay", str(path)]
    environment = {**os.environ, "TERM": "xterm-256color", "LINES": "40", "COLUMNS": "120"}
    process = subprocess.Popen(command, stdin=its, stdout=its, stderr=its, env=environment, start_new_session=True)
    os.close(its)
    try:
        terminal = Terminal(process, ours)
        terminal.wait_for("task tree")
        yield terminal
    finally:
        process.kill()
        process.wait()
        os.close(ours)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    return path


@pytest.mark.parametrize(
    "keys",
    [
        "q",
        CONTROL_C,
        "/" + CONTROL_C,
        "/nothing like it" + ENTER + "q",  # as fast as a program types
        "gsoon" + LINE_END + "q",
    ],
)
def test_keys_that_end_it(run: Path, keys: str) -> None:
    with replaying(run) as terminal:
        terminal.type(keys)
        assert terminal.exit_code() == 0


def test_a_q_that_is_looked_for_does_not_end_it_and_an_interrupt_does(run: Path) -> None:
    with replaying(run) as terminal:
        terminal.type("/quest" + ENTER)
        terminal.wait_for("no task 'quest'")
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.exit_code() in (0, 130)
