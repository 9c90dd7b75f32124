"""Machines on real servers: two of them, and states that only Python runs."""

from threading import Event

import pytest
from missions.rover import Rover, mission_of_rover, rover

from tca_behaviours.missions import (
    BadParameter,
    ConditionVerified,
    Mission,
    OnceTask,
    TaskServer,
    UnknownTask,
    parameter,
)
from tca_behaviours.missions.charts import FromData, Sequence, StateMachine, UserData, state
from tca_module.testing import LocalCentral


class Grasp(OnceTask[Rover]):
    """Close the gripper."""

    width: float = parameter(0.1, "In metres", minimum=0.0)

    def iterate(self) -> None:
        self.env.note(f"grasps {self.width:g}")


def fetch(**grasp: object) -> StateMachine:
    with Sequence("fetch") as sm:
        sm.Drive(x=1.0)
        with sm.concurrence(until="all ended"):
            sm.Drive(x=2.0)
            sm.Grasp(server="arm", **grasp)  # each server has a foreground of its own
    return sm


def test_machine_runs_tasks_of_two_servers() -> None:
    with rover() as (central, robot):
        with (
            TaskServer("arm", robot, tasks=[Grasp], central=central).running(),
            Mission("rover", name="test", central=central) as mission,
        ):
            fetch(width=FromData("width")).run(mission, data={"width": 0.2})
            assert robot.done[:2] == ["to 1", "stands at 1"]
            assert sorted(robot.done[2:]) == ["grasps 0.2", "stands at 2", "to 2"]
            with pytest.raises(BadParameter, match=r"at least 0\.0, not -1"):
                fetch(width=-1.0).run(mission)


def test_unknown_task_of_a_further_server_starts_nothing() -> None:
    with Sequence("fly") as sm:
        sm.Drive(x=1.0)
        sm.Fly(server="arm")
    with rover() as (central, robot):
        with (
            TaskServer("arm", robot, tasks=[Grasp], central=central).running(),
            Mission("rover", name="test", central=central) as mission,
            pytest.raises(UnknownTask, match="server 'arm' offers no task 'Fly'"),
        ):
            sm.run(mission)
        assert robot.done == []


def test_kill_ends_a_machine_of_python_states() -> None:
    looped = Event()

    @state(outcomes=["again"])
    def loop(_: UserData) -> str:
        looped.set()
        return "again"

    with StateMachine("loop") as sm:
        sm.call(loop, "loop").on(again="loop")

    class HasLooped:
        def is_verified(self) -> bool:
            return looped.is_set()

    with mission_of_rover() as (mission, _):
        mission.add_condition(HasLooped())
        with pytest.raises(ConditionVerified):
            sm.run(mission)
        assert isinstance(mission.central, LocalCentral)
        mission.central.until_quiet()
