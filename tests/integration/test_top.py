"""``tca top`` in a real terminal, with a real central and real modules."""

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from click.testing import CliRunner
from integration.terminal import Terminal, terminal
from processes import central, program

from tca_tools.live.top import top

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


def top_in_terminal(address: str, *options: str) -> AbstractContextManager[Terminal]:
    where = ("--central", address) if address else ()
    return terminal([sys.executable, "-m", "tca_tools.live.top", *where, *options])


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with (
        central(tmp_path_factory.mktemp("top"), "--quiet") as daemon,
        program(ROBOT, daemon.address) as robot,
    ):
        robot.hear("ready")
        yield daemon.address


def test_top_refreshes_until_q_is_pressed(address: str) -> None:
    with top_in_terminal(address, "--every", "0.2") as screen:
        screen.shows("central at ipc://")
        screen.shows(r"map +█+░* +\d+% +[\d.]+ ")  # a rate
        screen.shows("rates of the last 0")
        screen.shows(r"legs.*where|'legs' in 'step'")  # a waiting requester
        screen.type(b"q")
        assert screen.ends() == 0


@pytest.mark.parametrize(
    ("end", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 128 + signal.SIGTERM)]
)
def test_interrupted_top_restores_the_terminal(
    address: str, end: signal.Signals, code: int
) -> None:
    with top_in_terminal(address) as screen:
        screen.shows("longest first")
        screen.process.send_signal(end)
        assert screen.ends() == code


def test_top_shows_central_going_away_and_returning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, folders = (
        f"ipc://{tmp_path}/central.sock",
        [tmp_path / name for name in ("one", "two")],
    )
    monkeypatch.setenv("TCA_CENTRAL", address)
    with top_in_terminal("", "--every", "0.2") as screen:
        screen.shows(f"central at {address} is away: no answer for")
        with central(folders[0], "--quiet", bind=address):
            first = screen.shows(r"run \w+,")
            screen.shows("nothing waits")
        screen.shows("central is away: no answer for .* Its last answer:")
        with central(folders[1], "--quiet", bind=address):
            assert screen.shows(r"run (?!" + first[4:-1] + r")\w+,") != first
            screen.type(b"Q")
            assert screen.ends() == 0


def test_top_once_prints_one_plain_frame(address: str) -> None:
    report = json.loads(CliRunner().invoke(top, ["--once", "--json", "--central", address]).stdout)
    assert {line["module"] for line in report["resources"]} == {"legs", "map"}
    assert {line["message"] for line in report["messages"]} == {"step", "where"}
    shown = CliRunner().invoke(top, ["--once", "--central", address])
    assert shown.exit_code == 0
    assert "rates of the whole run" in shown.stdout
    assert "\x1b" not in shown.stdout


def test_top_usage_error_is_one_line(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tca_tools.live.shared._PATIENCE", 0.2)
    for options, code, why in (
        (("--json",), 2, "add --once"),
        (("--every", "0"), 2, "--every"),
        ((), 2, "tca top needs a terminal: use --once"),
        (("--once", "--central", f"ipc://{tmp_path}/nobody"), 1, "does not answer"),
    ):
        ended = CliRunner(env={"TCA_CENTRAL": address}).invoke(top, options)
        assert ended.exit_code == code
        assert why in ended.stderr
