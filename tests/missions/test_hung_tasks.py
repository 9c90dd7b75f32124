"""Tasks whose iterate() does not return. The server and the mission log this, and Ctrl-C ends the
wait.
"""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from missions.gripper import Gripper, serving
from module.real_central import until

import tca_behaviours.missions.client.stopping as stopping_module
from tca_behaviours.missions import (
    Environment,
    Mission,
    OnceTask,
    PeriodicTask,
    Status,
    TaskServer,
    Timeout,
)
from tca_module.testing import LocalCentral


def test_slow_termination_after_timeout_is_not_logged(caplog: pytest.LogCaptureFixture) -> None:
    class Sleep(OnceTask[Gripper]):
        def iterate(self) -> None:
            self.sleep(60)

        def terminate(self) -> None:
            self.sleep(5)

    with serving(Sleep) as robot:
        robot.send("Sleep", task_timeout=1.0)
        robot.after(10)
    assert not caplog.records


class Stuck(Environment):
    def __init__(self) -> None:
        super().__init__()
        self.hangs, self.may_return = threading.Event(), threading.Event()


class Hang(OnceTask[Stuck]):
    def iterate(self) -> None:
        self.env.hangs.set()
        self.env.may_return.wait(10)


class HangInStep(PeriodicTask[Stuck]):
    def iterate(self) -> Status:
        self.env.may_return.wait(10)
        return Status.COMPLETED


@contextmanager
def stuck() -> Iterator[tuple[LocalCentral, Stuck]]:
    with (
        LocalCentral() as central,
        TaskServer("stuck", Stuck(), tasks=[Hang, HangInStep], central=central).running() as server,
    ):
        assert isinstance(server.environment, Stuck)
        try:
            yield central, server.environment
        finally:
            server.environment.may_return.set()


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.name == "tca.mission trip"]


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    for name in ("CHECK_PERIOD", "_PATIENCE"):
        monkeypatch.setattr(stopping_module, name, 0.02)
    monkeypatch.setattr("tca_behaviours.missions.client.mission_tasks.CHECK_PERIOD", 0.02)
    caplog.set_level(logging.WARNING, "tca")


def test_mission_logs_once_that_stopped_task_does_not_return(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with (
        stuck() as (central, environment),
        Mission("stuck", name="trip", central=central) as mission,
    ):
        task = mission.start("Hang")
        assert environment.hangs.wait(10)
        task.stop()
        assert mission.first_ended([task], timeout=0.3) == []
        assert warnings(caplog) == [f"waits for {task}, which was stopped and does not return"]
        environment.may_return.set()


@pytest.mark.parametrize("task", ["Hang", "HangInStep"])
def test_server_logs_once_that_iterate_does_not_return(
    task: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tca_behaviours.missions.serving.run._RETURNS_WITHIN", 0.02)

    def server_warnings() -> list[str]:
        return [one.getMessage() for one in caplog.records if one.name == "tca.stuck"]

    with stuck() as (central, environment), Mission("stuck", central=central) as mission:
        handle = mission.start(task, task_timeout=0.01)
        until(server_warnings, "it is said")
        environment.may_return.set()
        mission.first_ended([handle])
        assert server_warnings() == [
            f"stuck.{handle}: task_timeout of 0.01 s has passed and iterate() has not returned"
        ]


class CtrlC:
    """A condition that raises KeyboardInterrupt once the task hangs."""

    def __init__(self, environment: Stuck) -> None:
        self.environment = environment

    def is_verified(self) -> bool:
        if self.environment.hangs.is_set():
            raise KeyboardInterrupt
        return False


def hang_until_interrupted(mission: Mission, environment: Stuck) -> None:
    mission.add_condition(CtrlC(environment))
    mission.run("Hang")


def test_ctrl_c_waits_once_for_a_hanging_task(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stopping_module, "_STOPS_WITHIN", 0.1)
    with stuck() as (central, environment):
        with (
            pytest.raises(KeyboardInterrupt),
            Mission("stuck", name="trip", central=central) as mission,
        ):
            hang_until_interrupted(mission, environment)
        waits, in_vain, ends = warnings(caplog)
    assert waits.endswith("which was stopped and does not return")
    assert in_vain.endswith("did not end within 0.1 s of being stopped")
    assert ends.startswith("the mission ends without waiting any longer for Hang {")


def test_second_ctrl_c_ends_the_mission_at_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []

    def press(_: object, seconds: float) -> None:
        waits.append(seconds)
        raise KeyboardInterrupt

    monkeypatch.setattr(stopping_module, "wait_for_any", press)
    with stuck() as (central, environment):
        with (
            pytest.raises(KeyboardInterrupt),
            Mission("stuck", name="trip", central=central) as mission,
        ):
            hang_until_interrupted(mission, environment)
        (ends,) = warnings(caplog)
    assert len(waits) == 1
    assert ends.startswith("the mission ends without waiting any longer for Hang {")


def test_stop_task_raises_timeout_when_the_task_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stopping_module, "_STOPS_WITHIN", 0.1)
    with (
        stuck() as (central, environment),
        Mission("stuck", name="trip", central=central) as mission,
    ):
        task = mission.start("Hang")
        assert environment.hangs.wait(10)
        for _ in range(2):
            with pytest.raises(Timeout, match=r"did not end within 0.1 s of being stopped"):
                mission.stop_task(task)
        environment.may_return.set()
