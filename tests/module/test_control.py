"""Exception handlers, wiretaps, monitors, suspension and time, as modules use them."""

import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from module.real_central import SOON, RealCentral, until

from tca_module import (
    Client,
    Command,
    Condition,
    DemonMonitor,
    ExceptionHandler,
    Failure,
    Goal,
    Inform,
    MisuseError,
    Module,
    Outcome,
    PointMonitor,
    PollingMonitor,
    Query,
    Recovery,
    Refused,
    Task,
    TaskFailed,
    TaskRef,
    Timeout,
    connect,
    this,
)
from tca_module.testing import LocalCentral
from tca_wire.journal.facts import MonitorEnded, MonitorTested

MOVE, REST = Command("move", float, result=float), Command("rest")
WALK = Goal("walk", float)
COLLISION = Failure("collision", float)
ROCK = Failure("rock", float, kind_of=COLLISION)
IS_FREE: Query[None, None] = Query("is the way free", reply=None)
AT_ONCE = PointMonitor("look ahead", condition=IS_FREE)
HIGHER, SHRUG = ExceptionHandler("higher", float), ExceptionHandler("shrug")


class Robot:
    """Legs that hit a rock below a height of 0.3, and an expert. Both log their actions."""

    def __init__(self, central: LocalCentral) -> None:
        self.log: list[str] = []
        self.held, self.go_on, self.shrugged = (threading.Semaphore(0) for _ in range(3))
        self.legs, self.expert = Module("legs", central=central), Module("expert", central=central)
        self.legs.handles(MOVE)(self.move)
        self.legs.handles(REST)(self.rest)
        self.expert.handles(HIGHER)(self.higher)
        self.expert.handles(SHRUG)(self.shrug)

    def move(self, _: Task, height: float) -> float:
        self.log.append(f"move {height}")
        if height < 0.3:
            raise ROCK(0.3, "hit it")
        return height

    def rest(self, task: Task) -> None:
        self.held.release()
        self.go_on.acquire(timeout=10)
        if task.suspended:
            self.log.append("suspended")
        else:
            self.log.append("cancelled" if task.cancelled else "rested")

    def higher(self, task: Task, rock: float) -> None:
        trouble = task.trouble
        self.log.append(
            f"{trouble.failure} at {rock}, attempt {trouble.attempts}, {trouble.failing.message}"
        )
        if trouble.attempts > 1:
            raise trouble.reissue()
        trouble.failing.retry(MOVE, trouble.failing.data(MOVE) + 0.05)

    def shrug(self, task: Task) -> None:
        self.log.append("shrug")
        task.trouble.resolved()
        self.shrugged.release()


@pytest.fixture
def robot(central: LocalCentral) -> Iterator[Robot]:
    robot = Robot(central)
    with robot.legs.running(), robot.expert.running():
        yield robot


def test_failure_is_retried_with_new_data_then_reissued(robot: Robot, user: Client) -> None:
    user.on_failure(None, SHRUG)
    user.on_failure(COLLISION, HIGHER, of=MOVE)
    assert user.command(MOVE, 0.28).result(timeout=5) == pytest.approx(0.33)
    task = user.command(MOVE, 0.1)
    assert task.wait(timeout=5) is Outcome.RESOLVED
    with pytest.raises(TaskFailed, match="was resolved"):
        task.result()
    attempts = [
        "move 0.1",
        "rock at 0.3, attempt 1, move",
        f"move {0.1 + 0.05}",
        "rock at 0.3, attempt 2, move",
    ]
    assert robot.log[-5:] == [*attempts, "shrug"]


def test_exception_handlers_are_sent_with_task_and_removed(robot: Robot, user: Client) -> None:
    assert (
        user.command(MOVE, 0.1, on_failure=[Recovery(ROCK, SHRUG)]).wait(timeout=5)
        is Outcome.RESOLVED
    )
    ladder = [Recovery(None, SHRUG), Recovery(ROCK, HIGHER, maximum=1)]
    assert user.command(MOVE, 0.1, on_failure=ladder).wait(timeout=5) is Outcome.RESOLVED
    attempts = ["move 0.1", "rock at 0.3, attempt 1, move", f"move {0.1 + 0.05}", "shrug"]
    assert robot.log[-4:] == attempts
    user.on_failure(ROCK, SHRUG, of=MOVE).remove()
    assert user.command(MOVE, 0.1).wait(timeout=5) is Outcome.FAILED
    assert robot.log == ["move 0.1", "shrug", *attempts, "move 0.1"]


