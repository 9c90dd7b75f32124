"""The load that central reports: its counters, and the longest waits with their reasons."""

from typing import Any

import pytest
from central.player import Player, before, point

from tca_central.status.load import SHOWN_WAITS, load
from tca_wire.constraints import Flags
from tca_wire.journal.facts import Awaited, RequestRefused
from tca_wire.packets import headers
from tca_wire.packets.changes import Observe
from tca_wire.points import Moment, TaskId
from tca_wire.text.waits_in_words import several_in_words, waiter_in_words
from tca_wire.vocabulary import Refusal


def resource(report: dict[str, Any], module: str) -> dict[str, Any]:
    """Return the first resource of a module."""
    (found,) = [one for one in report["modules"] if one["module"] == module]
    first: dict[str, Any] = found["resources"][0]
    return first


def message(report: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [one for one in report["messages"] if one["message"] == name]
    return dict(found)


def waits(report: dict[str, Any]) -> list[tuple[str, str, float]]:
    return [
        (waiter_in_words(one), several_in_words(one.waits), one.seconds) for one in report["waits"]
    ]


def test_longest_waits_are_listed_first() -> None:
    robot = Player.of("legs: command step", "user: query where")
    robot.send("user", "where")  # the handler never replies
    robot.module("other")
    robot.declare("other", "command dance")
    robot.task("other", "dance", flags=0)
    first, *_ = [robot.task("user", "step", flags=0) for _ in range(3)]
    robot.send("other", "where", origin=0, blocking=True)
    robot.tick(10.0)
    report = load(robot.central)
    assert waits(report) == [
        ("dance {2}", "for a module that handles dance", 14.0),
        (f"step {{{first + 1}}} and 1 more", f"for legs, busy with step {{{first}}}", 12.0),
        ("where {6}", "for user, busy with where {1}", 10.0),
        (
            "module other",
            "for the reply to where {6} (it is queued for user, busy with where {1})",
            10.0,
        ),
    ]
    assert resource(report, "legs")["oldest"] == 12.0


def test_load_totals_include_waits_that_are_not_listed() -> None:
    robot = Player.of("user: goal walk")
    robot.declare("user", "command step")
    for _ in range(SHOWN_WAITS + 20):
        robot.task("user", "step", flags=int(Flags.SEQ_ACH))
    for _ in range(SHOWN_WAITS + 10):
        suspended = robot.task("user", "step", flags=0)
        robot.request("user", headers.Suspend, TaskId(suspended))
    report = load(robot.central)
    assert (len(report["held"]), len(report["suspended"])) == (SHOWN_WAITS, SHOWN_WAITS)
    assert report["totals"] == {"waits": 1, "held": SHOWN_WAITS + 19, "suspended": SHOWN_WAITS + 10}
    assert report["looked_at"] == report["tasks"]


# --- blocked handlers and deadlocks ---------------------------------------------------------------


@pytest.fixture
def robot() -> Player:
    """Return a player with a map and eyes, and a user that sends queries."""
    robot = Player.of("map: query where", "eyes: query look, command turn", "user")
    robot.declare("user", "query nobody", "goal plan")
    return robot


@pytest.mark.parametrize("brief", [False, True])
def test_brief_wait_is_not_a_deadlock(robot: Player, *, brief: bool) -> None:
    robot.send("user", "where")
    robot.send("map/1", "look", origin=1, blocking=True)
    robot.send("eyes/1", "where", origin=2, blocking=True, brief=brief)
    robot.tick(10.0)
    assert bool(robot.facts(RequestRefused)) is not brief
    report = load(robot.central)
    assert (
        (
            "look {2} in eyes",
            "for the reply to where {3} (it is queued for map, busy with where {1})",
            10.0,
        )
        in waits(report)
    ) is brief
    assert resource(report, "eyes")["blocked"] == brief
    assert resource(report, "map")["blocked"] == 1


def test_handler_counts_as_blocked_only_while_it_awaits(robot: Player) -> None:
    robot.send("user", "where")
    robot.send("map/1", "look", origin=1, number=7)
    assert resource(load(robot.central), "map")["blocked"] == 0
    assert not robot.receive("map/1", headers.Await(7))
    robot.receive("map/1", headers.Await(99))  # an unknown request changes nothing
    assert resource(load(robot.central), "map")["blocked"] == 1
    robot.reply("eyes/1")
    robot.receive("map/1", headers.Await(7))
    assert resource(load(robot.central), "map")["blocked"] == 0
    assert robot.facts(Awaited) == [Awaited(2)]


def test_awaiting_coroutine_does_not_block_its_thread(robot: Player) -> None:
    robot.send("user", "where")
    robot.send("map/1", "look", origin=1, number=7)
    robot.receive("map/1", headers.Await(7, blocking=False))
    assert resource(load(robot.central), "map")["blocked"] == 0
    assert robot.facts(Awaited) == [Awaited(2)]


def test_observer_deadlock_is_found_after_a_handler_returns(robot: Player) -> None:
    robot.module("legs", "goal walk")
    waiting = robot.task("user", "walk", flags=Flags.NONE)
    before_its_end = before(point(waiting, Moment.END_HANDLING), point(-1, Moment.END_HANDLING))
    turning = robot.task("user", "turn", flags=Flags.NONE, constraints=(before_its_end,))
    number = robot.number("legs/1")
    robot.receive("legs/1", Observe(number, task=TaskId(turning), origin=waiting))
    robot.receive("legs/1", headers.Await(number, blocking=True, origin=waiting, seen=2))
    robot.tick(10.0)
    assert not robot.facts(RequestRefused), "the handler of the task may change it"
    robot.reply("eyes/1")
    robot.tick(10.0)
    assert [fact.refusal for fact in robot.facts(RequestRefused)] == [Refusal.DEADLOCK]
