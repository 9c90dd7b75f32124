"""A monitor that ends with its watched task is never awaited, neither by this task nor by its
ancestors.
"""

from math import inf

from properties.folded import FoldedPlayer

from tca_central.needs.waits import Ends as CentralEnds
from tca_central.needs.waits import next_of, waits_of
from tca_central.status.load import load
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.critical_path import critical_path, last_task
from tca_tools.explain.graph import causes
from tca_tools.explain.wait_words import in_the_end, reasons
from tca_tools.journal.at_time import RunAt
from tca_wire.packets import headers
from tca_wire.packets.parts import MessageFormat, WatchOptions
from tca_wire.points import END_ACHIEVING, TaskId
from tca_wire.vocabulary import MessageClass
from tca_wire.waits import CommonEnd, WaitFor, WaitKind

WALK, MOVE, GUARD = TaskId(1), TaskId(2), TaskId(3)


def guarded(*, waited_for: bool = False, fired: bool = False) -> FoldedPlayer:
    """Return a player in which a guard {3} watches the move {2} of a walk {1}. Eleven moves wait
    for the walk.

    If *fired*, the guard has sent a lift {4}, which has no handler.
    """
    player = FoldedPlayer()
    player.module("planner", "goal walk")
    player.module("legs", "command move")
    player.module("user")
    player.declare("user", "goal walk", "command move", "command lift", "inform note")
    guard = MessageFormat("guard", MessageClass.DEMON_MONITOR, "{}", "", ["", "lift", ""])
    player.request("user", headers.Register, [guard])
    assert player.task("user", "walk") == WALK
    assert player.task("planner/1", "move", under=WALK) == MOVE
    assert (
        player.task("user", "guard", under=MOVE, watch=WatchOptions(waited_for=waited_for)) == GUARD
    )
    if fired:
        player.request("legs/1", headers.Fire, GUARD, body=b"\x07")
    player.reply("planner/1")
    for _ in range(11):
        player.task("user", "move")
    return player


def test_ancestors_wait_for_the_command_not_its_monitor() -> None:
    player = guarded()
    at = RunAt(player.history)
    assert [reasons(at, at.tasks[one]) for one in (WALK, MOVE)] == [
        ["until move {2} is achieved"],
        [],
    ]
    assert str(in_the_end(at, at.tasks[TaskId(4)])) == "for move {2}, which legs handles"
    waiting, things, found = causes(at)
    assert (waiting, things, [cause.tasks for cause in found]) == (
        12,
        1,
        [12],
    )  # each task counts once


def test_central_status_omits_the_monitor_from_waits() -> None:
    player = guarded()
    walk = player.central.tree.tasks[WALK]
    assert waits_of(player.central, next_of(walk)) == [
        WaitFor(WaitKind.SUBTASK, MOVE, "move", END_ACHIEVING)
    ]
    running = WaitFor(WaitKind.RUNNING, MOVE, "move", module="legs", resource="legs")
    assert CentralEnds(player.central, 1000).end_of(next_of(walk)) == running
    status = load(player.central)
    assert status["ends"] == [CommonEnd(11, running)]
    assert [one.number for one in status["held"]] == [*range(4, 15)]


def test_action_of_a_monitor_is_waited_for() -> None:
    player = guarded(fired=True)
    player.reply("legs/1")
    assert GUARD not in [one.number for one in load(player.central)["held"]]
    at = RunAt(player.history)
    assert reasons(at, at.tasks[MOVE]) == ["until lift {4} is achieved"]
    walk = player.central.tree.tasks[WALK]
    move = player.central.tree.tasks[MOVE]
    assert waits_of(player.central, next_of(move)) == [
        WaitFor(WaitKind.SUBTASK, TaskId(4), "lift", END_ACHIEVING)
    ]
    assert CentralEnds(player.central, 1000).end_of(next_of(walk)) == WaitFor(
        WaitKind.HANDLER, name="lift"
    )
    assert str(in_the_end(at, at.tasks[WALK])) == "for lift {4}, which no module handles"


def test_awaited_monitor_holds_its_ancestors() -> None:
    player = guarded(waited_for=True)
    player.reply("legs/1")
    at = RunAt(player.history)
    assert reasons(at, at.tasks[MOVE]) == ["until guard {3} is achieved"]
    status = load(player.central)
    assert (status["held"][0].number, status["ends"][0].tasks) == (GUARD, 12)


def test_critical_path_ends_with_the_command_not_its_monitor() -> None:
    run = guarded().history
    task = last_task(run)
    assert task is not None
    (*_, last) = critical_path(run, Causes(run), task).steps
    assert (last.message_id, last.end < inf) == (MOVE, True)
