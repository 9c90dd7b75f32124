"""Changes of a running task. Followers get its text and overruns, and clients change its
parameters.
"""

import pytest
from integration.commanded import tca
from missions.gripper import Gripper, serving
from module.real_central import until

from tca_behaviours.missions import (
    Environment,
    OnceTask,
    PeriodicTask,
    Status,
    TaskEnd,
    TaskServer,
    TaskStatus,
    parameter,
)
from tca_module import BadData, Rejected, TaskFailed, connect
from tca_module.testing import LocalCentral
from tca_tools.live import shared
from tca_tools.live.states import update
from tca_wire.journal.facts import StateChanged


class Spin(PeriodicTask[Gripper]):
    """Turn until a parameter stops it."""

    speed: float = parameter(1.0, "In radians per second", minimum=0, maximum=9)
    arm: str = parameter("left", "Which arm", fixed=True)
    stops: bool = False

    def iterate(self) -> Status:
        self.env.note(self, f"{self.arm} at {self.speed:g}")
        self.report(f"at {self.speed:g}")
        return Status.COMPLETED if self.stops else Status.RUNNING


class Hold(OnceTask[Gripper]):
    """Hold until a parameter releases it."""

    force: float = 1.0
    holds: bool = True

    def iterate(self) -> None:
        while self.holds:
            self.report(f"with {self.force:g}")
            self.sleep(1.0)

    def terminate(self) -> None:
        self.env.note(self, "lets go")


def test_update_changes_only_the_given_parameters() -> None:
    with serving(Spin, rate=1) as robot:
        sent = robot.send("Spin", speed=2.0, arm="right")
        robot.after(1.5)
        parameters = robot.server.definitions["Spin"].parameters
        sent.update(parameters(speed=5.0), timeout=5)
        assert robot.after(1) == ["2.00 Spin right at 5"]
        sent.update(parameters(stops=True), timeout=5)
        robot.after(1)
        assert sent.result().text == "at 5"


def test_updated_period_applies_at_once() -> None:
    with serving(Spin, rate=1) as robot:
        sent = robot.send("Spin")
        robot.after(0.5)
        sent.update(robot.server.definitions["Spin"].parameters(task_period=0.25), timeout=5)
        assert robot.after(1.3) == [
            "1.00 Spin left at 1",
            "1.25 Spin left at 1",
            "1.50 Spin left at 1",
            "1.75 Spin left at 1",
        ]


def test_timeout_can_be_set_and_extended_by_update() -> None:
    with serving(Spin, rate=1) as robot:
        parameters = robot.server.definitions["Spin"].parameters
        sent = robot.send("Spin")
        robot.after(0.5)
        sent.update(parameters(task_timeout=2.5), timeout=5)
        robot.after(1)
        sent.update(parameters(task_timeout=3.25), timeout=5)
        robot.after(5)
        with pytest.raises(TaskFailed, match=r"it ran for 3\.25 s: at 1"):
            sent.result()


def test_update_of_fixed_parameter_is_rejected() -> None:
    with serving(Spin, rate=1) as robot:
        parameters = robot.server.definitions["Spin"].parameters
        sent = robot.send("Spin", arm="right")
        robot.after(0)
        with pytest.raises(Rejected, match="parameter 'arm' can't be changed while the task runs"):
            sent.update(parameters(arm="left", speed=3.0), timeout=5)
        with pytest.raises(Rejected, match="parameter 'foreground' can't be changed"):
            sent.update(parameters(foreground=False), timeout=5)
        sent.update(parameters(arm="right", speed=4.0), timeout=5)
        assert robot.after(1)[-1] == "1.00 Spin right at 4"


def test_update_out_of_range_is_not_sent() -> None:
    with serving(Spin) as robot:
        sent = robot.send("Spin")
        with pytest.raises(BadData, match=r"`float` <= 9\.0"):
            sent.update(robot.server.definitions["Spin"].parameters(speed=10.0), timeout=5)


def test_once_task_receives_updates_while_it_sleeps() -> None:
    with serving(Hold) as robot:
        sent = robot.send("Hold")
        robot.after(0.5)
        sent.update(robot.server.definitions["Hold"].parameters(force=3.0), timeout=5)
        robot.after(1)
        sent.update(robot.server.definitions["Hold"].parameters(holds=False), timeout=5)
        assert robot.after(1) == ["2.00 Hold lets go"]
        assert sent.result().text == "with 3"


def test_cancelled_run_is_terminated() -> None:
    with serving(Hold) as robot:
        sent = robot.send("Hold")
        robot.after(0.5)
        sent.cancel("enough")
        assert robot.after(0) == ["0.50 Hold lets go"]
        assert sent.state == "cancelled"


def test_progress_updates_are_throttled() -> None:
    class Count(PeriodicTask[Gripper]):
        def initialise(self) -> None:
            self.number = 0

        def iterate(self) -> Status:
            self.number += 1
            self.report(f"step {self.number}")
            if self.number == 8:
                self.sleep(0.25)
            return Status.COMPLETED if self.number == 10 else Status.RUNNING

    with serving(Count) as robot:
        sent = robot.send("Count")
        sent.follow()
        robot.after(3)
        message = robot.server.definitions["Count"].message
        bodies = [fact.body for fact in robot.central.facts if isinstance(fact, StateChanged)]
        assert [message.progress.decode(body) for body in bodies] == [
            TaskStatus("step 1"),
            TaskStatus("step 3"),
            TaskStatus("step 5"),
            TaskStatus("step 7"),
            TaskStatus("step 8", 2),
        ]
        assert list(sent.progress())[-1] == TaskStatus("step 8", 2)


class Fill(PeriodicTask[Environment]):
    """Fill a glass."""

    glass: str
    speed: float = 1.0

    def iterate(self) -> Status:
        self.report(f"{self.glass} at {self.speed:g}")
        return Status.RUNNING if self.speed < 2 else Status.COMPLETED


def test_update_command_keeps_omitted_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    with LocalCentral() as central, connect("user", central) as user:
        monkeypatch.setattr(
            shared, "connect", lambda name, _, **options: connect(name, central, **options)
        )
        with TaskServer("bar", Environment(), [Fill], rate=100.0, central=central).running():
            sent = user.command(user.declared("bar.Fill"), {"glass": "tall"})
            until(lambda: bool((info := sent.info()) and info.module), "it runs")
            assert tca(update, "bar.Fill", "speed=2.5") == (0, f"{sent}: has the new goal\n", "")
            assert sent.result(10)["text"] == "tall at 2.5"


def test_task_end_repr_names_its_status() -> None:
    assert (
        repr(TaskEnd(Status.TIMEOUT | Status.TERMINATED, "late", 2))
        == "TaskEnd(status=TIMEOUT, text='late', overruns=2)"
    )
    assert repr(TaskEnd(77)) == "TaskEnd(status=77, text='', overruns=0)"
