"""The data of a failure is no result: every tool calls it what it is, until the task is handled anew."""

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from central.player import Player
from click.testing import Result
from tools.runs import OPENED, encoded

from tca_tools.export.tables import TABLES
from tca_tools.export.trace.details import of_handling, of_task
from tca_tools.run.at_time import RunAt
from tca_tools.run.fold import History
from tca_tools.run.journals import open_log
from tca_tools.tasktree_viz import words
from tca_tools.view.answers import message_answer
from tca_tools.view.reading import Reading
from tca_tools.why.story import story
from tca_wire.journal.facts import Entry
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import TaskId

Tca = Callable[..., Result]

SLIP = {"z": 1.5}


def slipping() -> tuple[Player, int]:
    """A move with data 7, whose handler failed with data; an exception handler has been called."""
    player = Player()
    player.module("legs", "command move")
    player.module("expert", "exception handler recover")
    player.module("user")
    attach = headers.Attach(player.number("user"), Attachment("slip", "recover", 1), TaskId(0), "move")
    player.receive("user", attach)
    move = player.task("user", "move")
    player.tick(1.0)
    slip = headers.Fail(player.delivered("legs/1")[-1], "slip", "on ice")
    player.receive("legs/1", slip, msgspec.msgpack.encode(SLIP))
    return player, move


def retry(player: Player, move: int) -> None:
    player.tick(1.0)
    player.receive("expert/1", headers.Retry(player.number("expert/1"), TaskId(move)))


def entries(player: Player) -> list[Entry]:
    return [OPENED, *player.entries]


def fold(player: Player) -> History:
    return History.until(entries(player))


def test_it_is_no_result() -> None:
    player, move = slipping()
    history = fold(player)
    task = history.tasks[move]
    assert (task.result, msgspec.msgpack.decode(task.failure_data)) == (b"", SLIP)
    assert words.data(RunAt(history).tasks[move]) == '7 failed with {"z": 1.5}'
    assert [one.text for one in story(history, move)][-3:-1] == [
        'the failure\'s data: {"z": 1.5}',
        "exception handler recover {3} is called",
    ]


def test_it_is_gone_as_soon_as_the_task_is_retried() -> None:
    player, move = slipping()
    failed = fold(player).time
    retry(player, move)
    history = fold(player)
    assert not history.tasks[move].handling  # the exception handler has not returned yet
    assert (history.tasks[move].failure, history.tasks[move].failure_data) == ("", b"")
    assert words.data(RunAt(history).tasks[move]) == "7"
    player.reply("expert/1")
    player.reply("legs/1", value="there")
    history = fold(player)
    assert words.data(RunAt(history).tasks[move]) == '7 -> "there"'
    assert words.data(RunAt(history, failed).tasks[move]) == '7 failed with {"z": 1.5}'
    assert [one.text for one in story(history, move)].count('the failure\'s data: {"z": 1.5}') == 1


def test_the_result_of_a_handler_that_ran_before_the_retry_is_void() -> None:
    player = Player()
    player.module("planner", "goal walk")
    player.module("legs", "command move")
    player.module("expert", "exception handler recover")
    player.module("user")
    walk = player.task("user", "walk")
    player.receive("user", headers.Attach(player.number("user"), Attachment("slip", "recover", 1), TaskId(walk)))
    move = player.task("planner/1", "move", under=walk)
    player.reply("planner/1", value="planned")
    assert words.data(RunAt(fold(player)).tasks[walk]) == '7 -> "planned"'
    player.fail("legs/1", "slip")
    retry(player, walk)
    assert fold(player).tasks[walk].result == b""
    player.reply("expert/1")
    slip = headers.Fail(player.delivered("planner/1")[-1], "lost", "in fog")
    player.receive("planner/1", slip, msgspec.msgpack.encode(SLIP))
    assert words.data(RunAt(fold(player)).tasks[walk]) == '7 failed with {"z": 1.5}'
    assert fold(player).tasks[move].killed


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = tmp_path / "slip.tcaj"
    path.write_bytes(encoded(entries(slipping()[0])))
    return path


def test_exports_and_the_page_say_so(run: Path) -> None:
    player, move = slipping()
    history = fold(player)
    task = history.tasks[move]
    for details in (of_task(history, task), of_handling(history, task.handlings[0])):
        assert (details["result"], details["failure data"]) == (None, SLIP)
    messages = next(table for table in TABLES if table.name == "messages")
    row = dict(zip(messages.columns, next(iter(messages.rows(history))), strict=True))
    assert (row["result"], json.loads(row["failure_data"])) == (None, SLIP)
    reading = Reading(open_log(run))
    for entry in open_log(run):
        reading.feed.apply(entry)
    answer = message_answer(reading, move, history.time)
    assert answer is not None
    assert (answer["result"], answer["failureData"]) == ("", '{"z": 1.5}')
