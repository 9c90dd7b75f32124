"""Small worlds, each with one wait that is known: what central says that a task waits for, now and in the end."""

import pytest
from central.player import Player, before, point

from tca_central.needs.graph import Waiting
from tca_central.needs.waits import Ends, next_of, waits_of
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import ROOT, Moment, Point, TaskId
from tca_wire.vocabulary import Condition, MessageClass
from tca_wire.waits import WaitFor, WaitKind

END = Moment.END_ACHIEVING


@pytest.fixture
def robot() -> Player:
    robot = Player.of("planner: goal walk", "legs: command step, query where", "user")
    robot.declare("user", "goal walk", "command step", "command dance", "query where")
    return robot


def waits(robot: Player, task: int) -> list[WaitFor]:
    return waits_of(robot.central, next_of(robot.central.tree.tasks[task]))


def end(robot: Player, task: int) -> WaitFor | None:
    return Ends(robot.central, 1000).end_of(next_of(robot.central.tree.tasks[task]))


def step_of(number: int) -> WaitFor:
    """That the handler of a step runs."""
    return WaitFor(WaitKind.RUNNING, number, "step", module="legs", resource="legs")


def test_a_queue_a_constraint_a_parent_and_a_child(robot: Player) -> None:
    walk = robot.task("user", "walk")
    first, second = (robot.task("planner/1", "step", under=walk) for _ in range(2))
    other = robot.task("user", "step", flags=Flags.NONE)
    assert waits(robot, walk) == [WaitFor(WaitKind.RUNNING, module="planner", resource="planner")]
    robot.reply("planner/1", walk)
    assert waits(robot, second) == [WaitFor(WaitKind.CONSTRAINT, first, "step", END)]
    assert waits(robot, walk) == [WaitFor(WaitKind.SUBTASK, one, "step", END) for one in (first, second)]
    keeper = WaitFor(WaitKind.RUNNING, first, "step")
    assert waits(robot, other) == [WaitFor(WaitKind.RESOURCE, module="legs", resource="legs", because=(keeper,))]
    assert {end(robot, one) for one in (walk, first, second, other)} == {step_of(first)}


def test_what_is_planned_ahead_waits_for_its_parent(robot: Player) -> None:
    before_it = robot.task("user", "step")
    walk = robot.task("user", "walk")
    step = robot.task("planner/1", "step", under=walk)
    assert waits(robot, step) == [WaitFor(WaitKind.PARENT, walk, "walk", Moment.START_ACHIEVING)]
    assert end(robot, step) == step_of(before_it)


def test_many_subtasks_are_counted(robot: Player) -> None:
    walk = robot.task("user", "walk")
    steps = [robot.task("planner/1", "step", under=walk, flags=Flags.NONE) for _ in range(10)]
    robot.reply("planner/1", walk)
    told = [WaitFor(WaitKind.SUBTASK, one, "step", END) for one in steps[:3]]
    assert waits(robot, walk)[:2] == told[:2]
    assert sum(1 + one.more for one in waits(robot, walk)) == 10


def test_a_delay_and_a_suspension(robot: Player) -> None:
    wait = before(Point(ROOT, Moment.START_ACHIEVING), point(-1, Moment.START_ACHIEVING), 5.0)
    step = robot.task("user", "step", constraints=(wait,))
    assert waits(robot, step) == [WaitFor(WaitKind.DELAY, seconds=robot.time + 5.0)]
    assert end(robot, step) == waits(robot, step)[0]
    walk = robot.task("user", "walk", flags=Flags.NONE)
    under = robot.task("planner/1", "dance", under=walk)
    robot.receive("user", headers.Suspend(robot.number("user"), TaskId(walk)))
    since = robot.central.clock.now
    robot.tick(3.0)
    assert WaitFor(WaitKind.RESUME, walk, "walk", module="user", seconds=since) in waits(robot, under)


def test_a_message_that_nobody_handles(robot: Player) -> None:
    dance = robot.task("user", "dance")
    after = robot.task("user", "step")
    assert waits(robot, dance) == [WaitFor(WaitKind.HANDLER, name="dance")]
    assert waits(robot, after) == [WaitFor(WaitKind.CONSTRAINT, dance, "dance", END)]
    assert end(robot, after) == WaitFor(WaitKind.HANDLER, name="dance")


def test_a_handler_that_blocks(robot: Player) -> None:
    walk = robot.task("user", "walk")
    robot.task("user", "step", flags=Flags.NONE)
    robot.declare("planner/1", "query where")
    robot.send("planner/1", "where", origin=walk, blocking=True)
    (running,) = waits(robot, walk)
    (reply,) = running.because
    assert (running.kind, reply.kind, reply.name) == (WaitKind.RUNNING, WaitKind.REPLY, "where")
    (asked,) = waits_of(robot.central, Waiting(*next(iter(blocked(robot)))))
    busy = WaitFor(WaitKind.RUNNING, 2, "step")
    assert asked.because == (WaitFor(WaitKind.RESOURCE, module="legs", resource="legs", because=(busy,)),)
    assert end(robot, walk) == step_of(2)


def blocked(robot: Player) -> list[tuple]:  # type: ignore[type-arg]
    return [(one, number) for one in robot.central.blocked for number in one.waits]


def test_a_lock_for_a_handler(robot: Player) -> None:
    walk = robot.task("user", "walk")
    robot.receive("planner/1", headers.Lock(robot.number("planner/1"), "legs", origin=walk))
    step = robot.task("user", "step", flags=Flags.NONE)
    holder = WaitFor(WaitKind.RUNNING, walk, "walk")
    locked = WaitFor(WaitKind.LOCKED, name="lock", module="planner", because=(holder,))
    assert waits(robot, step) == [WaitFor(WaitKind.RESOURCE, module="legs", resource="legs", because=(locked,))]
    found = end(robot, step)
    assert found is not None
    assert (found.kind, found.name) == (WaitKind.RUNNING, "walk")


def test_an_exception_handler_decides(robot: Player) -> None:
    robot.module("expert", "exception handler mend")
    walk = robot.task("user", "walk")
    attached = Attachment("fell", "mend")
    robot.receive("user", headers.Attach(robot.number("user"), attached, TaskId(walk)))
    robot.fail("planner/1", "fell", walk)
    (mend,) = [task for task in robot.central.tree.tasks.values() if task.message.name == "mend"]
    assert waits(robot, walk)[0] == WaitFor(WaitKind.RECOVERY, mend.id, "mend", END)


def test_a_listener_holds(robot: Player) -> None:
    robot.module("guard", "command check")
    condition, listener = Condition.BEFORE_HANDLING, "check"
    robot.receive("guard", headers.Tap(robot.number("guard"), condition, listener, "step"))
    step = robot.task("user", "step")
    (check,) = [task for task in robot.central.tree.tasks.values() if task.message.name == "check"]
    (wait,) = waits(robot, step)
    assert (wait.kind, wait.number, wait.module) == (WaitKind.LISTENER, check.id, "guard")
    assert check.message.message_class is MessageClass.COMMAND
