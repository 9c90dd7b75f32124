"""The status that central reports, topic by topic. The file topics.json has the approved output for
a busy robot.
"""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from central.player import INTEGER, Player, before, point
from central.transcript import Transcript

from tca_central.core import Central
from tca_central.model.tasks import Recovery
from tca_central.status import topics
from tca_central.status.topics import TOPICS, relatives
from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass

APPROVED = Path(__file__).with_name("topics.json")


@pytest.fixture
def robot() -> Player:
    player = Player.of("planner: goal walk, exception handler recover")
    player.module("legs", "command move", "variable mode", capacity=2, resource="feet", pending=3)
    player.module("user")
    player.declare(
        "user", "goal walk", "command move", "command fly", "variable mode", "query where"
    )
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, INTEGER, "", ["where", "move"])
    player.request("user", headers.Register, [watch])
    walk = player.task("user", "walk", attachments=[Attachment("slipped", "recover", 2)])
    moves = [player.task("planner/1", "move", under=walk, origin=walk) for _ in range(3)]
    player.task("user", "watch", under=walk, origin=0, watch=WatchOptions(7))
    player.task(
        "user",
        "fly",
        flags=Flags.NONE,
        constraints=(
            before(point(moves[0], Moment.END_ACHIEVING), point(-1, Moment.START_HANDLING)),
        ),
    )
    player.task("user", "fly", flags=Flags.NONE)
    player.send("user", "where", origin=0, blocking=True)
    for value in (b"\x07", b"\xda\x02\x58" + 600 * b"x"):
        player.request("user", headers.SetVariable, "mode", body=value)
    player.request("user", headers.Attach, Attachment("", "recover"), TaskId(0))
    player.request("user", headers.Tap, Condition.AFTER_ACHIEVED, "fly", "walk", TaskId(0))
    player.request("user", headers.Suspend, TaskId(moves[1]))
    player.tick(100.0)
    return player


def test_status_topics_match_approved_output(robot: Player, rewrite: bool) -> None:
    reports = {name: topic(robot.central) for name, topic in TOPICS.items()}
    text = msgspec.json.format(msgspec.json.encode(reports), indent=1).decode() + "\n"
    if rewrite:
        APPROVED.write_text(text)
    assert text == APPROVED.read_text()


def numbers(central: Central, task: int, relation: str, message: str = "") -> list[int]:
    return [
        one["task"]
        for one in relatives(central, central.tree.tasks.get(TaskId(task)), relation, message)
    ]


def test_relatives_of_a_task_are_listed(robot: Player) -> None:
    central = robot.central
    (walk,) = [task.id for task in central.tree.tasks.values() if task.message.name == "walk"]
    moves = [task.id for task in central.tree.tasks.values() if task.message.name == "move"]
    assert numbers(central, walk, "self") == [walk]
    assert (
        numbers(central, walk, "parent")
        == numbers(central, 999, "self")
        == numbers(central, walk, "kept")
        == []
    )
    assert (
        numbers(central, walk, "children", "move")
        == numbers(central, walk, "descendants", "move")
        == moves
    )
    assert numbers(central, moves[0], "ancestors") == numbers(central, moves[0], "parent") == [walk]


# --- the topic "attached": monitors anywhere in the tree ------------------------------------------


def listed_monitors(watcher: Transcript) -> list[int]:
    return [one["id"] for one in topics.attached(watcher.player.central)["monitors"]]


@pytest.fixture
def watcher() -> Transcript:
    """Return a transcript whose user can send monitors of a sensor."""
    watcher = Transcript()
    watcher.player.module("eye", "query hot?", "goal walk")
    watcher.player.module("user")
    watcher.player.declare("user", "query hot?", "goal walk")
    watcher.declare("user", "polling monitor", "watch", "hot?, none")
    return watcher


def monitor(watcher: Transcript, **options: Any) -> int:
    return watcher.player.task("user", "watch", watch=WatchOptions(period=1.0), **options)


def test_monitors_are_listed_regardless_of_older_tasks(
    watcher: Transcript, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(topics, "SHOWN_TASKS", 3)
    walks = [watcher.player.task("user", "walk") for _ in range(10)]
    first = monitor(watcher, under=walks[-1])
    assert listed_monitors(watcher) == [first]
    more = [monitor(watcher) for _ in range(4)]
    assert listed_monitors(watcher) == [first, *more[:2]]
    assert topics.attached(watcher.player.central)["totals"] == {
        "exception_handlers": 0,
        "wiretaps": 0,
        "monitors": 5,
    }


def test_ended_monitors_are_not_listed(watcher: Transcript) -> None:
    walk = watcher.player.task("user", "walk")
    ended, killed, below, retried = (monitor(watcher, under=under) for under in (0, 0, walk, 0))
    player = watcher.player
    player.request("user", headers.EndMonitor, TaskId(ended))
    player.request("user", headers.Kill, TaskId(killed))
    player.request("user", headers.Kill, TaskId(walk))
    assert listed_monitors(watcher) == [retried]
    player.request("user", headers.Retry, TaskId(retried))
    player.reply("eye/1", value=[0])
    assert below not in listed_monitors(watcher)
    assert listed_monitors(watcher) in ([], [retried])


def test_refused_and_killed_monitors_are_not_listed(watcher: Transcript) -> None:
    walk = watcher.player.task("user", "walk")  # the handler runs on
    watcher.player.request("user", headers.Kill, TaskId(walk))
    assert monitor(watcher, under=walk) > walk
    assert listed_monitors(watcher) == []
    watcher.player.send("user", "watch", under=walk, watch=WatchOptions(period=0.0))
    assert listed_monitors(watcher) == []


def test_calls_of_removed_attachments_are_forgotten() -> None:
    """A program that restarts every hour may attach to a task that lives for months."""
    robot = Transcript()
    for line in (
        "module legs handles command move",
        "module helper handles exception handler help",
        "module user",
        "user: command move",
        "user: command move flags NONE",
    ):
        robot.play(line)
    for _ in range(100):
        robot.play("user: attach slipped->help to 1")
        attached = robot.player.central.tree.newest
        robot.play("user: raise slipped on 1")
        robot.play("helper/1: resolve")
        robot.play("helper/1: reply")
        robot.play(f"user: remove {attached}")
    assert len(robot.player.facts(facts.Caught)) == 100
    assert len(Recovery.of(robot.player.central.tree.tasks[TaskId(1)]).invocations) < 20


def test_killed_task_is_not_named_as_open() -> None:
    robot = Player.of("legs: command move", "user")
    moves = [robot.task("user", "move") for _ in range(3)]
    robot.request("user", headers.Kill, TaskId(moves[0]))  # its handler has not returned
    robot.request("user", headers.Ask, "sent")
    assert msgspec.msgpack.decode(robot.inbox["user"][-1][1])["total"] == 2
