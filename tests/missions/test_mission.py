"""Missions: tasks as functions, their ends and failures, waits, conditions."""

import inspect
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import pytest
from missions.rover import TASKS, Rover, mission_of_rover, rover
from module.real_central import until

from tca_behaviours import missions as missions_api
from tca_behaviours.missions import (
    BadParameter,
    ConditionIsCompleted,
    ConditionVerified,
    Mission,
    MissionTaskFailed,
    NotOffered,
    Status,
    TaskEnd,
    TaskServer,
    UnknownTask,
)
from tca_behaviours.missions.client.mission_goal import MissionInfo
from tca_module import (
    Goal,
    MisuseError,
    Module,
    Outcome,
    Rejected,
    Task,
    TaskKilled,
    Timeout,
    Variable,
    connect,
)
from tca_module.testing import LocalCentral
from tca_wire.journal import facts

LEVEL = Variable("level", float)


def test_mission_call_returns_the_task_end() -> None:
    with mission_of_rover() as (mission, robot):
        end = mission.Drive(x=2.0)
        assert Status.of(end.status) is Status.COMPLETED
        assert robot.done == ["to 2", "stands at 2"]
        assert mission.Weigh(grams=[2, 3]).text == "5 g"


def test_background_task_can_be_waited_for() -> None:
    with mission_of_rover() as (mission, robot):
        watch = mission.Watch()  # in the background by default
        assert watch.end is None
        assert mission.Drive(foreground=True).text == ""
        assert mission.first_ended([watch], timeout=0.01) == []
        with pytest.raises(Timeout, match=r"Watch \{\d+\} did not end within 0.01 s"):
            mission.wait_for_task(watch, timeout=0.01)
        robot.arrived.set()
        until(lambda: watch.sent.info() is None, "the watch has ended")
        assert Status.of(mission.wait_for_task(watch, timeout=0).status) is Status.COMPLETED
        assert watch.is_over


def test_wait_for_any_or_all_tasks() -> None:
    with mission_of_rover() as (mission, robot):
        watch, drive = mission.Watch(), mission.Drive(foreground=False)
        assert mission.wait_for_any_task([watch, drive]) is drive
        robot.arrived.set()
        assert len(mission.wait_for_all_tasks([drive, watch])) == 2


@pytest.mark.parametrize(
    ("fails", "status", "text", "failure"),
    [
        (
            "initialise",
            Status.INITIALISATION_FAILED,
            "no wheels",
            "mission task initialisation failed",
        ),
        ("rock", Status.FAILED, "rock: hit a rock", "rock"),
        ("python", Status.FAILED, "ValueError: a slip", "handler error"),
    ],
)
def test_failed_task_raises_and_the_mission_continues(
    fails: str, status: Status, text: str, failure: str
) -> None:
    with mission_of_rover() as (mission, _):
        with pytest.raises(MissionTaskFailed) as caught:
            mission.Drive(fails=fails)
        assert (Status.of(caught.value.status), caught.value.text) == (status, text)
        assert caught.value.failure == failure
        assert mission.Drive(x=1).status


def test_task_over_its_timeout_raises_with_status_timeout() -> None:
    with mission_of_rover() as (mission, robot):
        with pytest.raises(MissionTaskFailed) as caught:
            mission.Drive(fails="never", task_timeout=0.02)
        assert Status.of(caught.value.status) is Status.TIMEOUT
        assert robot.done[-1] == "stands at 0"


def test_displaced_foreground_task_is_interrupted() -> None:
    with mission_of_rover() as (mission, _):
        older = mission.start("Drive", x=1.0, fails="never")
        mission.Drive(x=2.0)
        with pytest.raises(MissionTaskFailed, match=r"interrupted: .*took its place"):
            mission.wait_for_task(older)


def test_update_task_changes_parameters_of_a_running_task() -> None:
    with mission_of_rover() as (mission, robot):
        drive = mission.start("Drive", x=1.0, fails="never")
        mission.update_task(drive, x=3.0, says="to the east")
        until(
            lambda: mission.running_tasks()[0].text == "to the east",
            "the task has its new parameter",
        )
        assert (
            mission.running_tasks()[0].parameters.items()
            >= {"x": 3.0, "fails": "never", "says": "to the east"}.items()
        )
        with pytest.raises(BadParameter, match="parameter 'x' must be at most 10"):
            mission.update_task(drive, x=30.0)
        with pytest.raises(
            Rejected, match="parameter 'foreground' can't be changed while the task runs"
        ):
            mission.update_task(drive, foreground=False)
        mission.update_task(drive, fails="")
        assert mission.wait_for_task(drive).text == "to the east"
        with pytest.raises(Rejected, match="it came too late"):
            mission.update_task(drive, x=4.0)
        assert robot.done == ["to 1", "stands at 3"]


