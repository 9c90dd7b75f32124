"""A run of a task, from initialise to terminate, with every kind of end."""

import logging

import pytest
from missions.gripper import Gripper, serving

from tca_behaviours.missions import (
    MISSION_TASK_FAILED,
    MISSION_TASK_INITIALISATION_FAILED,
    MISSION_TASK_TIMEOUT,
    OnceTask,
    PeriodicTask,
    Status,
    TaskEnd,
    status_of,
)
from tca_module import Command, Failure, Module, Task, TaskFailed, TaskKilled

DONE = Status.COMPLETED | Status.TERMINATED


def test_periodic_task_iterates_at_its_period() -> None:
    with serving() as robot:
        sent = robot.send("Turn", task_period=0.2)
        assert robot.after(1) == [
            "0.00 Turn initialises",
            "0.00 Turn step 1",
            "0.20 Turn step 2",
            "0.40 Turn step 3",
            "0.40 Turn terminates",
        ]
        assert sent.result() == TaskEnd(DONE)


def test_server_rate_is_the_default_period() -> None:
    with serving(rate=2) as robot:
        robot.send("Turn", steps=2)
        assert robot.after(1)[1:3] == ["0.00 Turn step 1", "0.50 Turn step 2"]


def test_once_task_runs_iterate_and_terminate() -> None:
    with serving() as robot:
        sent = robot.send("Grasp", force=2)
        assert robot.after(2) == [
            "0.00 Grasp closes",
            "1.00 Grasp has closed",
            "1.00 Grasp terminates",
        ]
        assert sent.result() == TaskEnd(DONE, "closed")


@pytest.mark.parametrize(
    ("fails_in", "failure", "text", "status"),
    [
        ("iterate", MISSION_TASK_FAILED, "the wrist is stuck", Status.FAILED),
        ("status", MISSION_TASK_FAILED, "iterate() returned FAILED", Status.FAILED),
        ("terminate", MISSION_TASK_FAILED, "the brake does not hold", Status.FAILED),
    ],
)
def test_failed_run_is_terminated(
    fails_in: str, failure: Failure[None], text: str, status: Status
) -> None:
    with serving() as robot:
        sent = robot.send("Turn", fails_in=fails_in)
        assert robot.after(1)[-1].endswith("Turn terminates")
        with pytest.raises(TaskFailed) as failed:
            sent.result()
        assert (failed.value.failure, failed.value.text) == (failure.name, text)
        assert status_of(failed.value.failure) is status


def test_run_that_failed_to_initialise_is_not_terminated(caplog: pytest.LogCaptureFixture) -> None:
    with serving() as robot, caplog.at_level(logging.CRITICAL, "tca.gripper"):
        sent = robot.send("Turn", fails_in="initialise")
        assert robot.after(1) == ["0.00 Turn initialises"]
        with pytest.raises(TaskFailed) as failed:
            sent.result()
        assert failed.value.failure == MISSION_TASK_INITIALISATION_FAILED.name
        assert failed.value.text == "ValueError: the wrist is stuck"
        assert status_of(failed.value.failure) is Status.INITIALISATION_FAILED


@pytest.mark.parametrize("task", ["Turn", "Grasp"])
def test_timed_out_run_is_terminated(task: str) -> None:
    with serving() as robot:
        sent = robot.send(
            task, task_timeout=0.25, **({"steps": 9} if task == "Turn" else {"force": 2})
        )
        assert robot.after(1)[-1] == f"0.25 {task} terminates"
        with pytest.raises(TaskFailed, match=r"it ran for 0\.25 s") as failed:
            sent.result()
        assert failed.value.failure == MISSION_TASK_TIMEOUT.name


def test_run_within_its_timeout_completes() -> None:
    with serving() as robot:
        sent = robot.send("Grasp", force=2, task_timeout=1.5)
        robot.after(3)
        assert sent.result().status == DONE


@pytest.mark.parametrize("task", ["Turn", "Grasp"])
def test_killed_run_is_terminated_at_once(task: str) -> None:
    with serving() as robot:
        sent = robot.send(task, **({"steps": 9} if task == "Turn" else {"force": 2}))
        robot.after(0.15)
        sent.kill("enough")
        assert robot.after(0) == [f"0.15 {task} terminates"]
        with pytest.raises(TaskKilled, match="enough"):
            sent.result()


