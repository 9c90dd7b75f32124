"""Tasks: their tree, order, results and failures, and retained tasks."""

import operator
import threading
from collections.abc import Iterator

import pytest
from module.real_central import SOON, Gate
from module.robot import (
    COLLISION,
    EXHAUSTED,
    MOVE_LEG,
    REST,
    STANCE,
    STEP,
    STOP,
    WALK,
    Arc,
    Footfall,
    Robot,
)

from tca_module import (
    BadData,
    Client,
    Command,
    Constraint,
    ExceptionHandler,
    Failure,
    Goal,
    MisuseError,
    Module,
    Outcome,
    Query,
    Recovery,
    Refused,
    Task,
    TaskFailed,
    Timeout,
    connect,
    this,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import Failed, WaitBegan, WaitEnded
from tca_wire.points import Moment, Point


def test_goal_expands_into_commands_done_in_order(robot: Robot, user: Client) -> None:
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


def test_result_wait_in_handler_is_journaled_for_its_task(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        footfall = task.command(MOVE_LEG, 1).result(SOON)
        robot.done.append(f"height {footfall.height}")

    with robot.running():
        user.goal(WALK, Arc(1.0, 1)).result(SOON)
    assert robot.done == ["leg 1", "height 0.5"]
    waits = [fact for fact in robot.central.facts if isinstance(fact, WaitBegan)]
    assert {(wait.module, wait.origin) for wait in waits} == {("user", 0), ("planner", 1)}


def test_task_sent_by_query_handler_stands_under_root(robot: Robot, user: Client) -> None:
    @robot.planner.handles(STANCE)
    def stance(task: Task, radius: float) -> list[int]:
        with pytest.raises(MisuseError, match="'stance' is no task of the tree"):
            _ = task.achieving
        return [task.command(MOVE_LEG, 1).result(SOON).leg]

    with robot.running():
        assert user.query(STANCE, 1.0) == [1]
    assert [(fact.parent, fact.origin) for fact in robot.received("move leg")] == [(0, 1)]


def test_task_flags_become_constraints(robot: Robot, user: Client) -> None:
    robot.planner.handles(STEP)(lambda _, _number: None)

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        first = task.command(MOVE_LEG, 1)
        task.goal(
            STEP,
            2,
            sequential=False,
            delay_planning=True,
            constraints=[first.handling.end <= this.planning.start],
        )
        task.goal(STEP, 3, sequential_planning=True)
        last = task.goal(STEP, 4, plan_first=True, sequential=False)
        task.constrain(last.achieving.start >= first.achieving.end)

    with robot.running():
        user.goal(REST).result(SOON)
    constraints = [
        [str(constraint) for constraint in fact.constraints] for fact in robot.received("step")
    ]
    assert constraints[0][0] == "start achieving task 3 <= start planning task 3"
    assert constraints[1]
    assert all("task 4" in text for text in constraints[1])
    assert constraints[2] == ["end planning task 5 <= start achieving task 5"]


def test_handler_constrains_its_own_points(robot: Robot, user: Client) -> None:
    """The handler's own return is made to precede the achieving of its subtask."""

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        move = task.command(MOVE_LEG, 1, constraints=[task.handling.end <= this.achieving.start])
        with pytest.raises(
            Timeout, match=r"start achieving of move leg \{2\} was not reached within 0.05 s"
        ):
            move.wait_for(move.achieving.start, timeout=0.05)

    with robot.running():
        user.goal(REST).result(SOON)
    assert robot.done == ["leg 1"]


def test_circular_constraint_is_refused_without_trace(robot: Robot, user: Client) -> None:
    first, second = user.goal(REST), user.goal(REST)
    with pytest.raises(
        Refused, match=r"^adding 1 constraint was refused: constraint .* would be a cycle"
    ):
        user.constrain(second.achieving.end <= first.achieving.start)
    with pytest.raises(Refused, match=r"goal 'rest' was refused: .* would be a cycle"):
        user.goal(REST, constraints=[this.achieving.end <= this.achieving.start]).id  # noqa: B018
    user.constrain()
    assert user.status()["tasks"] == 2


def test_chained_or_strict_point_comparison_is_misuse(user: Client) -> None:
    first, second = user.goal(REST), user.goal(REST)
    one = first.achieving.end <= second.planning.start
    assert isinstance(one, Constraint)
    assert str(one) == "end achieving task 1 <= start planning task 2"
    assert str(second.planning.start >= first.achieving.end) == str(one)
    for other in (second.planning.start, first.handling.end + 2.0):
        for compare in (operator.lt, operator.gt):
            with pytest.raises(
                MisuseError, match=r"write first.achieving.end <= second.achieving.start"
            ):
                compare(first.achieving.end, other)
            with pytest.raises(MisuseError, match=r"points are compared with <= and >="):
                compare(other, first.achieving.end)
    with pytest.raises(MisuseError, match="write a <= b <= c as two constraints"):
        _ = first.achieving.start <= first.achieving.end <= second.planning.start


def test_wait_for_returns_when_point_is_reached(robot: Robot, user: Client) -> None:
    gate = Gate()
    robot.legs.handles(STOP)(gate)
    with robot.running():
        stop = user.command(STOP)
        assert stop.wait_for(stop.handling.start, SOON) is Outcome.DONE
        with pytest.raises(
            Timeout, match=r"end achieving of stop \{1\} was not reached within 0.01 s"
        ):
            stop.result(0.01)
        assert (
            robot.central.facts.count(WaitEnded("user", 0, stop.id)) == 2
        )  # the second wait was given up
        gate.go_on.set()
        assert stop.wait_for(stop.handling.end, SOON) is Outcome.DONE
        with pytest.raises(MisuseError, match="point must be a point of a task"):
            stop.wait_for("end")  # type: ignore[arg-type]
        with pytest.raises(Refused, match=r"there is no task \{99\}"):
            stop.wait_for(Point(99, Moment.END_ACHIEVING))  # type: ignore[arg-type]


# --- Tasks that fail or are killed ----------------------------------------------------------------


HEIGHT = Query("height", int, reply=float)
FOG = Failure("fog", int)


def test_failure_carries_its_data_to_sender(robot: Robot, user: Client) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        raise COLLISION(Footfall(2, arc.radius), "rock")

    with robot.running():
        goal = user.goal(WALK, Arc(0.25, 1))
        with pytest.raises(TaskFailed, match=r"walk \{1\} failed: collision: rock") as failed:
            goal.result(SOON)
    assert (failed.value.failure, failed.value.text) == ("collision", "rock")
    assert failed.value.data_as(COLLISION) == Footfall(2, 0.25)
    assert goal.wait() is Outcome.FAILED


def test_failure_without_data_must_be_called_to_raise(robot: Robot, user: Client) -> None:
    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        raise EXHAUSTED  # type: ignore[misc]

    @robot.planner.handles(STOP)
    def stop(task: Task) -> None:
        raise EXHAUSTED()  # noqa: RSE102

    @robot.legs.handles(WALK)
    def walk(task: Task, _: Arc) -> None:
        task.command(STOP)

    with robot.running():
        with pytest.raises(TaskFailed, match="handler error: TypeError"):
            user.goal(REST).result(SOON)
        with pytest.raises(TaskFailed, match=r"failed: exhausted$") as failed:
            user.command(STOP).result(SOON)
        with pytest.raises(TaskFailed, match=r"failed: exhausted: in stop \{4\}$"):
            user.goal(WALK, Arc(1.0, 1)).result(SOON)
    assert failed.value.data_as(EXHAUSTED) is None
    assert failed.value.data is None


def test_unexpected_exception_fails_task_with_traceback(
    robot: Robot, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    @robot.planner.handles(WALK)
    def walk(task: Task, arc: Arc) -> None:
        if not arc.steps:
            raise SystemExit(3)
        _ = arc.steps / int(arc.radius)

    with robot.running():
        with pytest.raises(
            TaskFailed, match=r"handler error: ZeroDivisionError: division by zero$"
        ) as failed:
            user.goal(WALK, Arc(0, 1)).result(SOON)
        assert "in walk\n    _ = arc.steps / int(arc.radius)" in failed.value.text
        with pytest.raises(TaskFailed, match="handler error: SystemExit: 3"):
            user.goal(WALK, Arc(0, 0)).result(SOON)
        user.goal(WALK, Arc(1.0, 1)).result(SOON)
    assert "handler test_unexpected_exception" in caplog.text


def test_unencodable_error_text_is_escaped(robot: Robot, user: Client) -> None:
    """Python makes such texts from file names."""

    @robot.planner.handles(REST)
    def rest(_: Task) -> None:
        raise ValueError("no file \udcff")

    with robot.running():
        for _ in range(2):
            with pytest.raises(TaskFailed, match=r"handler error: ValueError: no file \\udcff"):
                user.goal(REST).result(SOON)


def test_wrong_result_fails_task(robot: Robot, user: Client) -> None:
    measure = Command("measure", result=float)
    robot.planner.handles(measure)(lambda _: "high")  # type: ignore[arg-type]
    robot.planner.handles(REST)(lambda _: 5)  # type: ignore[arg-type]
    with robot.running():
        with pytest.raises(
            TaskFailed, match="bad data: the handler of command 'measure' must return float"
        ) as failed:
            user.command(measure).result(SOON)
        assert failed.value.failure == "bad data"
        with pytest.raises(TaskFailed, match="the handler of goal 'rest' must return None"):
            user.goal(REST).result(SOON)


def test_handler_killed_with_its_subtask_has_not_failed(
    robot: Robot, user: Client, caplog: pytest.LogCaptureFixture
) -> None:
    started = threading.Event()

    @robot.planner.handles(REST)
    def rest(task: Task) -> None:
        stop = task.command(STOP)
        started.set()
        stop.result(SOON)

    with robot.running():
        goal = user.goal(REST)
        assert started.wait(SOON)
        goal.kill("enough")
        assert goal.wait(SOON) is Outcome.KILLED
        started.clear()
        goal = user.goal(REST)
        assert started.wait(SOON)
        user.tasks(STOP)[0].kill("it alone")
        with pytest.raises(
            TaskFailed, match=r"handler error: .*TaskKilled: stop \{4\} was killed: it alone"
        ):
            goal.result(SOON)
    assert [fact.id for fact in robot.central.facts if isinstance(fact, Failed)] == [3]
    assert caplog.text.count("handler test_handler_killed_with_its_subtask") == 1


def test_discarded_result_raises_bad_data(robot: Robot, user: Client) -> None:
    with robot.running():
        move = user.command(MOVE_LEG, 1)
        assert move.wait_for(move.achieving.end, SOON) is Outcome.DONE
        robot.central.core.memory.outcomes.clear()
        with pytest.raises(
            BadData, match=r"central no longer retains the result of move leg \{1\}"
        ):
            move.result()


def test_uncaught_failure_keeps_name_and_data(robot: Robot, user: Client) -> None:
    """A handler may let the failure of its query or subtask pass."""

    @robot.planner.handles(WALK)
    def walk(task: Task, _: Arc) -> None:
        task.command(STOP).result(SOON)

    @robot.legs.handles(STOP)
    def stop(task: Task) -> None:
        task.query(HEIGHT, 3)

    @robot.planner.handles(HEIGHT, resource="map")
    def height(_: Task, place: int) -> float:
        raise FOG(place, "thick")

    with robot.running():
        walking = user.goal(WALK, Arc(1.0, 1))
        with pytest.raises(TaskFailed, match=r"fog: .*query 'height' failed: thick") as failed:
            walking.result(SOON)
    assert failed.value.data == 3


# --- Retained tasks after their end ---------------------------------------------------------------


CROSS, PACE = Goal("cross the field"), Command("step", int, result=float)
FELL, DECIDE = Failure("fell", str), ExceptionHandler("decide", str)


@pytest.fixture
def walkers(central: LocalCentral) -> Iterator[Module]:
    walkers = Module("walkers", central)

    @walkers.handles(PACE)
    def step(_: Task, number: int) -> float:
        if number == 3:
            raise FELL("a hole", "step 3")
        return number / 2

    @walkers.handles(CROSS)
    def cross(task: Task) -> None:
        for number in range(1, 5):
            task.command(PACE, number, keep=True)

    with walkers.running():
        yield walkers


def test_retained_task_is_readable_by_other_client(
    central: LocalCentral, user: Client, walkers: Module
) -> None:
    step = user.command(PACE, 1, keep=True)
    assert step.result(SOON) == 0.5
    with connect("supervisor", central) as other:
        handle = other.task(step.id)
        assert handle is not None
        info = handle.info()
        assert info is not None
        assert (info.outcome, handle.data(PACE), PACE.decode_reply(info.result)) == ("done", 1, 0.5)
        assert other.tasks(PACE) == []
    step.release()
    assert step.info() is None
    assert user.task(step.id) is None


def test_exception_handler_sees_retained_tasks(
    central: LocalCentral, user: Client, walkers: Module
) -> None:
    expert, seen = Module("expert", central), list[tuple[int, str]]()

    @expert.handles(DECIDE)
    def decide(task: Task, why: str) -> None:
        attached = task.trouble.attached
        assert attached is not None
        for handle in attached.kept(PACE):
            info = handle.info()
            assert info is not None
            seen.append((handle.data(PACE), info.outcome))
        raise task.trouble.reissue()

    with expert.running():
        cross = user.goal(CROSS, on_failure=[Recovery(FELL, DECIDE)], keep=True)
        assert cross.wait(SOON) is Outcome.FAILED
    assert seen == [(1, "done"), (2, "done")]
    outcomes = {
        handle.data(PACE): info.outcome for handle in cross.kept() if (info := handle.info())
    }
    assert outcomes == {1: "done", 2: "done", 3: "failed", 4: "killed"}
    failed = next(handle for handle in cross.kept("step") if handle.data(PACE) == 3)
    assert str(failed.parent()) == str(cross)
    assert [str(handle) for handle in failed.ancestors()] == [str(cross)]
    with pytest.raises(TaskFailed, match="fell"):
        cross.result(0)
