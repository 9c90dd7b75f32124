"""Goals and commands: the tree they make, their order, their results and failures, told as small stories."""

import queue
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest
from module.gait_messages import COLLISION, EXHAUSTED, MOVE_LEG, REST, STANCE, STEP, STOP, WALK, Arc, Footfall

from tca_module import (
    BadData,
    CentralLost,
    Client,
    Command,
    Constraint,
    MisuseError,
    Module,
    Outcome,
    Refused,
    Task,
    TaskFailed,
    TaskKilled,
    Timeout,
    this,
)
from tca_module.testing import LocalCentral
from tca_wire.facts import Delivered, Reached, Received, WaitBegan, WaitEnded
from tca_wire.points import Moment, Point

SOON = 5.0


class Robot:
    """A planner and legs; what they did is in ``done``, in order."""

    def __init__(self, central: LocalCentral) -> None:
        self.central = central
        self.planner = Module("planner", central)
        self.legs = Module("legs", central)
        self.done: list[str] = []
        self.legs.handles(MOVE_LEG)(self.move_leg)

    def move_leg(self, task: Task, leg: int) -> Footfall:
        self.done.append(f"leg {leg}")
        return Footfall(leg, 0.5)

    @contextmanager
    def running(self) -> Iterator[None]:
        with ExitStack() as stack:
            for module in (self.legs, self.planner):
                stack.enter_context(module.running())
            yield

    def received(self, name: str) -> list[Received]:
        return [fact for fact in self.central.facts if isinstance(fact, Received) and fact.message == name]

    def order_of(self, moment: Moment) -> list[int]:
        """The tasks that reached a moment, in that order."""
        return [fact.task for fact in self.central.facts if isinstance(fact, Reached) and fact.moments & moment]


@pytest.fixture
def robot(central: LocalCentral) -> Robot:
    return Robot(central)


# --- the tree -------------------------------------------------------------------------------------------------------


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
        assert (move.message, repr(move)) == ("move leg", f"task {move.id} 'move leg'")


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


# --- order ----------------------------------------------------------------------------------------------------------


def test_blocks_order_the_children(robot: Robot, user: Client) -> None:
    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        task.command(MOVE_LEG, 0)
        with task.parallel():
            task.command(MOVE_LEG, 1)
            with task.sequence():
                task.command(MOVE_LEG, 2)
                task.command(MOVE_LEG, 3)
        task.command(MOVE_LEG, 4)

    with robot.running():
        user.goal(REST).result(SOON)
    constraints = {
        (constraint.before.task, fact.id) for fact in robot.received("move leg") for constraint in fact.constraints
    }
    assert constraints <= {(2, 3), (2, 4), (4, 5), (3, 6), (5, 6)}
    assert robot.done.index("leg 2") < robot.done.index("leg 3")
    assert (robot.done[0], robot.done[-1]) == ("leg 0", "leg 4")


@pytest.mark.parametrize(("ahead", "planned"), [(0, 1), (1, 2), (2, 3), (None, 4)])
def test_planning_runs_ahead_of_doing_as_far_as_allowed(
    robot: Robot, user: Client, ahead: int | None, planned: int
) -> None:
    """While the first step is being done, so many steps have been planned."""
    moving, go = threading.Event(), threading.Event()
    steps_planned: queue.Queue[int] = queue.Queue()

    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        with task.sequence(plan_ahead=ahead):
            for step in range(arc.steps):
                task.goal(STEP, step)

    @robot.planner.handles(STEP)
    def step(task: Task, number: int) -> None:
        task.command(STOP)
        steps_planned.put(number)

    @robot.legs.handles(STOP)
    def stop(task: Task) -> None:
        moving.set()
        assert go.wait(SOON)

    with robot.running():
        goal = user.goal(WALK, Arc(1.0, 4))
        assert moving.wait(SOON)
        assert [steps_planned.get(timeout=SOON) for _ in range(planned)] == list(range(planned))
        with pytest.raises(Timeout):
            goal.wait(0.05)
        assert steps_planned.empty()
        go.set()
        goal.result(SOON)
    assert steps_planned.qsize() == 4 - planned


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


def test_a_child_out_of_sequence_is_waited_for_by_what_follows_it_in_a_block(robot: Robot, user: Client) -> None:
    with user.sequence():
        user.goal(STEP, 1)
        user.goal(STEP, 2, sequential=False)
        user.goal(STEP, 3)
    constraints = [{one.before.task for one in fact.constraints} for fact in robot.received("step")]
    assert constraints == [set(), set(), {1, 2}]


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
    with pytest.raises(MisuseError, match="write a <= b <= c as two constraints"):
        _ = first.achieving.start <= first.achieving.end <= second.planning.start


def test_higher_priority_goes_first(robot: Robot, user: Client) -> None:
    for number, priority in enumerate([0, 5, 1]):
        user.command(MOVE_LEG, number, priority=priority, sequential=False)
    with robot.running():
        user.command(MOVE_LEG, 3).result(SOON)
    assert robot.done == ["leg 1", "leg 2", "leg 0", "leg 3"]


# --- points in time ---------------------------------------------------------------------------------------------------


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
        with pytest.raises(MisuseError, match="'end' is no point of a task"):
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


# --- failures -----------------------------------------------------------------------------------------------------------


