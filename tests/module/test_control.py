"""Exception handlers, wiretaps, monitors, suspension and time, as modules use them."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tca_module import (
    Client,
    Command,
    Condition,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    MisuseError,
    Module,
    Outcome,
    PointMonitor,
    PollingMonitor,
    Query,
    Refused,
    Task,
    TaskFailed,
    Timeout,
    connect,
    this,
)
from tca_module.testing import LocalCentral

MOVE, REST = Command("move", float, result=float), Command("rest")
WALK = Goal("walk", float)
COLLISION = Failure("collision", float)
ROCK = Failure("rock", float, kind_of=COLLISION)
IS_FREE: Query[None, None] = Query("is the way free", reply=None)
AT_ONCE = PointMonitor("look ahead", condition=IS_FREE)
HIGHER, SHRUG = ExceptionHandler("higher", float), ExceptionHandler("shrug")


class Robot:
    """Legs that hit a rock below 0.3, and an expert; both write down what they do."""

    def __init__(self, central: LocalCentral) -> None:
        self.said: list[str] = []
        self.held, self.go_on, self.shrugged = (threading.Semaphore(0) for _ in range(3))
        self.legs, self.expert = Module("legs", central=central), Module("expert", central=central)
        self.legs.handles(MOVE)(self.move)
        self.legs.handles(REST)(self.rest)
        self.expert.handles(HIGHER)(self.higher)
        self.expert.handles(SHRUG)(self.shrug)

    def move(self, _: Task, height: float) -> float:
        self.said.append(f"move {height}")
        if height < 0.3:
            raise ROCK(0.3, "hit it")
        return height

    def rest(self, task: Task) -> None:
        self.held.release()
        self.go_on.acquire(timeout=10)
        self.said.append("suspended" if task.suspended else "cancelled" if task.cancelled else "rested")

    def higher(self, task: Task, rock: float) -> None:
        trouble = task.trouble
        self.said.append(f"{trouble.failure} at {rock}, attempt {trouble.attempts}, {trouble.failing.message}")
        if trouble.attempts > 1:
            raise trouble.reissue()
        trouble.failing.retry(MOVE, trouble.failing.data(MOVE) + 0.05)

    def shrug(self, _: Task) -> None:
        self.said.append("shrug")
        self.shrugged.release()


@pytest.fixture
def robot() -> Iterator[tuple[Robot, Client]]:
    with LocalCentral(check=True) as central:
        robot = Robot(central)
        with robot.legs.running(), robot.expert.running(), connect("user", central) as user:
            yield robot, user


def test_a_failure_is_retried_with_new_data_and_reissued_above(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    user.on_failure(None, SHRUG)
    user.on_failure(COLLISION, HIGHER, of=MOVE)
    assert user.command(MOVE, 0.28).result(timeout=5) == pytest.approx(0.33)
    task = user.command(MOVE, 0.1)
    assert task.wait(timeout=5) is Outcome.DONE
    with pytest.raises(TaskFailed, match="an exception handler dealt with it"):
        task.result()
    attempts = ["move 0.1", "rock at 0.3, attempt 1, move", f"move {0.1 + 0.05}", "rock at 0.3, attempt 2, move"]
    assert them.said[-5:] == [*attempts, "shrug"]


def test_exception_handlers_travel_with_the_task_and_can_be_removed(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    assert user.command(MOVE, 0.1, on_failure=[(ROCK, SHRUG)]).wait(timeout=5) is Outcome.DONE
    user.on_failure(ROCK, SHRUG, of=MOVE).remove()
    assert user.command(MOVE, 0.1).wait(timeout=5) is Outcome.FAILED
    assert them.said == ["move 0.1", "shrug", "move 0.1"]


def test_a_running_task_is_suspended_and_goes_on_and_what_follows_waits(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    resting = user.command(REST)
    moving = user.command(MOVE, 0.5)
    them.held.acquire(timeout=5)
    resting.suspend()
    moving.suspend()
    them.go_on.release()
    resting.wait(timeout=5)
    info = moving.info()
    assert info is not None
    assert info.suspended
    moving.resume()
    assert moving.result(timeout=5) == 0.5
    assert them.said == ["suspended", "move 0.5"]


def test_deadlines_delays_and_kills_that_wait(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    late = user.command(REST, deadline=0.02, on_failure=[(None, SHRUG)])
    assert them.shrugged.acquire(timeout=5)
    them.go_on.release()
    assert late.wait(timeout=5) is Outcome.DONE
    moved = user.command(MOVE, 0.5)
    delayed = user.command(
        MOVE, 0.6, sequential=False, constraints=[moved.achieving.end + 0.05 <= this.achieving.start]
    )
    assert delayed.result(timeout=5) == 0.6
    doomed = user.command(REST, delay=100.0)
    doomed.kill(delay=0.02)
    assert doomed.wait(timeout=5) is Outcome.KILLED


def test_what_is_to_be_done_on_termination(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    resting = user.command(REST)
    them.held.acquire(timeout=5)
    resting.on_termination(MOVE, 0.9)
    resting.kill()
    them.go_on.release()
    assert resting.wait(timeout=5) is Outcome.KILLED
    assert them.said == ["cancelled", "move 0.9"]


def test_a_wiretap_hears_what_others_send_and_is_removed(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    note = Command("note", float)
    watcher = Module("watcher", central=them.legs.central)

    @watcher.handles(note)
    def listen(task: Task, height: float) -> None:
        heard = task.tap_event
        them.said.append(f"{heard.condition} {heard.message} {height}")

    with watcher.running():
        tap = watcher.tap(Condition.BEFORE_HANDLING, MOVE, note)
        user.command(MOVE, 0.5).result(timeout=5)
        tap.remove()
        user.command(MOVE, 0.6).result(timeout=5)
        with pytest.raises(Refused, match="never happens"):
            watcher.tap(Condition.AFTER_PLANNED, MOVE, note)
    assert them.said == ["before handling move 0.5", "move 0.5", "move 0.6"]


def test_monitors_of_all_kinds(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    acted = threading.Semaphore(0)
    seen: Query[None, float | None] = Query("seen", reply=float | None)
    act, look = Command("act", float), Command("look")
    values: list[float | None] = [None, 1.0, None, 2.0]
    eye = Module("eye", central=them.legs.central)

    @eye.handles(seen)
    def see(_: Task) -> float | None:
        return values.pop(0) if values else None

    @eye.handles(act)
    def on_act(_: Task, value: float) -> None:
        them.said.append(f"act {value}")
        acted.release()

    @eye.handles(look)
    def on_look(task: Task) -> None:
        task.monitor_ref.fire(act, 7.0)
        task.monitor_ref.end()

    with eye.running():
        user.monitor(PollingMonitor("watch", condition=seen, action=act), period=0.01, maximum=2)
        acted.acquire(timeout=5)
        acted.acquire(timeout=5)
        values[:] = [5.0]
        user.monitor(PointMonitor("check", condition=seen, action=act))
        acted.acquire(timeout=5)
        user.monitor(DemonMonitor("guard", set_up=look, action=act))
        acted.acquire(timeout=5)
        with pytest.raises(MisuseError, match="the options are"):
            user.monitor(PointMonitor("check2", condition=seen), perod=1)  # type: ignore[call-arg]
    assert them.said == ["act 1.0", "act 2.0", "act 5.0", "act 7.0"]


def test_monitors_listen_to_wiretaps(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    asked = threading.Semaphore(0)
    eye = Module("eye", central=them.legs.central)

    @eye.handles(IS_FREE)
    def look(_: Task) -> None:
        them.said.append("look")
        asked.release()

    watch = PollingMonitor("watch", condition=IS_FREE)
    with eye.running():
        before = user.tap(Condition.BEFORE_HANDLING, MOVE, AT_ONCE)
        user.command(MOVE, 0.5).result(timeout=5)
        before.remove()
        assert them.said == ["look", "move 0.5"]
        user.tap(Condition.WHILE_HANDLING, REST, watch, period=0.01)
        resting = user.command(REST)
        for _ in range(3):
            assert asked.acquire(timeout=5)
        (watching,) = user.tasks(watch)
        them.go_on.release()
        resting.result(timeout=5)
        user.command(MOVE, 0.6).result(timeout=5)
        assert watching.info() is None
        with pytest.raises(Refused, match="would never end"):
            user.tap(Condition.AFTER_ACHIEVED, MOVE, watch, period=1.0)
        with pytest.raises(MisuseError, match="period is for monitors"):
            user.tap(Condition.AFTER_ACHIEVED, MOVE, REST, period=1.0)
        with pytest.raises(MisuseError, match="the options are"):
            user.tap(Condition.WHILE_HANDLING, REST, watch, sequential=False)  # type: ignore[call-arg]


@contextmanager
def walking(central: LocalCentral) -> Iterator[None]:
    planner = Module("planner", central=central)

    @planner.handles(WALK)
    def walk(task: Task, height: float) -> None:
        task.command(MOVE, height).wait(timeout=5)
        task.command(MOVE, height, delay=100.0)

    with planner.running():
        yield


def test_relatives_of_a_task(robot: tuple[Robot, Client]) -> None:
    them, user = robot
    central = them.legs.central
    assert isinstance(central, LocalCentral)
    with walking(central):
        walk = user.goal(WALK, 0.5)
        walk.wait_for(walk.handling.end, timeout=5)
        (waiting,) = walk.descendants(MOVE)
        assert waiting.data(MOVE) == 0.5
        parent = waiting.parent()
        assert parent is not None
        assert (parent.id, parent.message) == (walk.id, "walk")
        assert [one.id for one in waiting.ancestors()] == [walk.id]
        assert walk.parent() is None
        with pytest.raises(Timeout, match=r"end achieving task \d+ \('move'\) was not reached within 0 s"):
            waiting.wait(0)
        assert waiting.wait_for(walk.handling.end, timeout=5) is Outcome.DONE
        walk.kill()
        assert waiting.wait(timeout=5) is Outcome.KILLED
        assert waiting.info() is None


def test_point_monitors_stand_in_blocks_like_tasks(robot: tuple[Robot, Client]) -> None:
    """In parallel they wait for nothing; in a sequence what follows waits for them."""
    them, user = robot
    central = them.legs.central
    planner = Module("planner", central=central)
    asked = threading.Semaphore(0)
    go_on = threading.Event()

    @planner.handles(WALK)
    def walk(task: Task, height: float) -> None:
        with task.parallel():
            task.command(REST)
            task.monitor(AT_ONCE)
        task.command(MOVE, height)

    @planner.handles(IS_FREE, resource="eyes")
    def is_free(_: Task) -> None:
        asked.release()
        assert go_on.wait(5)

    with planner.running():
        walking = user.goal(WALK, 0.5)
        assert asked.acquire(timeout=5), "the monitor waits for its sibling"
        assert them.held.acquire(timeout=5)
        them.go_on.release()
        assert "move 0.5" not in them.said
        go_on.set()
        walking.result(5)
    assert them.said == ["rested", "move 0.5"]
