"""Runs whose central restarts, whose server ends, or whose client leaves."""

import signal
import threading
from functools import partialmethod
from pathlib import Path

import pytest
from missions.gripper import Brake, serving
from module.real_central import SOON, until
from processes import central, program

from tca_behaviours.missions import Environment, Idle, PeriodicTask, Status, TaskServer
from tca_module import Module, TaskFailed, connect
from tca_module.testing import LocalCentral

SERVER = """
from tca_behaviours.missions import Environment, PeriodicTask, Status, TaskServer

class Drive(PeriodicTask[Environment]):
    def iterate(self) -> Status:
        return Status.RUNNING
    def initialise(self) -> None:
        print("drives", flush=True)
    def terminate(self) -> None:
        print("stands", flush=True)

TaskServer("cart", Environment(), [Drive]).run()
print("over", flush=True)
"""


class Roll(PeriodicTask[Environment]):
    rolls, stands = threading.Event(), threading.Event()

    def iterate(self) -> Status:
        self.rolls.set()
        return Status.RUNNING

    def terminate(self) -> None:
        self.sleep(0.01)
        self.stands.set()


def test_run_terminates_when_central_stays_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Module, "running", partialmethod(Module.running, patience=0.5))
    with LocalCentral() as central:
        server = TaskServer("cart", Environment(), [Roll], rate=20, central=central)
        with server.running(), connect("user", central, linger=0) as user:
            user.command(server.definitions["Roll"].message, {}).id  # noqa: B018 - waits for its arrival
            assert Roll.rolls.wait(SOON)
            central.close()
            assert Roll.stands.wait(SOON)


def test_run_forgotten_by_restarted_central_terminates() -> None:
    with serving(Brake, idle=Idle) as robot:
        assert robot.send("Brake").id
        robot.after(0.05)
        robot.central.restart("two")
        assert robot.after(2) == ["0.05 Brake brakes", "1.05 Brake stands"]
        robot.after(1)
        assert [task.message for task in robot.user.tasks()] == ["gripper.Idle"]


def test_run_continues_when_its_client_leaves() -> None:
    with serving() as robot:
        with connect("mission", robot.central) as mission:
            turn = robot.server.definitions["Turn"]
            mission.command(turn.message, turn.parameters(steps=2))
        assert robot.after(1)[-1] == "0.10 Turn terminates"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "output", "why"),
    [
        (signal.SIGINT, "stands\nover\n", "server 'cart' has ended"),
        (signal.SIGKILL, "", "module 'cart'"),
    ],
    ids=["ctrl-c", "killed"],
)
def test_runs_fail_when_their_server_ends(
    tmp_path: Path, number: signal.Signals, output: str, why: str
) -> None:
    with (
        central(tmp_path) as daemon,
        program(SERVER, daemon.address) as server,
        connect("u", daemon.address) as user,
    ):
        until(lambda: "cart.Drive" in str(user.status("messages")), "the server is there")
        while not user.status("messages"):
            pass
        drive = user.command(user.declared("cart.Drive"), {})
        server.hear("drives")
        server.send_signal(number)
        assert server.communicate(timeout=20)[0] == output
        with pytest.raises(TaskFailed, match=why) as failed:
            drive.result(20)
        assert failed.value.failure == "module lost"