def test_mission_misuse_is_reported_before_sending(approve: Callable[..., None]) -> None:
    with rover() as (central, robot), Mission("rover", central=central) as mission:

        def message_of(case: str) -> str:
            with pytest.raises((UnknownTask, BadParameter, MisuseError)) as caught:
                eval(case, vars(missions_api), {"mission": mission, "LEVEL": LEVEL})
            return f"{caught.type.__name__}: {caught.value}"

        approve("mistakes.txt", message_of)
        assert robot.done == []
        assert not [
            fact
            for fact in central.facts
            if isinstance(fact, facts.Received) and "rover." in fact.message
        ]


def test_mission_tasks_have_signature_help_and_name() -> None:
    with mission_of_rover() as (mission, _):
        assert {"Drive", "Watch", "Weigh", "wait_for_task"} <= set(dir(mission))
        assert str(inspect.signature(mission.Drive)).startswith(
            "(*, x: float = 0.0, gear: Literal['fast', 'slow'] = 'slow', fails: str = '', "
        )
        text = inspect.getdoc(mission.Drive)
        assert text is not None
        assert text.startswith(
            "Drive to a place.\n\nIt goes straight on.\n\nx: float = 0.0 (>= 0, <= 10)  East, in metres"
        )
        assert mission.Drive.__name__ == "Drive"
        assert not hasattr(mission, "Fly")


# --- conditions -----------------------------------------------------------------------------------


def test_verified_condition_interrupts_and_terminates_the_task() -> None:
    with mission_of_rover() as (mission, robot):
        watch = mission.Watch()
        mission.add_condition(ConditionIsCompleted(watch))
        mission.Drive(x=1.0)

        class Arrives:
            """A custom condition that never holds, but makes the other one hold."""

            def is_verified(self) -> bool:
                robot.arrived.set()
                return False

        mission.add_condition(Arrives())
        with pytest.raises(ConditionVerified, match=r"Watch \{\d+\} has ended") as caught:
            mission.Drive(x=2.0, fails="never")
        assert len(caught.value.conditions) == 1
        assert robot.done[-1] == "stands at 2"  # terminated before the exception
        mission.Drive(x=3.0)  # conditions are cleared when one is verified


def test_condition_that_already_holds_prevents_the_start() -> None:
    with mission_of_rover() as (mission, robot):
        watch = mission.Watch()
        mission.add_condition(ConditionIsCompleted(watch))
        robot.arrived.set()
        while watch.sent.info() is not None:
            pass
        with pytest.raises(ConditionVerified):
            mission.Drive()
        assert robot.done == ["watched"]


@pytest.mark.parametrize("stop_on_clear", [False, True])
def test_cleared_condition_stops_its_task_by_default(stop_on_clear: bool) -> None:
    with mission_of_rover() as (mission, robot):
        watch = mission.Watch()
        mission.add_condition(ConditionIsCompleted(watch, stop_on_clear=stop_on_clear))
        mission.clear_conditions()
        assert robot.done == (["watched"] if stop_on_clear else [])
        assert watch.is_over is stop_on_clear
        mission.Drive()


def test_repeated_rounds_with_conditions_leave_no_task() -> None:
    with mission_of_rover() as (mission, robot):
        for number in range(30):
            mission.add_condition(ConditionIsCompleted(mission.Watch()))
            mission.add_condition(When(lambda: robot.done[-1:] == ["to 9"]))
            try:
                mission.Drive(x=9.0 if number % 2 else 1.0, fails="never" if number % 2 else "")
                mission.clear_conditions()
            except ConditionVerified:
                assert number % 2
            assert mission.running_tasks() == []


class When:
    """A custom condition."""

    def __init__(self, holds: Callable[[], bool]) -> None:
        self.is_verified = holds


def test_refused_start_does_not_verify_a_condition() -> None:
    with LocalCentral() as central:
        server = TaskServer("rover", Rover(), tasks=TASKS, capacity=3, central=central)
        with server.running(), Mission("rover", central=central) as mission:
            mission.Watch()
            until(lambda: bool(server.runs), "the first one runs")
            mission.add_condition(ConditionIsCompleted(mission.Watch()))
            with pytest.raises(MissionTaskFailed, match="1 tasks run in the background already"):
                mission.Drive(fails="never")
            mission.Drive(x=1.0)  # the condition was cleared


