"""``tca top`` in a real terminal, beside a real central and real modules."""

import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from click.testing import CliRunner
from integration.programs import central, program

from tca_live.top import top

pytestmark = pytest.mark.slow

SOON = 60.0
ROBOT = """
    import time
    from tca_module import Command, Module, Query
    STEP, WHERE = Command("step", int), Query("where", int, reply=int)
    legs, map_ = Module("legs"), Module("map")
    legs.handles(STEP)(lambda task, number: task.query(WHERE, number) and None)
    map_.handles(WHERE)(lambda _, number: time.sleep(0.02) or number)
    with legs.running(), map_.running():
        print("ready", flush=True)
        while True:
            legs.command(STEP, 1).wait()
"""


class Terminal:
    """A command in a terminal of its own."""

    def __init__(self, address: str, *options: str) -> None:
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 200, 0, 0))
        self.before = termios.tcgetattr(slave)
        self.slave = slave
        self.seen = ""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tca_live.top", *(("--central", address) if address else ()), *options],
            stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
            env={**os.environ, "TERM": "xterm-256color"} | dict.fromkeys(("COLUMNS", "LINES"), ""),
        )  # fmt: skip

    def shows(self, pattern: str) -> str:
        """Read on until *pattern* is on the screen; what it matched. Forgets what came before."""
        end = time.monotonic() + SOON
        while not (found := re.search(pattern, self.seen)):
            assert time.monotonic() < end, f"{pattern!r} is not in:\n{self.seen[-4000:]}"
            assert self.process.poll() is None, self.seen[-4000:]
            if select.select([self.master], [], [], 0.1)[0]:
                self.seen += re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", os.read(self.master, 65536).decode(errors="replace"))
        self.seen = self.seen[found.end() :]
        return found[0]

    def type(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def ends(self) -> int:
        """The exit code; the terminal must be as it was."""
        end = time.monotonic() + SOON
        while self.process.poll() is None and time.monotonic() < end:
            if select.select([self.master], [], [], 0.1)[0]:
                os.read(self.master, 65536)
        assert termios.tcgetattr(self.slave) == self.before
        return self.process.wait(0)


@contextmanager
def terminal(address: str, *options: str) -> Iterator[Terminal]:
    shown = Terminal(address, *options)
    try:
        yield shown
    finally:
        if shown.process.poll() is None:
            shown.process.kill()
            shown.process.wait()
        os.close(shown.master)
        os.close(shown.slave)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with central(tmp_path_factory.mktemp("top"), "--quiet") as daemon, program(ROBOT, daemon.address) as robot:
        assert robot.stdout
        assert robot.stdout.readline() == "ready\n"
        yield daemon.address


def test_a_screen_that_is_refreshed_until_q_is_pressed(address: str) -> None:
    with terminal(address, "--every", "0.2") as screen:
        screen.shows("central at ipc://")
        screen.shows(r"map +█+░* +\d+% +[\d.]+ ")  # a rate
        screen.shows("rates of the last 0")
        screen.shows(r"legs.*where|'legs' in 'step'")  # who waits for a reply
        screen.type(b"q")
        assert screen.ends() == 0


@pytest.mark.parametrize(("end", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 128 + signal.SIGTERM)])
def test_an_interrupted_screen_leaves_the_terminal_as_it_was(address: str, end: signal.Signals, code: int) -> None:
    with terminal(address) as screen:
        screen.shows("longest first")
        screen.process.send_signal(end)
        assert screen.ends() == code


def test_a_central_that_goes_away_and_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    address, folders = f"ipc://{tmp_path}/central.sock", [tmp_path / name for name in ("one", "two")]
    monkeypatch.setenv("TCA_CENTRAL", address)
    with terminal("", "--every", "0.2") as screen:
        screen.shows(f"central at {address} is away: no answer for")
        with central(folders[0], "--quiet", bind=address):
            first = screen.shows(r"run \w+,")
            screen.shows("nobody waits")
        screen.shows("central is away: no answer for .* This is how it was:")
        with central(folders[1], "--quiet", bind=address):
            assert screen.shows(r"run (?!" + first[4:-1] + r")\w+,") != first
            screen.type(b"Q")
            assert screen.ends() == 0


def test_one_frame_for_scripts(address: str) -> None:
    told = json.loads(CliRunner().invoke(top, ["--once", "--json", "--central", address]).stdout)
    assert {line["module"] for line in told["resources"]} == {"legs", "map"}
    assert {line["message"] for line in told["messages"]} == {"step", "where"}
    shown = CliRunner().invoke(top, ["--once", "--central", address])
    assert shown.exit_code == 0
    assert "rates of the whole run" in shown.stdout
    assert "\x1b" not in shown.stdout


def test_wrong_usage_is_one_line(address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tca_live.shared._PATIENCE", 0.2)
    for options, code, why in (
        (("--json",), 2, "ask for --once, too"),
        (("--every", "0"), 2, "--every"),
        ((), 2, "tca top needs a terminal: ask for --once"),
        (("--once", "--central", f"ipc://{tmp_path}/nobody"), 1, "does not answer"),
    ):
        ended = CliRunner(env={"TCA_CENTRAL": address}).invoke(top, options)
        assert ended.exit_code == code
        assert why in ended.stderr
