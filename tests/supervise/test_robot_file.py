"""A robot file is checked before any start. Errors name the key and the remedy."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from tca_tools.errors import BadUserFile
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