def test_server_loss_does_not_verify_a_condition() -> None:
    with LocalCentral() as central, ExitStack() as stack:
        server = TaskServer("rover", Rover(), tasks=TASKS, central=central)
        stack.enter_context(server.running())
        with Mission("rover", central=central) as mission:
            condition = ConditionIsCompleted(mission.Watch())
            until(lambda: bool(server.runs), "the watch runs")
            stack.close()
            until(lambda: condition.task.is_over, "it has ended")
            with pytest.raises(MissionTaskFailed) as caught:
                condition.is_verified()
            assert caught.value.failure == "module lost"


@pytest.mark.parametrize(
    ("ends", "error"),
    [((), MissionTaskFailed), ((Status.TIMEOUT, Status.FAILED), ConditionVerified)],
)
def test_condition_accepts_configured_end_statuses(
    ends: tuple[Status, ...], error: type[Exception]
) -> None:
    with mission_of_rover() as (mission, robot):
        mission.add_condition(ConditionIsCompleted(mission.Watch(task_timeout=0.02), ends=ends))
        with pytest.raises(error):
            mission.Drive(x=2.0, fails="never")
        assert robot.done[-1] == "stands at 2"


# --- stopping -------------------------------------------------------------------------------------


def test_stopped_tasks_are_terminated() -> None:
    with mission_of_rover() as (mission, robot):
        watch, drive = mission.Watch(), mission.start("Drive", x=4.0, fails="never")
        mission.stop_task(drive)
        assert robot.done == ["to 4", "stands at 4"]
        mission.stop_all_tasks()
        assert robot.done[-1] == "watched"
        mission.stop_task(watch)  # already ended: no effect
        with pytest.raises(MissionTaskFailed, match="interrupted: the mission has stopped it"):
            mission.wait_for_task(watch)


@pytest.mark.parametrize("leave_running", [False, True])
def test_mission_end_stops_its_tasks_by_default(leave_running: bool) -> None:
    with rover() as (central, robot):
        with Mission("rover", central=central, leave_running=leave_running) as mission:
            mission.Watch()
        with connect("user", central) as user:
            assert ([task.message for task in user.tasks()] == ["rover.Watch"]) is leave_running
        assert robot.done == ([] if leave_running else ["watched"])


def test_interrupted_mission_stops_its_tasks_and_is_killed() -> None:
    with rover() as (central, robot):
        mission = Mission("rover", name="trip", central=central)
        with pytest.raises(KeyboardInterrupt), mission:
            drive_until_interrupted(mission, robot)
        assert robot.done == ["to 5", "stands at 5"]
        with connect("user", central) as user:
            assert user.tasks() == []
        received = [fact for fact in central.facts if isinstance(fact, facts.Received)]
        goal = next(fact.id for fact in received if fact.message == "mission trip")
        killed = [fact.task for fact in central.facts if isinstance(fact, facts.Killed)]
        assert goal in killed
        assert not any(isinstance(fact, facts.Failed) for fact in central.facts)


def drive_until_interrupted(mission: Mission, robot: Rover) -> None:
    mission.add_condition(Interrupts(robot))
    mission.Drive(x=5.0, fails="never")


class Interrupts:
    """A condition that raises KeyboardInterrupt while the rover drives."""

    def __init__(self, robot: Rover) -> None:
        self.robot = robot

    def is_verified(self) -> bool:
        if self.robot.done:
            raise KeyboardInterrupt
        return False


def test_mission_tasks_in_a_handler_are_children_of_its_task() -> None:
    fetch, ended = Goal("fetch"), list[str]()
    with rover() as (central, robot), connect("user", central) as user:
        planner = Module("planner", central)

        @planner.handles(fetch)
        def plan(task: Task) -> None:
            with Mission("rover", central=central, under=task) as mission:
                with pytest.raises(MissionTaskFailed, match="hit a rock"):
                    mission.Drive(fails="rock")
                try:
                    mission.Drive(x=7.0, fails="never")
                except TaskKilled as killed:
                    ended.append(killed.why)
                    raise

        with planner.running():
            fetching = user.goal(fetch)
            until(lambda: "to 7" in robot.done, "the rover drives")
            assert [task.message for task in fetching.children()] == ["rover.Drive"]
            fetching.kill("enough")
            assert fetching.wait(10) is Outcome.KILLED
        assert ended[0].startswith("enough (by user); the wait for rover.Drive {")
        assert robot.done[-1] == "stands at 7"