def test_running_task_sees_suspension_and_queued_task_waits(robot: Robot, user: Client) -> None:
    resting = user.command(REST)
    moving = user.command(MOVE, 0.5)
    robot.held.acquire(timeout=5)
    resting.suspend()
    moving.suspend()
    robot.go_on.release()
    resting.wait(timeout=5)
    info = moving.info()
    assert info is not None
    assert info.suspended
    moving.resume()
    assert moving.result(timeout=5) == 0.5
    assert robot.log == ["suspended", "move 0.5"]


def test_deadline_delay_and_delayed_kill_take_effect(robot: Robot, user: Client) -> None:
    late = user.command(REST, deadline=0.02, on_failure=[Recovery(None, SHRUG)])
    assert robot.shrugged.acquire(timeout=5)
    robot.go_on.release()
    assert late.wait(timeout=5) is Outcome.RESOLVED
    moved = user.command(MOVE, 0.5)
    delayed = user.command(
        MOVE,
        0.6,
        sequential=False,
        constraints=[moved.achieving.end + 0.05 <= this.achieving.start],
    )
    assert delayed.result(timeout=5) == 0.6
    doomed = user.command(REST, delay=100.0)
    doomed.kill(delay=0.02)
    assert doomed.wait(timeout=5) is Outcome.KILLED


def test_termination_message_runs_after_kill(robot: Robot, user: Client) -> None:
    resting = user.command(REST)
    robot.held.acquire(timeout=5)
    resting.on_termination(MOVE, 0.9)
    resting.kill()
    robot.go_on.release()
    assert resting.wait(timeout=5) is Outcome.KILLED
    assert robot.log == ["cancelled", "move 0.9"]


def test_wiretap_reports_messages_until_removed(robot: Robot, user: Client) -> None:
    note = Command("note", float)
    watcher = Module("watcher", central=robot.legs.central)

    @watcher.handles(note)
    def listen(task: Task, height: float) -> None:
        event = task.tap_event
        robot.log.append(f"{event.condition} {event.message} {height}")

    with watcher.running():
        tap = watcher.tap(Condition.BEFORE_HANDLING, MOVE, note)
        user.command(MOVE, 0.5).result(timeout=5)
        tap.remove()
        user.command(MOVE, 0.6).result(timeout=5)
        with pytest.raises(Refused, match="never happens"):
            watcher.tap(Condition.AFTER_PLANNED, MOVE, note)
    assert robot.log == ["before handling move 0.5", "move 0.5", "move 0.6"]


def test_each_monitor_kind_sends_its_action(robot: Robot, user: Client) -> None:
    acted = threading.Semaphore(0)
    seen: Query[None, float | None] = Query("seen", reply=float | None)
    act, look = Command("act", float), Command("look")
    values: list[float | None] = [None, 1.0, None, 2.0]
    eye = Module("eye", central=robot.legs.central)

    @eye.handles(seen)
    def see(_: Task) -> float | None:
        return values.pop(0) if values else None

    @eye.handles(act)
    def on_act(_: Task, value: float) -> None:
        robot.log.append(f"act {value}")
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
            user.monitor(PointMonitor("check2", condition=seen), perod=1)  # type: ignore[call-overload]
    assert robot.log == ["act 1.0", "act 2.0", "act 5.0", "act 7.0"]


def test_late_wiretap_fires_once_for_past_events(
    central: LocalCentral, user: Client, legs: Module
) -> None:
    notice = Inform("told")
    tapped: list[TaskRef | None] = []
    legs.handles(MOVE)(lambda _, height: height)
    legs.handles(notice)(lambda task: tapped.append(task.tap_event.tapped))
    with legs.running():
        moves = [user.command(MOVE, 1.0, keep=bool(number % 3)) for number in range(20)]
        for number, move in enumerate(moves):
            if number % 2:
                move.wait(SOON)
            user.tap(Condition.AFTER_ACHIEVED, move, notice, at_once=True)
        for condition in (Condition.WHEN_SENT, Condition.AFTER_HANDLED):
            user.tap(condition, moves[0], notice, at_once=True)
        user.command(MOVE, 1.0).wait(SOON)  # behind all messages to the legs
        assert sorted(one.id for one in tapped if one) == sorted(
            [one.id for one in moves] + [moves[0].id] * 2
        )
        with pytest.raises(Refused, match="its data was not kept: send the task with keep=True"):
            user.tap(Condition.AFTER_ACHIEVED, moves[0], Inform("its height", float), at_once=True)


