"""What central tells about itself, topic by topic, of a robot of which something is going on everywhere: topics.json."""

from pathlib import Path

import msgspec
import pytest
from central.player import ANY, Player, before, point

from tca_central.core import Central
from tca_central.status.topics import TOPICS, relatives
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment, MessageFormat, WatchOptions
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Condition, MessageClass

APPROVED = Path(__file__).with_name("topics.json")


@pytest.fixture
def robot() -> Player:
    player = Player()
    player.module("planner", "goal walk", "exception handler recover")
    player.module("legs", "command move", "variable mode", capacity=2, resource="feet", pending=3)
    player.module("user")
    player.declare("user", "goal walk", "command move", "command fly", "variable mode", "query where")
    watch = MessageFormat("watch", MessageClass.POLLING_MONITOR, ANY, "", ["where", "move"])
    player.receive("user", headers.Register(player.number("user"), [watch]))
    walk = player.task("user", "walk", attachments=[Attachment("slipped", "recover", 2)])
    moves = [player.task("planner/1", "move", under=walk, origin=walk) for _ in range(3)]
    player.task("user", "watch", under=walk, origin=0, watch=WatchOptions(7))
    player.task(
        "user",
        "fly",
        flags=Flags.NONE,
        constraints=(before(point(moves[0], Moment.END_ACHIEVING), point(-1, Moment.START_HANDLING)),),
    )
    player.task("user", "fly", flags=Flags.NONE)
    player.send("user", "where", origin=0, blocking=True)
    for value in (b"\x07", b"\xda\x02\x58" + 600 * b"x"):
        player.receive("user", headers.SetVariable(player.number("user"), "mode"), value)
    player.receive("user", headers.Attach(player.number("user"), Attachment("", "recover"), TaskId(0)))
    player.receive("user", headers.Tap(player.number("user"), Condition.AFTER_ACHIEVED, "fly", "walk", TaskId(0)))
    player.receive("user", headers.Suspend(player.number("user"), TaskId(moves[1])))
    player.tick(100.0)
    return player


def test_each_topic(robot: Player, rewrite: bool) -> None:
    told = {name: topic(robot.central) for name, topic in TOPICS.items()}
    text = msgspec.json.format(msgspec.json.encode(told), indent=1).decode() + "\n"
    if rewrite:
        APPROVED.write_text(text)
    assert text == APPROVED.read_text()


def numbers(central: Central, task: int, relation: str, message: str = "") -> list[int]:
    return [one["task"] for one in relatives(central, central.tree.tasks.get(TaskId(task)), relation, message)]


def test_the_relatives_of_a_task(robot: Player) -> None:
    central = robot.central
    (walk,) = [task.id for task in central.tree.tasks.values() if task.message.name == "walk"]
    moves = [task.id for task in central.tree.tasks.values() if task.message.name == "move"]
    assert numbers(central, walk, "self") == [walk]
    assert numbers(central, walk, "parent") == numbers(central, 999, "self") == numbers(central, walk, "kept") == []
    assert numbers(central, walk, "children", "move") == numbers(central, walk, "descendants", "move") == moves
    assert numbers(central, moves[0], "ancestors") == numbers(central, moves[0], "parent") == [walk]
