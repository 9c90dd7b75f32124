"""Tasks that fail or are killed, and what is left of them when central is gone."""

import threading

import pytest
from module.gait_messages import COLLISION, EXHAUSTED, MOVE_LEG, REST, STOP, WALK, Arc, Footfall
from module.robot import Robot

from tca_module import BadData, Client, Command, Failure, Outcome, Query, Task, TaskFailed
from tca_wire.journal.facts import Failed

SOON = 5.0
HEIGHT = Query("height", int, reply=float)
FOG = Failure("fog", int)


def test_a_failure_goes_up_with_its_data(robot: Robot, user: Client) -> None:
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


def test_a_failure_without_data(robot: Robot, user: Client) -> None:
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
        with pytest.raises(TaskFailed, match=r"failed: exhausted: in (task 4 'stop'|stop \{4\})$"):
            user.goal(WALK, Arc(1.0, 1)).result(SOON)
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


def test_a_text_that_cannot_be_sent_does_not_end_a_thread(robot: Robot, user: Client) -> None:
    """As Python makes them of file names."""

    @robot.planner.handles(REST)
    def rest(_: Task) -> None:
        raise ValueError("no file \udcff")

    with robot.running():
        for _ in range(2):
            with pytest.raises(TaskFailed, match=r"handler error: ValueError: no file \\udcff"):
                user.goal(REST).result(SOON)


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


def test_a_handler_that_ends_because_what_it_waits_for_is_killed_with_it_has_not_failed(
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
        with pytest.raises(TaskFailed, match=r"handler error: .*TaskKilled: stop \{4\} was killed: it alone"):
            goal.result(SOON)
    assert [fact.id for fact in robot.central.facts if isinstance(fact, Failed)] == [3]
    assert caplog.text.count("handler test_a_handler_that_ends") == 1


def test_a_result_that_central_no_longer_keeps(robot: Robot, user: Client) -> None:
    with robot.running():
        move = user.command(MOVE_LEG, 1)
        assert move.wait_for(move.achieving.end, SOON) is Outcome.DONE
        robot.central.core.outcomes.clear()
        with pytest.raises(BadData, match=r"the result of move leg \{1\} is no longer kept"):
            move.result()


def test_what_failed_elsewhere_keeps_its_name_and_data(robot: Robot, user: Client) -> None:
    """A handler that does not catch what its question, or its subtask, failed with."""

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
        with pytest.raises(TaskFailed, match=r"fog: .*query 'height' failed: fog: thick") as failed:
            walking.result(SOON)
    assert failed.value.data == 3
