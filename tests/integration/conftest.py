"""A central, a client of it, and a robot for commands of the command line."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from integration.commanded import FELL, HEALTH, LATER, MOVE, SAY, SOON, TICK, WALK, WHERE, Pose
from module.real_central import RealCentral

from tca_module import Client, Module, Task, connect


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[RealCentral]:
    with RealCentral(f"ipc://{tmp_path}/central.sock") as daemon:
        yield daemon


@pytest.fixture
def address(daemon: RealCentral) -> str:
    return daemon.address


@pytest.fixture
def user(address: str) -> Iterator[Client]:
    with connect("user", address) as client:
        client.wait_until_handled(timeout=SOON)
        yield client


@pytest.fixture
def robot(address: str) -> Iterator[list[str]]:
    """Run a robot. The yielded list receives each inform and broadcast that the robot handles."""
    robot, other, heard = Module("robot", address), Module("other", address), list[str]()

    @robot.handles(WALK)
    def walk(task: Task, steps: int) -> None:
        if steps < 0:
            raise FELL(steps, "too\nsteep\x1b[31m")
        for _ in range(steps):
            task.command(LATER)

    robot.handles(MOVE)(lambda _, move: move.to)
    robot.handles(WHERE)(lambda _, pose: Pose(pose.x + 1.0, pose.y))
    robot.handles(SAY)(lambda _, text: heard.append(text))
    robot.handles(TICK)(lambda _: heard.append("tick"))
    robot.handles(HEALTH)(lambda _: 0.5)
    other.handles(HEALTH)(lambda _: 0.5)
    with robot.running(), other.running():
        yield heard


@pytest.fixture
def find_central(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make commands in this process find the central, and wait longer for answers on a busy
    machine.
    """
    monkeypatch.setenv("TCA_CENTRAL", address)
    monkeypatch.setattr("tca_tools.live.shared._PATIENCE", 20.0)
