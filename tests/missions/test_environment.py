"""The environment that tasks share: its lock, and the messages that it handles until the server
ends.
"""

from contextlib import suppress

import pytest
from missions.gripper import Gripper, serving

from tca_behaviours.missions import OnceTask, PeriodicTask, Status, TaskServer
from tca_behaviours.missions.serving import run
from tca_module import Inform, Module, Task, connect
from tca_module.testing import LocalCentral

WHERE = Inform("where", float)


def is_held(env: Gripper) -> bool:
    """Whether the calling thread holds the lock."""
    with suppress(RuntimeError):
        env.lock.release()
        return env.lock.acquire()
    return False


class Look(PeriodicTask[Gripper]):
    def initialise(self) -> None:
        self.env.note(self, f"initialise {is_held(self.env)}")

    def iterate(self) -> Status:
        self.env.note(self, f"iterate {is_held(self.env)}")
        return Status.COMPLETED

    def terminate(self) -> None:
        self.env.note(self, f"terminate {is_held(self.env)}")


class LookOnce(OnceTask[Gripper]):
    initialise = Look.initialise
    terminate = Look.terminate

    def iterate(self) -> None:
        self.env.note(self, f"iterate {is_held(self.env)}")


@pytest.mark.parametrize(("task", "in_iterate"), [(Look, True), (LookOnce, False)])
def test_environment_lock_is_held_in_the_given_methods(
    task: type[Look | LookOnce], in_iterate: bool
) -> None:
    with serving(task) as robot:
        robot.send(task.__name__)
        assert robot.after(0) == [
            f"0.00 {task.__name__} initialise True",
            f"0.00 {task.__name__} iterate {in_iterate}",
            f"0.00 {task.__name__} terminate True",
        ]


def test_long_wait_for_the_environment_lock_is_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(run, "_PATIENCE", 0.01)
    with serving(Look) as robot:
        with robot.gripper.lock:
            sent = robot.send("Look")
            assert sent.id
            while not caplog.records:
                pass
        robot.after(0)
        assert sent.result()
    assert (
        "initialise() of gripper.Look {1} waits for env.lock, which another task holds"
        in caplog.text
    )


class Sensing(Gripper):
    """Receives the place of the robot."""

    def attach(self, module: Module) -> None:
        @module.handles(WHERE)
        def record_place(_: Task, place: float) -> None:
            self.notes.append(f"at {place}")

    def close(self) -> None:
        self.notes.append("closed")


def test_environment_handles_messages_until_server_ends() -> None:
    env = Sensing()
    with LocalCentral(stepped=True) as central, connect("user", central) as user:
        server = TaskServer("gripper", env, [LookOnce], central=central)
        with server.running():
            user.inform(WHERE, 2.5)
            central.advance(0)
            assert env.read() == ["at 2.5"]
        assert env.read() == ["closed"]
