"""Foreground and background: the newest run displaces the current one, and the idle task displaces
none.
"""

import logging
import threading

import pytest
from missions.gripper import Brake, Grasp, Gripper, Robot, Turn, serving
from module.real_central import until

from tca_behaviours.missions import Idle, OnceTask, Status, TaskEnd
from tca_module import Outcome, SentTask, TaskFailed, TaskKilled
from tca_wire.journal import facts


def names(robot: Robot) -> list[str]:
    """Return the names of all runs."""
    return [task.message.removeprefix("gripper.") for task in robot.user.tasks()]


def outcome(sent: SentTask[TaskEnd]) -> Outcome:
    return sent.wait(0)


def test_new_foreground_run_waits_until_the_old_one_terminated() -> None:
    with serving(Brake, Turn) as robot:
        brake = robot.send("Brake")
        robot.after(1)
        turn = robot.send("Turn", steps=1)
        assert robot.after(5) == [
            "1.00 Brake brakes",
            "2.00 Brake stands",
            "2.00 Turn initialises",
            "2.00 Turn step 1",
            "2.00 Turn terminates",
        ]
        assert (outcome(brake), outcome(turn)) == (Outcome.KILLED, Outcome.DONE)
        with pytest.raises(TaskKilled, match=r"gripper.Turn \{2\} took its place"):
            brake.result()


def test_newest_waiting_foreground_run_starts() -> None:
    with serving(Brake, Turn, Grasp) as robot:
        robot.send("Brake")
        robot.after(1)
        turn = robot.send("Turn")
        robot.after(0.5)
        robot.send("Grasp", force=1)
        assert robot.after(5) == [
            "2.00 Brake stands",
            "2.00 Grasp closes",
            "3.00 Grasp has closed",
            "3.00 Grasp terminates",
        ]
        assert outcome(turn) is Outcome.KILLED


def test_killed_waiting_run_does_nothing() -> None:
    with serving(Brake, Turn) as robot:
        robot.send("Brake")
        robot.after(1)
        turn = robot.send("Turn")
        robot.after(0.5)
        turn.kill()
        assert robot.after(5) == ["2.00 Brake stands"]


def test_run_with_late_thread_does_not_displace_a_newer_one() -> None:
    may_begin = threading.Event()

    class Born(Turn):
        def __init__(self) -> None:
            if not born:
                born.append(self)
                may_begin.wait(5)

    born: list[Born] = []
    with serving(Born) as robot:
        older = robot.send("Born", steps=9)
        until(lambda: born, "its thread begins")
        newer = robot.send("Born", steps=1)
        assert newer.result(5).status == Status.COMPLETED | Status.TERMINATED
        assert len(robot.gripper.read()) == 3
        may_begin.set()
        with pytest.raises(TaskKilled, match=r"gripper.Born \{2\} took its place"):
            older.result(5)
        robot.central.until_quiet()
        assert robot.gripper.read() == []


def test_long_wait_for_the_foreground_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    with serving(Brake, Turn) as robot:
        robot.send("Brake", seconds=11)
        robot.after(0)
        turn = robot.send("Turn")
        said_of_turn = turn.progress()
        robot.after(0)
        assert not caplog.records
        robot.after(12)
        texts = [status.text for status in said_of_turn.arrived()]
        assert texts[:2] == ["waits until gripper.Brake {1} has terminated", ""]
    messages = [record.getMessage() for record in caplog.records]
    assert messages == ["gripper.Turn {2} waits until gripper.Brake {1} has terminated"] * 2


def test_background_runs_overlap_the_foreground_run() -> None:
    with serving() as robot:
        grasp = robot.send("Grasp", force=1, foreground=False)
        turn = robot.send("Turn", foreground=False)
        front = robot.send("Turn", steps=1)
        robot.after(5)
        assert {outcome(grasp), outcome(turn), outcome(front)} == {Outcome.DONE}


def test_background_runs_leave_a_slot_for_the_foreground() -> None:
    with serving(capacity=3) as robot:
        robot.send("Grasp", force=1, foreground=False)
        more = robot.send("Grasp", force=1, foreground=False)
        turn = robot.send("Turn")
        robot.after(0.5)
        assert outcome(turn) is Outcome.DONE
        with pytest.raises(
            TaskFailed,
            match="1 tasks run in the background already: give the server a larger capacity=",
        ):
            more.result()


def test_server_without_idle_task_stays_empty() -> None:
    with serving() as robot:
        robot.after(1)
        assert names(robot) == []


def test_idle_task_runs_while_the_foreground_is_free() -> None:
    with serving(idle=Idle) as robot:
        assert names(robot) == []
        robot.after(1)
        assert names(robot) == ["Idle"]
        turn = robot.send("Turn")
        robot.after(0)
        assert names(robot) == ["Turn"]
        robot.send("Grasp", force=1, foreground=False)
        robot.after(0.5)
        assert outcome(turn) is Outcome.DONE
        assert names(robot) == ["Grasp", "Idle"]


def test_idle_task_does_not_start_between_mission_steps() -> None:
    with serving(idle=Idle) as robot:
        for _ in range(3):
            robot.send("Turn", steps=1)
            robot.after(0.1)
        assert names(robot) == []


def test_idle_task_does_not_displace_the_foreground_run() -> None:
    with serving(idle=Idle) as robot:
        grasp = robot.send("Grasp", force=1)
        robot.after(0.5)
        idle = robot.send("Idle")
        robot.after(1)
        assert outcome(grasp) is Outcome.DONE
        assert idle.result().text == "another task has the foreground"


def test_completed_idle_task_runs_once_per_idle_time() -> None:
    class Rest(OnceTask[Gripper]):
        def iterate(self) -> None:
            self.env.note(self, "brakes")

    with serving(Turn, Rest, idle=Rest) as robot:
        assert robot.after(10) == ["0.20 Rest brakes"]
        robot.send("Turn", steps=1)
        assert robot.after(10)[-1] == "10.20 Rest brakes"


def test_failed_idle_task_is_retried_after_five_seconds(caplog: pytest.LogCaptureFixture) -> None:
    class Rest(OnceTask[Gripper]):
        def iterate(self) -> None:
            self.env.note(self, "tries")
            raise self.failed("the brake is stuck")

    with caplog.at_level(logging.CRITICAL, "tca"), serving(Rest, idle=Rest) as robot:
        assert robot.after(11) == ["0.20 Rest tries", "5.20 Rest tries", "10.20 Rest tries"]


def test_stopped_server_kills_its_idle_task() -> None:
    with serving(idle=Idle) as robot:
        robot.after(1)
    ends = [fact for fact in robot.central.facts if isinstance(fact, facts.Failed | facts.Killed)]
    assert [type(end) for end in ends] == [facts.Killed]
