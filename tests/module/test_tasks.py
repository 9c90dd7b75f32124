"""Goals and commands: the tree they make, their order, their results and failures, told as small stories."""

import operator
import threading

import pytest
from module.gait_messages import MOVE_LEG, REST, STANCE, STEP, STOP, WALK, Arc, Footfall
from module.robot import Robot

from tca_module import Client, Constraint, MisuseError, Outcome, Refused, Task, Timeout, this
from tca_wire.journal.facts import WaitBegan, WaitEnded
from tca_wire.points import Moment, Point

SOON = 5.0


def test_a_goal_is_planned_into_commands_that_are_done_in_order(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        robot.done.append("plan")
        for leg in range(arc.steps):
            task.command(MOVE_LEG, leg)

    with robot.running():
        goal = user.goal(WALK, Arc(2.0, 3))
        assert goal.wait(SOON) is Outcome.DONE
        goal.result(SOON)
    assert robot.done == ["plan", "leg 0", "leg 1", "leg 2"]
    assert [fact.parent for fact in robot.received("move leg")] == [goal.id] * 3
    assert robot.order_of(Moment.END_ACHIEVING) == [goal.id + 1, goal.id + 2, goal.id + 3, goal.id]


def test_a_command_has_a_result(robot: Robot, user: Client) -> None:
    with robot.running():
        move = user.command(MOVE_LEG, 4)
        assert move.result(SOON) == Footfall(4, 0.5)
        assert move.result() == Footfall(4, 0.5)
        assert (move.message, repr(move)) == ("move leg", f"move leg {{{move.id}}}")


def test_a_handler_that_waits_for_a_result_blocks_for_its_own_task(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        footfall = task.command(MOVE_LEG, 1).result(SOON)
        robot.done.append(f"height {footfall.height}")

    with robot.running():
        user.goal(WALK, Arc(1.0, 1)).result(SOON)
    assert robot.done == ["leg 1", "height 0.5"]
    waits = [fact for fact in robot.central.facts if isinstance(fact, WaitBegan)]
    assert {(wait.module, wait.origin) for wait in waits} == {("user", 0), ("planner", 1)}


def test_what_a_querys_handler_sends_hangs_under_the_root(robot: Robot, user: Client) -> None:
    @robot.planner.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        return [task.command(MOVE_LEG, 1).result(SOON).leg]

    with robot.running():
        assert user.query(STANCE, 1.0) == [1]
    assert [(fact.parent, fact.origin) for fact in robot.received("move leg")] == [(0, 1)]


def test_flags_and_constraints_of_one_task(robot: Robot, user: Client) -> None:
    robot.planner.handles(STEP)(lambda _, _number: None)

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        first = task.command(MOVE_LEG, 1)
        task.goal(
            STEP, 2, sequential=False, delay_planning=True, constraints=[first.handling.end <= this.planning.start]
        )
        task.goal(STEP, 3, sequential_planning=True)
        last = task.goal(STEP, 4, plan_first=True, sequential=False)
        task.constrain(last.achieving.start >= first.achieving.end)

    with robot.running():
        user.goal(REST).result(SOON)
    constraints = [[str(constraint) for constraint in fact.constraints] for fact in robot.received("step")]
    assert constraints[0][0] == "start achieving task 3 <= start planning task 3"
    assert constraints[1]
    assert all("task 4" in text for text in constraints[1])
    assert constraints[2] == ["end planning task 5 <= start achieving task 5"]


def test_own_points_can_be_constrained(robot: Robot, user: Client) -> None:
    """What the handler's task plans is not done before the handler has returned."""

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        move = task.command(MOVE_LEG, 1, constraints=[task.handling.end <= this.achieving.start])
        with pytest.raises(Timeout, match=r"start achieving task 2 .'move leg'. was not reached within 0.05 s"):
            move.wait_for(move.achieving.start, timeout=0.05)

    with robot.running():
        user.goal(REST).result(SOON)
    assert robot.done == ["leg 1"]


def test_a_circle_is_refused_and_nothing_of_it_remains(robot: Robot, user: Client) -> None:
    first, second = user.goal(REST), user.goal(REST)
    with pytest.raises(Refused, match=r"constraint .* was refused: .* would be a circle"):
        user.constrain(second.achieving.end <= first.achieving.start)
    with pytest.raises(Refused, match=r"goal 'rest' was refused: .* would be a circle"):
        user.goal(REST, constraints=[this.achieving.end <= this.achieving.start])
    user.constrain()
    assert user.status()["tasks"] == 2


def test_a_chain_of_comparisons_is_no_constraint(user: Client) -> None:
    first, second = user.goal(REST), user.goal(REST)
    one = first.achieving.end <= second.planning.start
    assert isinstance(one, Constraint)
    assert str(one) == "end achieving task 1 <= start planning task 2"
    assert str(second.planning.start >= first.achieving.end) == str(one)
    for other in (second.planning.start, first.handling.end + 2.0):
        for compare in (operator.lt, operator.gt):
            with pytest.raises(MisuseError, match=r"write first.achieving.end <= second.achieving.start"):
                compare(first.achieving.end, other)
            with pytest.raises(MisuseError, match=r"points are compared with <= and >="):
                compare(other, first.achieving.end)
    with pytest.raises(MisuseError, match="write a <= b <= c as two constraints"):
        _ = first.achieving.start <= first.achieving.end <= second.planning.start


def test_waiting_for_a_point(robot: Robot, user: Client) -> None:
    go = threading.Event()

    @robot.legs.handles(STOP)
    def wait(task: Task) -> None:
        assert go.wait(SOON)

    with robot.running():
        stop = user.command(STOP)
        assert stop.wait_for(stop.handling.start, SOON) is Outcome.DONE
        with pytest.raises(Timeout, match=r"end achieving task 1 \('stop'\) was not reached within 0.01 s"):
            stop.result(0.01)
        assert robot.central.facts.count(WaitEnded("user", 0, stop.id)) == 2  # the second was given up
        go.set()
        assert stop.wait_for(stop.handling.end, SOON) is Outcome.DONE
        stop.result(SOON)
        with pytest.raises(MisuseError, match="point must be a point of a task"):
            stop.wait_for("end")  # type: ignore[arg-type]
        with pytest.raises(Refused, match="there is no task 99"):
            stop.wait_for(Point(99, Moment.END_ACHIEVING))  # type: ignore[arg-type]


def test_only_tasks_have_points(robot: Robot, user: Client) -> None:
    @robot.planner.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        with pytest.raises(MisuseError, match="'stance' is no task of the tree and has no points"):
            _ = task.achieving
        return []

    with robot.running():
        assert user.query(STANCE, 1.0) == []