def test_wiretap_starts_monitors(robot: Robot, user: Client) -> None:
    asked = threading.Semaphore(0)
    eye = Module("eye", central=robot.legs.central)

    @eye.handles(IS_FREE)
    def is_free(_: Task) -> None:
        robot.log.append("look")
        asked.release()

    watch = PollingMonitor("watch", condition=IS_FREE)
    with eye.running():
        before = user.tap(Condition.BEFORE_HANDLING, MOVE, AT_ONCE)
        user.command(MOVE, 0.5).result(timeout=5)
        before.remove()
        assert robot.log == ["look", "move 0.5"]
        user.tap(Condition.WHILE_HANDLING, REST, watch, period=0.01)
        resting = user.command(REST)
        for _ in range(3):
            assert asked.acquire(timeout=5)
        (watching,) = user.tasks(watch)
        robot.go_on.release()
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


def test_task_reports_its_relatives(robot: Robot, user: Client) -> None:
    central = robot.legs.central
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
        with pytest.raises(
            Timeout, match=r"end achieving of move \{\d+\} was not reached within 0 s"
        ):
            waiting.wait(0)
        assert waiting.wait_for(walk.handling.end, timeout=5) is Outcome.DONE
        walk.kill()
        assert waiting.wait(timeout=5) is Outcome.KILLED
        assert waiting.info() is None


def test_point_monitor_is_ordered_like_task_in_blocks(robot: Robot, user: Client) -> None:
    """In a parallel block a monitor waits for no sibling. In a sequence the successor waits for the
    monitor.
    """
    central = robot.legs.central
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
        assert asked.acquire(timeout=5), "the monitor must not wait for its sibling"
        assert robot.held.acquire(timeout=5)
        robot.go_on.release()
        assert "move 0.5" not in robot.log
        go_on.set()
        walking.result(5)
    assert robot.log == ["rested", "move 0.5"]


# --- Demon monitors, and the data of a monitor's parts --------------------------------------------


GO, WATCH, FETCH, OTHER = Goal("go"), Command("watch"), Command("fetch", str), Command("other", int)
IS_DARK, SAY, STOP = Query("is it dark", reply=bool), Inform("say", str), Command("stop")
CUPS = DemonMonitor("cups", set_up=WATCH, action=FETCH)
BUMPS = DemonMonitor("bumps", set_up=WATCH)
NUDGES = DemonMonitor("nudges")


def test_monitor_fires_only_its_declared_action(legs: Module, eyes: Module, user: Client) -> None:
    fetched, errors = list[str](), queue.Queue[str]()
    legs.handles(FETCH)(lambda _, cup: fetched.append(cup))

    @eyes.handles(WATCH)
    def watch(task: Task) -> None:
        with pytest.raises(MisuseError) as wrong:
            task.monitor_ref.fire(OTHER, 7)
        errors.put(str(wrong.value))

    with legs.running(), eyes.running():
        cups = user.monitor(CUPS, maximum=1)
        for_handlers = errors.get(timeout=SOON)
        assert "can't be fired with command 'other': its action is 'fetch'" in for_handlers
        with pytest.raises(
            MisuseError, match="can't be fired with command 'other': its action is 'fetch'"
        ):
            cups.fire(OTHER, 7)
        with pytest.raises(MisuseError, match="can't be fired with None: its action is 'fetch'"):
            cups.fire()
        assert cups.fire(FETCH, "blue")
        assert cups.wait(SOON) is Outcome.DONE
    assert fetched == ["blue"]


def test_handler_fires_monitors_by_task_or_name(legs: Module, eyes: Module, user: Client) -> None:
    asked, fired = queue.Queue[str](), list[bool]()
    watch = PollingMonitor("watch the dark", condition=IS_DARK)

    @eyes.handles(IS_DARK)
    def is_dark(_: Task) -> bool:
        asked.put("asked")
        return False

    @legs.handles(STOP)
    def stop(task: Task) -> None:
        (one, _) = task.tasks(watch)
        fired.extend([task.fire(watch), task.fire(one), task.fire(NUDGES)])

    with legs.running(), eyes.running():
        both = [user.monitor(watch, period=1e6, initial_wait=True) for _ in range(2)]
        assert user.command(STOP).wait(SOON) is Outcome.DONE
        assert both[0].fire()
        assert [asked.get(timeout=SOON) for _ in range(4)] == ["asked"] * 4
        assert both[0].end()
        with pytest.raises(MisuseError, match="fire"):
            both[1].fire(SAY, "it is dark")
        with pytest.raises(Refused, match="tests its condition"):
            user.fire(user.tasks(watch)[0], SAY, "it is dark")
    assert fired == [True, True, False]


