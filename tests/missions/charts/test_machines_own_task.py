"""A machine on a real server. It is a task of its mission, and its end stops all tasks that it
started.
"""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import pytest
from missions.rover import TASKS, Rover, mission_of_rover

from tca_behaviours.missions import (
    BadParameter,
    ConditionVerified,
    Mission,
    MissionTaskFailed,
    Status,
    TaskServer,
    UnknownTask,
)
from tca_behaviours.missions.charts import Sequence, StateMachine
from tca_module import Client, connect
from tca_module.testing import LocalCentral
from tca_wire.charts import read_active, read_machine
from tca_wire.journal import facts


def patrol(**last: object) -> StateMachine:
    with Sequence("patrol") as sm:
        sm.Drive(x=1.0)
        with sm.concurrence():
            sm.Watch(foreground=False)
            with sm.sequence():
                sm.Drive(x=2.0)
                sm.Drive(x=3.0, fails="never")
        sm.Drive(x=5.0, **last)
    return sm


class When:
    """A condition that acts once *holds* returns true. The mission evaluates it while it waits."""

    def __init__(self, holds: Callable[[], bool], do: Callable[[], object]) -> None:
        self.holds, self.do = holds, do

    def is_verified(self) -> bool:
        """Whether to interrupt the mission: the action's result, once the condition holds."""
        return self.holds() and bool(self.do())


WATCHED = ["to 1", "stands at 1", "to 2", "stands at 2", "to 3"]


def test_machine_is_a_task_of_its_mission() -> None:
    with mission_of_rover() as (mission, robot):
        mission.add_condition(When(lambda: "to 3" in robot.done, robot.arrived.set))
        assert isinstance(mission.central, LocalCentral)
        assert patrol().run(mission).text == "Drive 4 has completed"
        assert robot.done[:5] == WATCHED
        assert sorted(robot.done[5:7]) == ["stands at 3", "watched"]
        assert robot.done[7:] == ["to 5", "stands at 5"]
        sent = [fact for fact in mission.central.facts if isinstance(fact, facts.Received)]
        machine = next(fact for fact in sent if fact.message.startswith("machine patrol"))
        goal = next(fact for fact in sent if fact.message.startswith("mission test"))
        assert machine.parent == goal.id
        assert [fact.message for fact in sent if fact.parent == machine.id] == [
            "rover.Drive",
            "rover.Watch",
            "rover.Drive",
            "rover.Drive",
            "rover.Drive",
        ]
        check_journal(machine, mission.central.facts)


def check_journal(machine: facts.Received, journal_facts: list[Any]) -> None:
    """Check that the journal contains the machine and its active states."""
    formats = next(
        fact
        for fact in journal_facts
        if isinstance(fact, facts.FormatDefined) and fact.message == machine.message
    )
    chart = read_machine(formats.data, machine.body)
    assert chart is not None
    assert chart == patrol().chart
    changes = [
        fact
        for fact in journal_facts
        if isinstance(fact, facts.StateChanged) and fact.task == machine.id
    ]
    progress = [read_active(change.body) for change in changes]
    assert [(one.running, one.after) for one in progress] == [
        (["Drive"], ""),
        (["Watch", "Drive 2"], "Drive has completed"),
        (["Watch", "Drive 3"], "Drive 2 has completed"),
        (["Drive 4"], "Watch has completed"),
    ]
    assert [chart.states[number].label for number in progress[1].active] == [
        "patrol",
        "concurrence",
        "Watch",
        "sequence",
        "Drive 2",
    ]
    assert read_machine(formats.data, b"\x93") is None
    assert read_machine("{}", machine.body) is None


@pytest.mark.parametrize(
    ("last", "status", "text"),
    [
        ({"fails": "rock"}, Status.FAILED, "Drive 2 has failed: rock: hit a rock"),
        (
            {"fails": "never", "task_timeout": 0.02},
            Status.TIMEOUT,
            "Drive 2 was not done in time: it ran for 0.02 s",
        ),
    ],
)
def test_incomplete_machine_raises_mission_task_failed(
    last: dict[str, object], status: Status, text: str
) -> None:
    with Sequence("short") as sm:
        sm.Drive(x=1.0)
        sm.Drive(**last)
    with mission_of_rover() as (mission, _):
        with pytest.raises(MissionTaskFailed) as caught:
            sm.run(mission)
        assert (Status.of(caught.value.status), caught.value.text) == (status, text)
        assert mission.Drive(x=1).status  # the mission continues


def test_failed_state_may_lead_to_another_state() -> None:
    with Sequence("short") as sm:
        sm.Drive(fails="rock").on(failed="home")
        sm.Drive(x=2.0)
        sm.Drive("home", x=9.0)
    with mission_of_rover() as (mission, robot):
        sm.run(mission)
        assert robot.done == ["to 0", "stands at 0", "to 9", "stands at 9"]


def ctrl_c(_: Client) -> bool:
    raise KeyboardInterrupt


def kill(user: Client) -> bool:
    for task in user.tasks():
        if task.message.startswith("machine"):
            task.kill("enough")
    return False


@pytest.mark.parametrize(
    ("error", "do"),
    [(KeyboardInterrupt, ctrl_c), (ConditionVerified, lambda _: True), (MissionTaskFailed, kill)],
)
def test_interrupted_machine_stops_all_its_tasks(
    error: type[BaseException], do: Callable[[Client], bool]
) -> None:
    with mission_of_rover() as (mission, robot), connect("user", mission.central) as user:
        mission.add_condition(When(lambda: "to 3" in robot.done, lambda: do(user)))
        with pytest.raises(error):
            patrol().run(mission)
        assert sorted(robot.done[5:]) == ["stands at 3", "watched"]
        assert mission.running_tasks() == []
        assert not [task for task in user.tasks() if task.message.startswith("machine")]


def test_server_loss_fails_the_machine() -> None:
    with LocalCentral() as central:
        robot = Rover()
        server = ExitStack()
        server.enter_context(
            TaskServer("rover", robot, tasks=TASKS, rate=100.0, central=central).running()
        )
        with server, Mission("rover", name="test", central=central) as mission:
            mission.add_condition(When(lambda: "to 3" in robot.done, server.close))
            with pytest.raises(MissionTaskFailed, match="server 'rover' has ended"):
                patrol().run(mission)
        assert sorted(robot.done[5:]) == ["stands at 3", "watched"]


def test_unknown_task_or_parameter_is_reported_before_the_start() -> None:
    with Sequence("typo") as sm:
        sm.Drive(x=1.0)
        sm.Drive("home", y=2.0)
    with Sequence("other") as other:
        other.Drive(x=1.0)
        other.sequnce("Fly")
    with mission_of_rover() as (mission, robot):
        with pytest.raises(BadParameter, match=r"Drive\(\) has no parameter 'y'") as caught:
            sm.run(mission)
        assert caught.value.__notes__ == ["The task belongs to state 'home' of sequence 'typo'."]
        with pytest.raises(UnknownTask, match="server 'rover' offers no task 'seq") as caught2:
            other.run(mission)
        assert "did you mean 'sequence'?" in caught2.value.__notes__[0]
        assert robot.done == []
