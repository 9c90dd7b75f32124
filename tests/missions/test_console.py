"""``tca console`` in a terminal, and its error messages."""

import signal
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from integration.terminal import terminal
from missions.rover import TASKS, Rover, rover
from module.real_central import RealCentral, until

from tca_behaviours.missions import Mission, TaskServer
from tca_behaviours.missions.console.command import console
from tca_behaviours.missions.console.names import ConsoleNames

CONSOLE = [
    sys.executable,
    "-c",
    "from tca_behaviours.missions.console.command import console; console()",
]


@pytest.mark.slow
def test_console_runs_typed_tasks_in_a_terminal(tmp_path: Path) -> None:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        robot = Rover()
        server = TaskServer("rover", robot, tasks=TASKS, rate=100.0, central=central.address)
        with (
            server.running(),
            terminal(CONSOLE, TCA_CENTRAL=central.address, IPYTHONDIR=str(tmp_path)) as screen,
        ):
            screen.shows("Drive  Drive to a place.")
            screen.shows(r"In \[1\]:")
            screen.type(b"Drive(x=2.0)\r")
            screen.shows(r"Out\[1\].*TaskEnd\(status=COMPLETED, ")
            screen.type(b"Drive(y=2.0)\r")
            screen.shows(r"BadParameter: Drive\(\) has no parameter 'y'")
            screen.type(b"Drvie(x=2.0)\r")
            screen.shows(r"UnknownTask: there is no task 'Drvie': did you mean 'Drive'\?")
            screen.type(b"mission.stop_task()\r")
            screen.shows(r"MisuseError: .* missing 1 required .*'task': help\(\) explains")
            screen.type(b"Drive(gea\t")
            screen.shows("gear=")
            screen.type(b"'fast', fails='never')\r")
            until(lambda: robot.done[-1] == "to 0", "the rover drives")
            screen.process.send_signal(signal.SIGINT)  # as the terminal does on Ctrl-C
            frames = screen.shows(
                r"(?s).*KeyboardInterrupt: status\(\) shows the tasks that still run"
            )
            assert "Traceback" not in frames
            assert robot.done[-1] == "stands at 0"
            screen.type(b"watch = Watch()\r")
            screen.type(b"status()\r")
            screen.shows(r"Watch\(\) \{\d+\} runs")
            screen.type(b"help(Weigh)\r")
            screen.shows(r"grams: list\[int\]")
            screen.shows(r"In \[\d+\]:")
            screen.type(b"\x04")
            assert screen.ends() == 0
        assert robot.done[-1] == "watched"


def test_console_names_run_tasks_and_print_help() -> None:
    with rover() as (central, robot), Mission("rover", central=central) as mission:
        printed: list[str] = []
        typed = ConsoleNames(mission, printed.append)
        assert {"Drive", "Watch", "Weigh", "mission", "index", "status", "help"} == set(typed.names)
        typed.index()
        assert printed == [
            "Drive  Drive to a place.",
            "Watch  Wait until the rover has arrived.",
            "Weigh  Weigh a sample.",
        ]
        printed.clear()
        typed.help("Weigh")
        assert printed[0].startswith("Weigh: Weigh a sample.\n\ngrams: list[int]")
        printed.clear()
        typed.names["Watch"]()
        with pytest.raises(Exception, match="hit a rock"):
            typed.names["Drive"](fails="rock")
        typed.status()
        assert [line.partition("{")[0] + line.partition("}")[2] for line in printed] == [
            "Watch()  runs",
            "Drive  failed: rock: hit a rock",
        ]
        robot.arrived.set()
        typed.help()
        assert "Ctrl-D leaves" in printed[-1]


@pytest.fixture
def without_ipython(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython.terminal.embed", None)
    monkeypatch.delitem(sys.modules, "tca_behaviours.missions.console.shell", raising=False)


@pytest.mark.usefixtures("without_ipython")
def test_console_without_ipython_names_the_package() -> None:
    result = CliRunner().invoke(console, [])
    assert result.exit_code == 1
    assert (
        "tca console needs the Python package 'ipython': pip install 'tca-central[console]'"
        in result.output
    )


def test_console_stub_overwrites_only_stub_files(tmp_path: Path) -> None:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as central:
        with TaskServer("rover", Rover(), tasks=TASKS, central=central.address).running():
            words = ["rover", "--central", central.address, "--stub"]
            for _ in range(2):
                assert (
                    CliRunner().invoke(console, [*words, f"{tmp_path}/rover_tasks.py"]).exit_code
                    == 0
                )
            (tmp_path / "mine.py").write_text("precious")
            refused = CliRunner().invoke(console, [*words, f"{tmp_path}/mine.py"])
            assert refused.exit_code == 2
            assert "was not made by --stub" in refused.output
            assert (
                CliRunner().invoke(console, ["rovr", *words[1:], f"{tmp_path}/mine.py"]).exit_code
                == 1
            )
    assert "class RoverMission(Base)" in (tmp_path / "rover_tasks.py").read_text()
    assert (tmp_path / "mine.py").read_text() == "precious"
