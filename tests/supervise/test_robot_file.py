"""A robot's file is checked before anything starts, and errors say which key and what to do."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from tca_tools.errors import BadUserFile
from tca_tools.supervise.command import run
from tca_tools.supervise.restarts import Restarts, how_it_ended
from tca_tools.supervise.robot_file import Limits, RobotFile, load


def loaded(folder: Path, text: str) -> RobotFile:
    (folder / "robot.toml").write_text(text)
    return load(folder / "robot.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[central]\nstart = false", "nothing to run"),
        ("[modules.a\n", "line 1"),
        ("[module.a]\ncommand = 'true'", "'module' is unknown|'modules'"),
        ("[legs]\ncommand = 'true'", "[modules.legs]"),
        ("central = 1", "[central]"),
        ("modules = 1", "[modules]"),
        ("[modules]\na = 1", "[modules.a]"),
        ("[modules.a]", "modules.a.command is missing"),
        ("[modules.a]\ncommand = 1", "modules.a.command must be|not 1"),
        ("[modules.a]\ncommand = ''", "modules.a.command is empty"),
        ("[modules.a]\ncommand = 'sh \"'", "modules.a.command"),
        ("[modules.a]\ncommand = 'no-such-program'", "modules.a.command|no-such-program"),
        ("[modules.a]\ncommand = './no-such-program'", "modules.a.command|no-such-program"),
        ("[modules.a]\ncommand = 'true'\ncwd = 'nowhere'", "modules.a.cwd|nowhere"),
        ("[modules.a]\ncommand = 'true'\ncopys = 2", "modules.a.copys is unknown|'copies'"),
        ("[modules.a]\ncommand = 'true'\ncopies = 'two'", 'modules.a.copies|"two"'),
        ("[modules.a]\ncommand = 'true'\ncopies = 0", "modules.a.copies|not 0"),
        ("[modules.a]\ncommand = 'true'\nenv = { A = 1 }", "modules.a.env|table of texts"),
        ("[modules.a]\ncommand = 'true'\nrestart = 'sometimes'", 'modules.a.restart|"never"'),
        ("[modules.a]\ncommand = 'true'\nrestart = 'never'\nhung = 'restart'", "modules.a.hung|never"),
        ("[modules.a]\ncommand = 'true'\ngrace = nan", "modules.a.grace|NaN"),
        ("[modules.'a b']\ncommand = 'true'", "modules.a b"),
        ("[modules.run]\ncommand = 'true'", "modules.run"),
        ("[run]\nrestarts = true", "run.restarts|true"),
        ("[run]\nrestart = 5", "run.restart is unknown|'restarts'"),
        ("[central]\naddress = 'tcp://127.0.0.1:*'", "central.address|port"),
        ("[central]\noptions = '--sync always'", "central.options|list"),
        ("[central]\noptions = ['--bind=tcp://127.0.0.1:1']", "central.options|address"),
        ("[central]\noptions = ['--sync', 'always', '--fresh']", "central.options|--fresh"),
    ],
)  # fmt: skip
def test_a_wrong_file_says_which_key_and_what_to_do(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BadUserFile) as error:
        loaded(tmp_path, text)
    assert str(error.value).startswith(str(tmp_path / "robot.toml"))
    assert [words for words in said.split("|") if words not in str(error.value)] == []


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
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


def test_what_a_file_starts(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    robot = loaded(tmp_path, FILE)
    assert [program.name for program in robot.programs] == ["central", "legs.1", "legs.2", "eyes"]
    central, left, _, eyes = robot.programs
    assert central.command[3:] == [
        "--bind", "ipc:///tmp/c.sock", "--journal", str(tmp_path / "journal"), "--sync", "always",
    ]  # fmt: skip
    assert left.command == eyes.command == ["sh", "-c", "exit 1"]
    assert (left.cwd, eyes.cwd) == (tmp_path / "here", tmp_path)
    assert (left.env["SIDE"], left.env["TCA_CENTRAL"]) == ("left", "ipc:///tmp/c.sock")
    assert [one.limits.restarts for one in robot.programs] == [1, 7, 7, 1]
    assert [one.name for one in robot.only(["legs"]).programs] == ["legs.1", "legs.2"]
    with pytest.raises(BadUserFile, match="--only leg: did you mean 'legs'"):
        robot.only(["leg"])


def test_check_shows_it_and_starts_nothing(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("[modules.legs]\ncommand = 'touch begun'\n")
    shown = CliRunner().invoke(run, ["--check", str(tmp_path / "robot.toml")])
    assert (shown.exit_code, "touch begun" in shown.output) == (0, True)
    assert not (tmp_path / "begun").exists()


def test_restarts_wait_longer_each_time_and_have_an_end() -> None:
    limits = Limits(restarts=4, within=60, delay=1, longest_delay=5)
    crashing, other = Restarts(limits), Restarts(limits)
    assert [crashing.delay(now) for now in range(5)] == [1, 2, 4, 5, None]
    assert [other.delay(now * 20) for now in range(10)] == [1, 2, 4, 4, 4, 4, 4, 4, 4, 4]


def test_ends_in_words() -> None:
    assert [how_it_ended(code).split()[-1] for code in (0, 3, -11, -9)] == ["0", "3", "SIGSEGV", "SIGKILL"]
    assert how_it_ended(-40).endswith("40")