def test_a_failure_goes_up_with_its_data(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        raise COLLISION(Footfall(2, arc.radius), "rock")

    with robot.running():
        goal = user.goal(WALK, Arc(0.25, 1))
        with pytest.raises(TaskFailed, match="task 1 'walk' failed: collision: rock") as failed:
            goal.result(SOON)
    assert (failed.value.failure, failed.value.text) == ("collision", "rock")
    assert failed.value.data_as(COLLISION) == Footfall(2, 0.25)
    assert goal.wait() is Outcome.FAILED


def test_a_failure_without_data(robot: Robot, user: Client) -> None:
    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        raise EXHAUSTED  # type: ignore[misc]

    @robot.planner.handles(STOP)
    def stop(task: Task) -> None:
        raise EXHAUSTED()  # noqa: RSE102

    with robot.running():
        with pytest.raises(TaskFailed, match="handler error: TypeError"):
            user.goal(REST).result(SOON)
        with pytest.raises(TaskFailed, match=r"failed: exhausted$") as failed:
            user.command(STOP).result(SOON)
    assert failed.value.data_as(EXHAUSTED) is None
    assert failed.value.data is None


def test_an_unexpected_exception_fails_with_its_traceback_and_the_module_goes_on(
    robot: Robot, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        if not arc.steps:
            raise SystemExit(3)
        _ = arc.steps / int(arc.radius)

    with robot.running():
        with pytest.raises(TaskFailed, match=r"handler error: ZeroDivisionError: division by zero$") as failed:
            user.goal(WALK, Arc(0, 1)).result(SOON)
        assert "in walk\n    _ = arc.steps / int(arc.radius)" in failed.value.text
        with pytest.raises(TaskFailed, match="handler error: SystemExit: 3"):
            user.goal(WALK, Arc(0, 0)).result(SOON)
        user.goal(WALK, Arc(1.0, 1)).result(SOON)
    assert "handler test_an_unexpected_exception" in caplog.text


def test_a_wrong_result_fails_the_task(robot: Robot, user: Client) -> None:
    measure = Command("measure", result=float)
    robot.planner.handles(measure)(lambda _: "high")  # type: ignore[arg-type]
    robot.planner.handles(REST)(lambda _: 5)  # type: ignore[arg-type]
    with robot.running():
        with pytest.raises(TaskFailed, match="bad data: the handler of command 'measure' must return float") as failed:
            user.command(measure).result(SOON)
        assert failed.value.failure == "bad data"
        with pytest.raises(TaskFailed, match="the handler of goal 'rest' must return None"):
            user.goal(REST).result(SOON)


def test_a_failure_of_a_child_reaches_a_handler_that_waits(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        try:
            task.command(STOP).result(SOON)
        except TaskFailed as error:
            robot.done.append(error.failure)

    @robot.legs.handles(STOP)
    def stop(task: Task) -> None:
        raise COLLISION(Footfall(1, 0.0))

    with robot.running():
        assert user.goal(WALK, Arc(1.0, 1)).wait(SOON) is Outcome.FAILED
    assert robot.done == ["collision"]


# --- killing ------------------------------------------------------------------------------------------------------------


def test_a_killed_task_is_told_and_its_end_reported(robot: Robot, user: Client) -> None:
    started, seen = threading.Event(), queue.Queue[bool]()

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        seen.put(task.cancelled)
        started.set()
        with pytest.raises(TaskKilled):
            task.command(STOP).result(SOON)
        seen.put(task.cancelled)

    with robot.running():
        goal = user.goal(REST)
        assert started.wait(SOON)
        goal.kill("enough")
        with pytest.raises(TaskKilled, match="task 1 'rest' was killed: enough") as killed:
            goal.result(SOON)
        assert (killed.value.why, goal.wait()) == ("enough", Outcome.KILLED)
        goal.kill()
    assert [seen.get(timeout=SOON) for _ in range(2)] == [False, True]


def test_a_task_that_was_killed_is_not_handled(robot: Robot, user: Client) -> None:
    user.command(MOVE_LEG, 1).kill()
    with robot.running():
        user.command(MOVE_LEG, 2).result(SOON)
    assert robot.done == ["leg 2"]
    assert sum(isinstance(fact, Delivered) for fact in robot.central.facts) == 1


def test_a_task_is_of_no_use_after_its_handler(robot: Robot, user: Client) -> None:
    kept: list[Task] = []
    robot.planner.handles(REST)(kept.append)
    with robot.running():
        user.goal(REST).result(SOON)
    with pytest.raises(MisuseError, match="task 1 'rest' is used after its handler returned"):
        kept[0].goal(REST)
    with pytest.raises(MisuseError, match="after its handler returned"):
        _ = kept[0].cancelled


def test_a_result_that_central_no_longer_keeps(robot: Robot, user: Client) -> None:
    with robot.running():
        move = user.command(MOVE_LEG, 1)
        assert move.wait_for(move.achieving.end, SOON) is Outcome.DONE
        robot.central.core.outcomes.clear()
        with pytest.raises(BadData, match="the result of task 1 'move leg' is no longer kept"):
            move.result()


def test_after_a_restart_of_central_its_tasks_are_unknown(robot: Robot, user: Client) -> None:
    goal = user.goal(REST)
    with user.parallel():
        user.goal(REST)
        robot.central.restart("afresh")
        with pytest.raises(CentralLost, match="is lost: central was restarted"):
            goal.wait()
        user.goal(REST)  # in no order with what was forgotten
    with pytest.raises(CentralLost, match="central was restarted and has forgotten task 1 'rest': send it again"):
        goal.result()
    with pytest.raises(CentralLost):
        goal.kill()
    assert user.status()["tasks"] == 1
