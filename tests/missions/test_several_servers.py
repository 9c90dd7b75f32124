"""Missions over several servers, and tasks that other programs have sent."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from missions.rover import TASKS, Rover, mission_of_rover, rover
from module.real_central import until

from tca_behaviours.missions import (
    ConditionIsCompleted,
    ConditionIsRunning,
    ConditionVerified,
    Idle,
    Mission,
    MissionTaskFailed,
    NegatedCondition,
    TaskServer,
    VariableCondition,
)
from tca_module import MisuseError, Outcome, SentTask, Variable, connect
from tca_module.testing import LocalCentral

LEVEL = Variable("level", float)
NAMES = ("base", "arm", "eye")


@contextmanager
def three_servers() -> Iterator[tuple[LocalCentral, list[Rover]]]:
    robots = [Rover() for _ in NAMES]
    with LocalCentral() as central, ExitStack() as stack:
        for name, robot in zip(NAMES, robots, strict=True):
            server = TaskServer(name, robot, tasks=TASKS, rate=100.0, central=central)
            stack.enter_context(server.running())
        yield central, robots


@contextmanager
def mission_of_three() -> Iterator[tuple[list[Mission], list[Rover]]]:
    with (
        three_servers() as (central, robots),
        Mission("base", name="all", central=central) as base,
        Mission("arm", beside=base) as arm,
        Mission("eye", beside=base) as eye,
    ):
        yield [base, arm, eye], robots


def test_mission_waits_for_tasks_of_three_servers() -> None:
    with mission_of_three() as ((base, arm, eye), robots):
        drive = base.start("Drive", x=1.0, fails="never")
        watch, weigh = arm.Watch(), eye.start("Weigh", grams=[2, 3])
        assert base.wait_for_any_task([drive, watch, weigh]) is weigh
        robots[1].arrived.set()
        base.update_task(drive, fails="")
        assert [end.text for end in eye.wait_for_all_tasks([drive, watch, weigh])] == [
            "",
            "",
            "5 g",
        ]
        assert robots[0].done == ["to 1", "stands at 1"]
        assert arm.name == base.name == "all"
        assert set(base.ended) == {drive, watch, weigh}


def test_condition_interrupts_tasks_of_all_servers() -> None:
    with mission_of_three() as ((base, arm, eye), robots):
        base.add_condition(ConditionIsCompleted(eye.Watch(), "it is there"))
        robots[2].arrived.set()
        with pytest.raises(ConditionVerified, match="it is there"):
            arm.Drive(x=2.0, fails="never")
        assert robots[1].done in ([], ["to 2", "stands at 2"])


def test_end_of_the_mission_stops_tasks_of_all_servers() -> None:
    with mission_of_three() as (missions, robots):
        for mission in missions:
            mission.Watch()
    assert [robot.done for robot in robots] == [["watched"]] * 3


def test_task_of_a_mission_beside_is_known_after_a_crash(tmp_path: Path) -> None:
    class Crash(Exception):
        pass

    file = tmp_path / "all.steps"

    def drive_twice(base: Mission, *, crashes: bool) -> None:
        with Mission("arm", beside=base) as arm:
            base.step("first", arm.Drive, x=1.0)
            base.step("second", arm.Drive, x=2.0)
        if crashes:
            raise Crash

    with three_servers() as (central, robots):
        with pytest.raises(Crash), Mission("base", central=central, checkpoint=file) as base:
            drive_twice(base, crashes=True)
        lines = file.read_bytes().splitlines(keepends=True)
        file.write_bytes(b"".join(lines[:-1]))  # the program died within the last step
        with Mission("base", central=central, checkpoint=file) as base:
            drive_twice(base, crashes=False)
        assert robots[1].done == ["to 1", "stands at 1", "to 2", "stands at 2"]


def test_wait_for_a_task_of_another_mission_is_refused() -> None:
    with three_servers() as (central, _), Mission("base", central=central) as base:
        with Mission("arm", name="other", central=central) as other:
            watch = other.Watch()
            for use in (base.wait_for_task, base.stop_task):
                with pytest.raises(MisuseError, match=r"another mission: open one .*beside="):
                    use(watch)
            with pytest.raises(MisuseError, match="another mission"):
                base.add_condition(NegatedCondition(ConditionIsCompleted(watch)))


# --- tasks that other programs have sent ----------------------------------------------------------


@contextmanager
def mission_with_foreign_drive() -> Iterator[tuple[Mission, Rover, SentTask[object]]]:
    """Run a mission, while another program has the rover drive."""
    with (
        rover() as (central, robot),
        connect("user", central) as user,
        Mission("rover", central=central) as mission,
    ):
        drive = user.declared("rover.Drive")
        yield mission, robot, user.command(drive, {"x": 4.0, "fails": "never"})


@pytest.mark.parametrize("by", ["number", "entry", "handle"])
def test_mission_stops_a_task_of_another_program(by: str) -> None:
    with mission_with_foreign_drive() as (mission, robot, sent):
        until(lambda: robot.done, "the rover drives")
        (entry,) = mission.running_tasks()
        forms: dict[str, Any] = {
            "number": entry.id,
            "entry": entry,
            "handle": mission.find_task(entry),
        }
        mission.stop_task(forms[by])
        assert robot.done == ["to 4", "stands at 4"]
        assert sent.wait(10) is Outcome.KILLED


def test_mission_waits_for_a_task_of_another_program() -> None:
    with mission_with_foreign_drive() as (mission, _, sent):
        found = mission.find_task(sent.id)
        mission.update_task(found, fails="", says="there")
        assert mission.wait_for_task(found, timeout=10).text == "there"
        assert list(mission.ended) == []


def test_cleared_condition_leaves_a_foreign_task_running() -> None:
    with mission_with_foreign_drive() as (mission, _, sent):
        mission.add_condition(ConditionIsCompleted(mission.find_task(sent.id)))
        mission.clear_conditions()
        assert [task.id for task in mission.running_tasks()] == [sent.id]


def test_idle_stops_all_tasks_but_the_idle_task() -> None:
    robot = Rover()
    with LocalCentral() as central, ExitStack() as stack:
        server = TaskServer("rover", robot, TASKS, idle=Idle, rate=100.0, central=central)
        stack.enter_context(server.running())
        user = stack.enter_context(connect("user", central))
        mission = stack.enter_context(Mission("rover", central=central))
        user.command(user.declared("rover.Watch"), {})
        mission.start("Drive", x=3.0, fails="never")
        until(lambda: "to 3" in robot.done, "the rover drives")
        mission.idle()
        assert sorted(robot.done) == ["stands at 3", "to 3", "watched"]
        until(lambda: [task.name for task in mission.running_tasks()] == ["Idle"], "it idles")
        (idle,) = mission.running_tasks()
        mission.idle()
        assert mission.find_task(idle.id).end is None


# --- conditions -----------------------------------------------------------------------------------


def test_end_of_a_foreign_task_verifies_a_condition() -> None:
    with mission_with_foreign_drive() as (mission, robot, sent):
        found = mission.find_task(sent.id)
        mission.add_condition(NegatedCondition(ConditionIsRunning(found), "the drive is over"))
        watch = mission.Watch()
        until(lambda: robot.done, "the rover drives")
        sent.kill("enough")
        with pytest.raises(ConditionVerified, match="the drive is over"):
            mission.wait_for_task(watch)
        assert watch.end is None


def test_running_task_prevents_the_start() -> None:
    with mission_of_rover() as (mission, robot):
        watch = mission.Watch()
        mission.add_condition(ConditionIsRunning(watch))
        with pytest.raises(ConditionVerified, match=r"Watch \{\d+\} runs"):
            mission.Drive(x=1.0)
        mission.stop_task(watch)
        mission.add_condition(ConditionIsRunning(watch))
        mission.Drive(x=2.0)
        assert robot.done == ["watched", "to 2", "stands at 2"]


@pytest.mark.parametrize("negated", [False, True])
def test_variable_verifies_a_condition(negated: bool) -> None:
    with rover() as (central, _), connect("user", central) as user:
        user.set_variable(LEVEL, 0.9)
        with Mission("rover", central=central) as mission:
            condition: VariableCondition[float] | NegatedCondition
            condition = VariableCondition(LEVEL, lambda level: level < 0.2, "battery low")
            if negated:
                condition = NegatedCondition(VariableCondition(LEVEL, lambda level: level >= 0.2))
            mission.add_condition(condition)
            mission.Drive(x=1.0)
            watch = mission.Watch()
            user.set_variable(LEVEL, 0.1)
            with pytest.raises(ConditionVerified) as caught:
                mission.wait_for_task(watch)
            assert caught.value.conditions == [condition]


def test_variable_without_a_value_verifies_nothing() -> None:
    with mission_of_rover() as (mission, _):
        mission.add_condition(VariableCondition(LEVEL, lambda _: True))
        mission.Drive(x=1.0)
        with pytest.raises(MissionTaskFailed, match="timeout"):
            mission.Drive(fails="never", task_timeout=0.1)


def test_error_of_a_condition_names_the_condition() -> None:
    class Broken:
        __str__ = lambda _: "battery low"  # noqa: E731

        def is_verified(self) -> bool:
            raise ZeroDivisionError

    with mission_of_rover() as (mission, _):
        mission.add_condition(Broken())
        with pytest.raises(ZeroDivisionError) as caught:
            mission.Drive(x=1.0)
        assert "'battery low'" in caught.value.__notes__[0]


def test_condition_of_a_variable_needs_a_mission() -> None:
    with pytest.raises(MisuseError, match=r"call add_condition\(\) first"):
        VariableCondition(LEVEL, bool).is_verified()
