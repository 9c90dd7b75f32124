"""Task definitions come from a folder and from installed packages. An unusable one never affects
the others.
"""

import logging
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from missions.gripper import Grasp, Gripper, Turn, serving

from tca_behaviours.missions import Environment, Idle, OnceTask, PeriodicTask, Status, TaskServer
from tca_behaviours.missions.serving import finding
from tca_module import MisuseError

WAVE = '''
from missions.gripper import Gripper
from tca_behaviours.missions import PeriodicTask, Status
from tca_behaviours.missions.serving.definition import OnceTask

class _Base(PeriodicTask[Gripper]):
    times: int = 2

class Wave(_Base):
    """Wave."""
    def initialise(self) -> None:
        self.left = self.times
    def iterate(self) -> Status:
        self.left -= 1
        return Status.RUNNING if self.left else Status.COMPLETED
'''


class Wheels(Environment):
    pass


class Drive(OnceTask[Wheels]):
    def iterate(self) -> None:
        pass


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "wave.py").write_text(WAVE)
    return tmp_path


def offered(*tasks: Any, **options: Any) -> list[str]:
    return list(TaskServer("gripper", Gripper(), tasks, **options).definitions)


def test_task_file_in_the_folder_is_offered(folder: Path) -> None:
    with serving(Turn, folder=folder) as robot:
        assert list(robot.server.definitions) == ["Turn", "Wave"]
        sent = robot.send("Wave", times=3)
        robot.after(1)
        assert sent.result().status & Status.TERMINATED


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("class Bro ken:", "the tasks of {file} are left out: SyntaxError: "),
        (
            "import nowhere_to_be_found",
            "the tasks of {file} are left out: ModuleNotFoundError: No module named 'nowhere",
        ),
        ("raise SystemExit(3)", "the tasks of {file} are left out: SystemExit: 3"),
        (
            WAVE,
            "{file} is left out: task Wave is defined in {folder}/wave.py already: rename one of the two",
        ),
        (
            WAVE.replace("Wave", "Nod").replace("iterate", "go"),
            "{file} is left out: task Nod has no iterate(): define it",
        ),
        (
            WAVE.replace("Wave", "Nod")
            .replace("Gripper", "Wheels")
            .replace("missions.gripper", "missions.test_finding"),
            "{file} is left out: task Nod needs an environment of class Wheels, not the server's Gripper",
        ),
        (
            WAVE.replace("Wave", "Nod").replace("times: int = 2", "times: int = 'x'"),
            "{file} is left out: task Nod: the default of parameter 'times' does not fit",
        ),
    ],
)
def test_unusable_task_file_is_logged_and_left_out(
    folder: Path, caplog: pytest.LogCaptureFixture, text: str, message: str
) -> None:
    file = folder / "zzz.py"
    file.write_text(text)
    assert offered(folder=folder) == ["Wave"]
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR]
    assert message.format(file=file, folder=folder) in caplog.text


def test_task_files_with_leading_underscore_are_ignored(folder: Path) -> None:
    (folder / "_parts.py").write_text("raise ValueError")
    assert offered(folder=folder) == ["Wave"]


def test_missing_task_folder_is_rejected(folder: Path) -> None:
    with pytest.raises(MisuseError, match=r"server 'gripper': folder .*/nowhere does not exist"):
        offered(folder=folder / "nowhere")


def test_entry_points_offer_tasks_for_their_environment(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    group = finding.ENTRY_POINTS
    entries = [
        EntryPoint("wheels", "missions.test_finding:Drive", group),
        EntryPoint("grasp", "missions.gripper:Grasp", group),
        EntryPoint("lost", "missions.gripper:Lost", group),
        EntryPoint("no task", "missions.gripper:serving", group),
        EntryPoint("again", "missions.gripper:Turn", group),
    ]
    monkeypatch.setattr(
        finding, "entry_points", lambda group: [one for one in entries if one.group == group]
    )
    assert offered(Turn) == ["Turn", "Grasp"]
    assert [record.getMessage().partition(":")[0] for record in caplog.records] == [
        "entry point 'lost' (missions.gripper",
        "entry point 'no task' (missions.gripper",
    ]


class Bare(PeriodicTask[Gripper]):
    pass


class Coroutine(OnceTask[Gripper]):
    async def iterate(self) -> None:  # type: ignore[override]
        pass


class Needy(Turn):
    def __init__(self, speed: float) -> None:
        self.speed = speed


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        ((Gripper,), "is not a task: give a class that inherits from PeriodicTask or OnceTask"),
        ((Bare,), "task Bare has no iterate(): define it"),
        (
            (Coroutine,),
            "task Coroutine: iterate() can't be 'async def': it runs in a thread of its own",
        ),
        ((Needy,), "task Needy: its __init__ needs arguments: prepare in initialise() instead"),
        ((Drive,), "task Drive needs an environment of class Wheels, not the server's Gripper"),
        (
            (Turn, type("Turn", (Grasp,), {})),
            "task Turn is defined in tasks= already: rename one of the two",
        ),
    ],
)
def test_invalid_task_definition_is_rejected(tasks: Any, message: str) -> None:
    with pytest.raises(MisuseError) as wrong:
        offered(*tasks)
    assert message in str(wrong.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0}, "server 'gripper': rate must be more than 0 iterations a second, not 0"),
        ({"capacity": 2}, "server 'gripper': capacity must be 3 or more, not 2"),
    ],
)
def test_invalid_server_option_is_rejected(options: Any, message: str) -> None:
    with pytest.raises(MisuseError) as wrong:
        offered(Turn, **options)
    assert str(wrong.value) == message


def test_idle_task_is_offered() -> None:
    assert offered(Turn, idle=Idle) == ["Turn", "Idle"]
    assert offered(Turn, Idle, idle=Idle) == ["Turn", "Idle"]


def test_invalid_environment_is_rejected() -> None:
    with pytest.raises(
        MisuseError,
        match="environment must be an object of a class that inherits from Environment, not 3",
    ):
        TaskServer("gripper", 3)  # type: ignore[arg-type]
