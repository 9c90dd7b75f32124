"""A robot file is checked before any start. Errors name the key and the remedy."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from tca_tools.errors import BadUserFile
from tca_tools.supervise import trial_log
from tca_tools.supervise.command import run
from tca_tools.supervise.restarts import Restarts, how_it_ended
from tca_tools.supervise.robot_file import Limits, RobotFile, load
from tca_wire.endpoint import IS_STARTED_VARIABLE


def loaded(folder: Path, text: str) -> RobotFile:
    (folder / "robot.toml").write_text(text)
    return load(folder / "robot.toml")


def test_wrong_robot_file_names_the_key_and_the_remedy(
    tmp_path: Path, approve: Callable[..., None]
) -> None:
    def refusal(text: str) -> str:
        with pytest.raises(BadUserFile) as error:
            loaded(tmp_path, text.replace("\\n", "\n"))
        return str(error.value).replace(str(tmp_path), "DIR")

    approve("wrong_robot_files.txt", refusal)
    with pytest.raises(BadUserFile, match="line 1"):  # Python's own message
        loaded(tmp_path, "[modules.a\n")


def test_missing_robot_file_is_reported(tmp_path: Path) -> None:
    shown = CliRunner().invoke(run, [str(tmp_path / "robot.toml")])
    assert (shown.exit_code, "can't be read" in shown.output) == (2, True)


FILE = """
[run]
restarts = 1
[central]
address = "ipc:///tmp/c.sock"
journal = "journal"
options = ["--sync", "always"]
[modules.legs]
command = "sh -c 'exit 1'"
cwd = "here"
copies = 2
env = { SIDE = "left" }
restarts = 7
[modules.eyes]
command = ["sh", "-c", "exit 1"]
"""


def test_robot_file_starts_its_programs(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    robot = loaded(tmp_path, FILE)
    assert [program.name for program in robot.programs] == ["central", "legs.1", "legs.2", "eyes"]
    central, left, _, eyes = robot.programs
    assert central.command[3:] == [
        "--bind",
        "ipc:///tmp/c.sock",
        "--journal",
        str(tmp_path / "journal"),
        "--sync",
        "always",
    ]
    assert left.command == eyes.command == ["sh", "-c", "exit 1"]
    assert (left.cwd, eyes.cwd) == (tmp_path / "here", tmp_path)
    assert (left.env["SIDE"], left.env["TCA_CENTRAL"]) == ("left", "ipc:///tmp/c.sock")
    assert [one.limits.restarts for one in robot.programs] == [1, 7, 7, 1]
    assert [one.name for one in robot.only(["legs"]).programs] == ["legs.1", "legs.2"]
    with pytest.raises(BadUserFile, match="--only leg: did you mean 'legs'"):
        robot.only(["leg"])


def option(name: str, words: list[str]) -> str:
    return words[words.index(name) + 1]


def test_trial_log_starts_servers_central_and_standby(tmp_path: Path) -> None:
    text = """
[central]
address = "ipc:///tmp/c.sock"
replicated_log = "trial"
journal = "journal"
[modules.legs]
command = "sh"
"""
    robot = loaded(tmp_path, text)
    *servers, central, standby, legs = robot.programs
    assert [one.name for one in servers] == ["nats.1", "nats.2", "nats.3"]
    assert [one.ends_last for one in robot.programs] == [2, 2, 2, 1, 1, 0]
    ports = {option("--port", one.command) for one in servers}
    assert len(ports) == 3
    log = option("--log", central.command)
    assert all(f"127.0.0.1:{port}" in log for port in ports)
    assert option("--log", standby.command) == log
    assert central.command[2] == "tca_central"
    assert "standby" in standby.command
    assert option("--bind", central.command) == "ipc:///tmp/c.sock"
    assert option("--bind", standby.command) == "ipc:///tmp/c-2.sock"
    assert option("--journal", standby.command) == str(tmp_path / "journal" / "standby")
    assert legs.env["TCA_CENTRAL"] == robot.address == "ipc:///tmp/c.sock,ipc:///tmp/c-2.sock"
    assert len(robot.only(["central"]).programs) == 4
    assert robot.scratch is None
    assert loaded(tmp_path, "[central]\nreplicated_log = 'trial'\n").scratch is not None


def test_computers_with_one_log_have_a_central_each(tmp_path: Path) -> None:
    both = "tcp://a:1,tcp://b:1"
    text = f"[central]\naddress = '{both}'\nreplicated_log = 'nats://a,b,c/rover'\n"
    (first,) = loaded(tmp_path, text).programs
    (second,) = loaded(tmp_path, f"{text}bind = 'tcp://b:1'").programs
    assert first.command[2] == "tca_central"
    assert "standby" in second.command
    assert option("--bind", second.command) == "tcp://b:1"
    assert second.env["TCA_CENTRAL"] == both


def test_trial_log_needs_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadUserFile, match="tca-central\\[log\\]"):
        loaded(tmp_path, "[central]\nreplicated_log = 'trial'\n")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("ipc:///run/central.sock", "ipc:///run/central-2.sock"),
        ("tcp://127.0.0.1:5555", "tcp://127.0.0.1:5556"),
    ],
)
def test_standby_has_an_address_of_its_own(first: str, second: str) -> None:
    assert trial_log.second_address(first) == second


def test_plan_hides_the_password_of_the_log(tmp_path: Path) -> None:
    text = "[central]\nreplicated_log = 'nats://rover:secret@a,b,c'\n"
    (tmp_path / "robot.toml").write_text(text)
    shown = CliRunner().invoke(run, ["--check", str(tmp_path / "robot.toml")])
    assert "nats://a,b,c" in shown.output
    assert "secret" not in shown.output


@pytest.mark.parametrize("start", ["true", "false"])
def test_program_is_informed_that_central_starts(tmp_path: Path, start: str) -> None:
    text = f"[central]\nstart = {start}\n[modules.legs]\ncommand = 'sh'\n"
    *_, legs = loaded(tmp_path, text).programs
    assert (IS_STARTED_VARIABLE in legs.env) == (start == "true")


def test_check_prints_the_plan_and_starts_nothing(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("[modules.legs]\ncommand = 'touch begun'\n")
    shown = CliRunner().invoke(run, ["--check", str(tmp_path / "robot.toml")])
    assert (shown.exit_code, "touch begun" in shown.output) == (0, True)
    assert not (tmp_path / "begun").exists()


def test_restarts_back_off_and_have_a_limit() -> None:
    limits = Limits(restarts=4, within=60, delay=1, longest_delay=5)
    crashing, other = Restarts(limits), Restarts(limits)
    assert [crashing.delay(now) for now in range(5)] == [1, 2, 4, 5, None]
    assert [other.delay(now * 20) for now in range(10)] == [1, 2, 4, 4, 4, 4, 4, 4, 4, 4]


def test_exit_statuses_are_described() -> None:
    assert [how_it_ended(code).split()[-1] for code in (0, 3, -11, -9)] == [
        "0",
        "3",
        "SIGSEGV",
        "SIGKILL",
    ]
    assert how_it_ended(-40).endswith("40")
