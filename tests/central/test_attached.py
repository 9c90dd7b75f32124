"""What central tells of what is attached: monitors wherever in the tree they are, and how many there are."""

from typing import Any

import pytest
from central.transcript import Transcript

from tca_central.status import topics as status
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import WatchOptions
from tca_wire.points import TaskId


def told(robot: Transcript) -> list[int]:
    return [one["id"] for one in status.attached(robot.player.central)["monitors"]]


@pytest.fixture
def robot() -> Transcript:
    """A user who can send monitors of a sensor."""
    robot = Transcript()
    robot.player.module("eye", "query hot?", "goal walk")
    robot.player.module("user")
    robot.player.declare("user", "query hot?", "goal walk")
    robot.declare("user", "polling monitor", "watch", "hot?, none")
    return robot


def monitor(robot: Transcript, **options: Any) -> int:
    return robot.player.task("user", "watch", watch=WatchOptions(period=1.0), **options)


def test_monitors_are_told_however_many_tasks_are_older(robot: Transcript, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status, "SHOWN_TASKS", 3)
    walks = [robot.player.task("user", "walk") for _ in range(10)]
    first = monitor(robot, under=walks[-1])
    assert told(robot) == [first]
    more = [monitor(robot) for _ in range(4)]
    assert told(robot) == [first, *more[:2]]
    assert status.attached(robot.player.central)["totals"] == {"exception_handlers": 0, "wiretaps": 0, "monitors": 5}


def test_what_watches_no_longer_is_not_told(robot: Transcript) -> None:
    walk = robot.player.task("user", "walk")
    ended, killed, below, retried = (monitor(robot, under=under) for under in (0, 0, walk, 0))
    player = robot.player
    player.receive("user", headers.EndMonitor(player.number("user"), TaskId(ended)))
    player.receive("user", headers.Kill(player.number("user"), TaskId(killed)))
    player.receive("user", headers.Kill(player.number("user"), TaskId(walk)))
    assert told(robot) == [retried]
    player.receive("user", headers.Retry(player.number("user"), TaskId(retried)))
    player.reply("eye/1", value=[0])
    assert below not in told(robot)
    assert told(robot) in ([], [retried])


def test_what_is_refused_or_killed_at_once_is_not_told(robot: Transcript) -> None:
    walk = robot.player.task("user", "walk")  # its handler has it, and so does not end at once
    robot.player.receive("user", headers.Kill(robot.player.number("user"), TaskId(walk)))
    assert monitor(robot, under=walk) > walk
    assert told(robot) == []
    robot.player.send("user", "watch", under=walk, watch=WatchOptions(period=0.0))
    assert told(robot) == []


def test_calls_of_exception_handlers_that_are_attached_anew_again_and_again_are_forgotten() -> None:
    """A program that is restarted every hour attaches them to a task that lives for months."""
    robot = Transcript()
    for line in ("module legs handles command move", "module helper handles exception handler help", "module user",
                 "user: command move", "user: command move flags NONE"):  # fmt: skip
        robot.play(line)
    for _ in range(100):
        robot.play("user: attach slipped->help to 1")
        attached = robot.player.central.tree.newest
        robot.play("user: raise slipped on 1")
        robot.play("helper/1: reply")
        robot.play(f"user: remove {attached}")
    assert len(robot.player.facts(facts.Caught)) == 100
    assert len(robot.player.central.tree.tasks[TaskId(1)].more.invocations) < 20
