"""Single programs of a running ``tca run`` are stopped, started and restarted."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import tca
from supervise.robot_files import HASTY, NO_CENTRAL, Running, robot

from tca_module import connect
from tca_tools.supervise import log_file
from tca_tools.supervise.control import control_path
from tca_tools.supervise.log_file import LogFile

pytestmark = pytest.mark.slow

ONE = "[modules.one]\ncommand = 'sleep 100'\n"
TWO = "[modules.two]\ncommand = 'sleep 100'\ncopies = 2\n"


def say(folder: Path, action: str, names: str) -> list[str]:
    done = tca("run", str(folder / "robot.toml"), f"--{action}", names)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    with robot(tmp_path, HASTY + NO_CENTRAL + ONE + TWO) as started:
        for name in ("one", r"two\.1", r"two\.2"):
            if not re.search(rf"{name} started", started.said):
                started.hear(rf"{name} started")
        yield started


def test_stopped_program_stays_down_until_started(tmp_path: Path, running: Running) -> None:
    first = running.groups["one"]
    assert say(tmp_path, "stop", "one") == ["one stopped"]
    running.hear("one was ended by SIGINT")
    assert say(tmp_path, "stop", "one") == ["one was down already"]
    assert say(tmp_path, "start", "one") == ["one started"]
    running.hear("one started")
    assert running.groups["one"] != first
    assert say(tmp_path, "start", "one") == ["one runs already"]


def test_restart_of_a_name_restarts_all_its_copies(tmp_path: Path, running: Running) -> None:
    before = dict(running.groups)
    assert say(tmp_path, "restart", "two") == ["two.1 restarted", "two.2 restarted"]
    running.hear(r"two\.2 started")
    changed = {name for name, group in running.groups.items() if group != before[name]}
    assert changed == {"two.1", "two.2"}


def test_run_continues_while_all_programs_are_halted(tmp_path: Path, running: Running) -> None:
    say(tmp_path, "stop", "one,two")
    assert say(tmp_path, "start", "two.1") == ["two.1 started"]
    running.hear(r"two\.1 started")
    assert "ends all" not in running.said


def test_unknown_program_is_refused(tmp_path: Path, running: Running) -> None:
    assert running.groups
    done = tca("run", str(tmp_path / "robot.toml"), "--stop", "wheels")
    assert done.returncode == 1
    assert "--stop wheels" in done.stderr


def test_control_without_a_running_robot_fails(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ONE)
    done = tca("run", str(tmp_path / "robot.toml"), "--restart", "one")
    assert (done.returncode, str(tmp_path) in done.stderr) == (1, True)
    assert not control_path(tmp_path / "robot.toml").exists()


def test_restart_of_central_keeps_the_run(tmp_path: Path) -> None:
    address = f"ipc://{tmp_path}/c.sock"
    text = f"[central]\naddress = '{address}'\njournal = 'journal'\nrestarts = 0\n{ONE}"
    with robot(tmp_path, HASTY + text) as running:
        running.hear("listening on")
        with connect("user", address, patience=20) as user:
            epoch = user.status()["epoch"]
            assert say(tmp_path, "restart", "central") == ["central restarted"]
            running.hear("continues the unfinished run")
            assert user.status()["epoch"] == epoch
            user.end_central(keep=True)  # as ``tca central --stop --keep`` does: no crash
            running.hear("continues the unfinished run")
            assert user.status()["epoch"] == epoch


def test_crashing_program_is_left_down_when_configured(tmp_path: Path) -> None:
    bad = "[modules.bad]\ncommand = 'false'\nrestarts = 1\nwhen_crashing = 'leave'\n"
    with robot(tmp_path, HASTY + NO_CENTRAL + ONE + bad) as running:
        running.hear("bad ended with exit code 1, 2 times .* left down")
        assert say(tmp_path, "start", "bad") == ["bad started"]
        running.hear("left down")
        assert running.said.count("bad started") == 4
        assert say(tmp_path, "stop", "one") == ["one stopped"]


def test_output_also_goes_to_files(tmp_path: Path) -> None:
    prints = "[modules.prints]\ncommand = ['sh', '-c', 'echo 100%; echo oh >&2']\n"
    with robot(tmp_path, "[run]\nlog = 'out'\n" + NO_CENTRAL + prints) as running:
        assert running.end() == (0, "")
    lines = (tmp_path / "out" / "prints.log").read_text().splitlines()
    assert [line.split(" ", 2)[2] for line in lines] == ["100%", "oh"]
    assert "ends all" in (tmp_path / "out" / "run.log").read_text()


def test_log_files_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_file, "MOST_BYTES", 1000)
    log = LogFile(tmp_path / "a.log", print)
    for _ in range(200):
        log.write(b"x" * 100)
    log.close()
    sizes = [path.stat().st_size for path in tmp_path.iterdir()]
    assert (len(sizes), max(sizes) <= 1000) == (1 + log_file.OLDER_FILES, True)


def test_log_that_cannot_be_written_is_reported_once(tmp_path: Path) -> None:
    said: list[str] = []
    log = LogFile(tmp_path / "none" / "a.log", said.append)
    log.write(b"one")
    log.write(b"two")
    assert len(said) == 1
    assert str(tmp_path / "none" / "a.log") in said[0]