@pytest.mark.parametrize("task", ["Turn", "Grasp"])
def test_server_end_terminates_the_run(task: str) -> None:
    with serving() as robot:
        robot.send(task, **({"steps": 9} if task == "Turn" else {"force": 2}))
        robot.after(0.15)
    assert robot.gripper.read() == [f"0.15 {task} terminates"]


def test_keyboard_interrupt_in_iterate_terminates_the_run() -> None:
    class Broken(PeriodicTask[Gripper]):
        def iterate(self) -> Status:
            raise KeyboardInterrupt

        def terminate(self) -> None:
            self.env.note(self, "terminates")

    with pytest.raises(KeyboardInterrupt), serving(Broken) as robot:
        robot.send("Broken").wait()
    assert robot.gripper.read() == ["0.00 Broken terminates"]


def test_kill_does_not_shorten_terminate() -> None:
    class Careful(PeriodicTask[Gripper]):
        def iterate(self) -> Status:
            return Status.COMPLETED

        def terminate(self) -> None:
            self.env.note(self, "brakes")
            self.sleep(1.0)
            self.env.note(self, "stands")

    with serving(Careful) as robot:
        sent = robot.send("Careful")
        robot.after(0.5)
        sent.kill()
        assert robot.after(2) == ["1.00 Careful stands"]


STUCK = Failure("stuck", float)


def test_custom_failure_keeps_its_name_and_data() -> None:
    class Bend(PeriodicTask[Gripper]):
        def iterate(self) -> Status:
            raise STUCK(0.5)

    with serving(Bend) as robot:
        sent = robot.send("Bend")
        robot.after(0)
        with pytest.raises(TaskFailed) as failed:
            sent.result()
        assert failed.value.data_as(STUCK) == 0.5
        assert status_of(failed.value.failure) is Status.FAILED


NAME = Command("name", result=str)


def test_run_is_the_parent_of_its_subtasks() -> None:
    class Ask(OnceTask[Gripper]):
        def iterate(self) -> None:
            self.report(self.task.command(NAME).result())

    with serving(Ask) as robot:
        helper = Module("helper", robot.central)

        @helper.handles(NAME)
        def name(task: Task) -> str:
            parent = task.parent()
            assert parent is not None
            return f"under {parent.message}"

        with helper.running():
            sent = robot.send("Ask")
            robot.after(0)
            assert sent.result().text == "under gripper.Ask"


class Careless(PeriodicTask[Gripper]):
    says: str = ""

    def initialise(self) -> None:
        if self.says == "too late":
            self.sleep(1.0)

    def iterate(self) -> Status:
        return {"nothing": None, "a word": "done"}[self.says]  # type: ignore[return-value]

    def terminate(self) -> None:
        self.env.note(self, "terminates")


class CarelessOnce(OnceTask[Gripper]):
    def iterate(self) -> Status:
        return Status.RUNNING


@pytest.mark.parametrize(
    ("task", "says", "text"),
    [
        (
            "Careless",
            "nothing",
            "iterate() returned None: return Status.RUNNING or Status.COMPLETED",
        ),
        (
            "Careless",
            "a word",
            "iterate() returned 'done': return Status.RUNNING or Status.COMPLETED",
        ),
        (
            "CarelessOnce",
            "",
            "iterate() returned RUNNING, but the task runs once: return COMPLETED",
        ),
    ],
)
def test_invalid_iterate_result_fails_the_run(task: str, says: str, text: str) -> None:
    with serving(Careless, CarelessOnce) as robot:
        sent = robot.send(task, **({"says": says} if says else {}))
        robot.after(1)
        with pytest.raises(TaskFailed) as failed:
            sent.result()
        assert failed.value.text == text


def test_run_killed_while_initialising_is_not_terminated() -> None:
    with serving(Careless) as robot:
        sent = robot.send("Careless", says="too late")
        robot.after(0.5)
        sent.kill()
        assert robot.after(2) == []
        assert robot.user.tasks() == []