def test_concurrent_missions_of_one_name_stay_separate() -> None:
    with rover() as (central, _):
        ends: list[str] = []

        def weigh(number: int) -> None:
            with Mission("rover", name="weigh", central=central) as mission:
                ends.append(
                    mission.wait_for_task(mission.Weigh(grams=[number], foreground=False)).text
                )

        threads = [threading.Thread(target=weigh, args=(number,)) for number in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(ends) == [f"{number} g" for number in range(6)]
        with connect("user", central) as user:
            assert user.tasks() == []


def test_mission_fails_a_foreign_goal_of_its_name() -> None:
    with rover() as (central, _), connect("user", central) as user:
        with Mission("rover", name="weigh", central=central):
            other = user.goal(Goal("mission weigh", MissionInfo), MissionInfo("rover"))
            assert other.wait(10) is Outcome.FAILED


def test_mission_ends_when_its_goal_is_killed() -> None:
    with rover() as (central, robot), connect("operator", central) as operator:
        with Mission("rover", central=central) as mission:
            goal = next(task for task in operator.tasks() if task.message.startswith("mission "))
            drive = mission.start("Drive", fails="never")
            until(lambda: robot.done, "the rover drives")
            goal.kill("enough")
            with pytest.raises(TaskKilled, match="was killed: enough"):
                mission.wait_for_task(drive)
            with pytest.raises(TaskKilled, match="was killed: enough"):
                mission.Drive()
            assert robot.done == ["to 0", "stands at 0"]


# --- servers --------------------------------------------------------------------------------------


def test_mission_without_a_server_does_not_open() -> None:
    with rover() as (central, _):
        with pytest.raises(
            NotOffered, match=r"server 'rovre' offers no tasks after 0 s: did you mean 'rover'?"
        ):
            Mission("rovre", central=central, patience=0).open()
        with Mission(central=central) as mission:  # the only server
            assert mission.server == "rover"
        with TaskServer("other", Rover(), tasks=TASKS, central=central).running():
            with pytest.raises(MisuseError, match=r"several servers offer tasks: .*; name one"):
                Mission(central=central).open()
    with LocalCentral() as empty, pytest.raises(NotOffered, match="no server offers tasks"):
        Mission(central=empty, patience=0).open()


def test_mission_waits_for_its_server() -> None:
    with LocalCentral() as central:
        server = TaskServer("rover", Rover(), tasks=TASKS, central=central)

        def start() -> None:
            with server.running():
                ended.wait(10)

        ended, thread = threading.Event(), threading.Thread(target=start)
        with connect("user", central) as user:
            thread.start()
            with Mission("rover", central=central) as mission:
                mission.Drive()
            ended.set()
            thread.join()
            assert user.handlers(user.declared("rover.Drive")) == []


def test_call_after_server_left_raises_not_offered() -> None:
    with LocalCentral() as central:
        with TaskServer("rover", Rover(), tasks=TASKS, central=central).running():
            mission = Mission("rover", central=central).open()
            mission.Drive()
        with pytest.raises(
            NotOffered,
            match=r"server 'rover' offers no task now|no server offers rover.Drive any more",
        ):
            mission.Drive()
        mission.close()


def test_server_loss_fails_running_and_waiting_tasks() -> None:
    with LocalCentral() as central:
        rovers = TaskServer(
            "rover", Rover(), tasks=TASKS, central=central
        )  # never started: only its message is used
        module, started = Module("rover", central, capacity=1), threading.Event()

        def drive(task: Task, _: Any) -> TaskEnd:
            started.set()
            while not task.cancelled:
                pass
            return TaskEnd(Status.COMPLETED)

        module.handles(rovers.definitions["Drive"].message)(drive)
        with module.running(), Mission("rover", central=central) as mission:
            working = mission.start("Drive")
            assert started.wait(10)
            waiting, another = mission.start("Drive"), mission.start("Drive")
            module.stop()
            with pytest.raises(
                NotOffered,
                match=r"no server offers rover.Drive any more, and Drive \{\d+\} waited for it",
            ):
                mission.wait_for_task(waiting)
            with pytest.raises(MissionTaskFailed, match="failed: "):
                mission.wait_for_task(working)
            with pytest.raises(NotOffered, match=r"no server offers"):
                mission.wait_for_task(another)