def test_monitor_without_action_is_fired_without_message(
    eyes: Module, central: LocalCentral, user: Client
) -> None:
    eyes.handles(WATCH)(lambda _: None)
    with eyes.running():
        bumps = user.monitor(BUMPS, maximum=2)
        with pytest.raises(MisuseError, match=r"it needs none, fire\(\) it without a message"):
            bumps.fire(FETCH, "blue")
        assert [bumps.fire() for _ in range(3)] == [True, True, False]
    assert [fact.why for fact in central.facts if isinstance(fact, MonitorEnded)] == [
        "it has sent 2 actions"
    ]


def test_unstarted_monitor_is_not_fired(user: Client) -> None:
    going = user.goal(GO)
    nudges = user.monitor(NUDGES, constraints=[going.handling.start <= this.handling.start])
    assert not nudges.fire()
    assert nudges.info() is not None


def test_monitor_parts_without_data_type_get_no_data(legs: Module, user: Client) -> None:
    """A part declared without data does not get the monitor's data."""
    done: queue.SimpleQueue[str] = queue.SimpleQueue()
    begin, end = Command("begin"), Command("end")

    @legs.handles(begin)
    def on_begin(task: Task) -> None:
        done.put("begin")
        task.monitor_ref.fire(SAY, "cup")
        task.monitor_ref.end()

    @legs.handles(IS_DARK)
    def is_dark(_: Task) -> bool:
        done.put("dark")
        return True

    legs.handles(STOP)(lambda _: done.put("stop"))
    legs.handles(end)(lambda _: done.put("end"))
    legs.handles(SAY)(lambda _, text: done.put(text))
    with legs.running():
        watch: PointMonitor[str] = PointMonitor("watch", str, condition=IS_DARK, action=STOP)
        assert user.monitor(watch, "the cup").wait(SOON) is Outcome.DONE
        assert [done.get(timeout=SOON) for _ in range(2)] == ["dark", "stop"]
        guard: DemonMonitor[str] = DemonMonitor("guard", str, set_up=begin, action=SAY, cancel=end)
        assert user.monitor(guard, "the cup").wait(SOON) is Outcome.DONE
        assert [done.get(timeout=SOON) for _ in range(3)] == ["begin", "cup", "end"]


def test_catch_all_exception_handler_gets_none_without_data(legs: Module, user: Client) -> None:
    caught: queue.SimpleQueue[Any] = queue.SimpleQueue()
    ease: ExceptionHandler[float | None] = ExceptionHandler("ease", float | None)
    legs.handles(ease)(lambda task, force: caught.put((task.trouble.failure, force)))
    with legs.running():
        user.on_failure(None, ease)
        user.command(STOP, deadline=0.01)
        assert caught.get(timeout=SOON) == ("timeout", None)


# --- The module that answers a monitor's condition dies, or leaves --------------------------------


pytestmark = pytest.mark.usefixtures("short_timeouts")

BATTERY = Query("battery", reply=bool)
WATCH_BATTERY = PollingMonitor("watch", condition=BATTERY, action=Command("charge"))


def test_monitor_waits_for_condition_handler_and_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    blind = "sees nothing until a module handles its condition 'battery'"
    with RealCentral("tcp://127.0.0.1:*") as central, connect("user", central.address) as user:

        def gauge() -> Module:
            gauge = Module("gauge", central.address)
            gauge.handles(BATTERY)(lambda _: False)
            return gauge

        def tests() -> int:
            return len(central.facts(MonitorTested))

        with gauge().running():
            monitor = user.monitor(WATCH_BATTERY, period=0.05)
            until(tests, "the monitor has tested its condition")
            assert "sees nothing" not in caplog.text
        until(lambda: f"watch {{{monitor.id}}} {blind}" in caplog.text, "the log has the warning")
        assert caplog.text.count("sees nothing") == 1
        before = tests()
        with gauge().running():
            until(lambda: tests() > before, "the monitor tests again")
        assert monitor.end()
