"""Suspension where it meets kills."""

from central.player import Player

from tca_wire.packets import headers
from tca_wire.points import TaskId


def test_what_is_to_be_done_on_termination_is_done_also_under_what_was_killed_before_it_was_suspended() -> None:
    robot = Player()
    robot.module("planner", "goal walk", capacity=2)
    robot.module("legs", "command stop")
    robot.module("user")
    busy = robot.task("user", "stop", flags=0)
    above = robot.task("user", "walk", flags=0)
    below = robot.task("planner/1", "walk", under=above)
    robot.send("planner/2", "stop", under=below, when_killed=True)
    for header, task in ((headers.Kill, below), (headers.Suspend, above), (headers.Kill, above)):
        robot.receive("user", header(robot.number("user"), TaskId(task)))
    robot.reply("legs/1", busy)
    assert not any(task.suspended for task in robot.central.tree.tasks.values())
    assert robot.delivered("legs/1")  # it stops
