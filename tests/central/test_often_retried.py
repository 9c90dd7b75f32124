"""A task that fails again and again is not retried for ever."""

import logging
from typing import Any

import pytest
from central.player import Player

from tca_central.events import Record
from tca_central.failing.failures import MOST_ATTEMPTS
from tca_central.shell.log_lines import OFTEN, LogLines
from tca_wire.journal.facts import Caught, Received, Retried
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import TaskId
from tca_wire.vocabulary import Refusal


def begun(maximum: int = 0, failure: str = "slip") -> Player:
    """A move that an exception handler retries each time it slips; a further one is at the root."""
    handlers = "expert: exception handler recover, exception handler stop"
    player = Player.of("legs: command move", handlers, "user", check=False)
    player.receive("user", headers.Attach(player.number("user"), Attachment("", "stop")))
    player.task("user", "move", attachments=[Attachment(failure, "recover", maximum)])
    return player


def retry(player: Player) -> Any:
    """The move slips; the answer to the exception handler, which wants it retried."""
    player.fail("legs/1", "slip")
    return player.receive("expert/1", headers.Retry(player.number("expert/1"), TaskId(2)))[-1]


def test_retries_end_at_a_default_and_the_search_continues() -> None:
    player = begun()
    while not isinstance(answer := retry(player), headers.Refused):
        player.reply("expert/1")
    assert (answer.refusal, len(player.facts(Retried))) == (Refusal.OVERLOAD, MOST_ATTEMPTS - 1)
    assert "stop" in [
        one.message for one in player.fail("expert/1", "handler error") if isinstance(one, headers.Deliver)
    ]


def test_a_handler_of_all_is_not_asked_about_its_refused_retry() -> None:
    player = begun(failure="")
    while not isinstance(retry(player), headers.Refused):
        player.reply("expert/1")
    called = [one.message for one in player.fail("expert/1", "handler error") if isinstance(one, headers.Deliver)]
    assert called == ["stop"]


def test_a_handler_of_all_is_asked_about_what_it_sends_instead() -> None:
    player = begun(failure="")
    while not isinstance(retry(player), headers.Refused):
        player.reply("expert/1")
    (*_, handler) = player.facts(Caught)
    player.task("expert/1", "move", under=handler.handler)
    player.fail("legs/1", "slip")
    assert [one.message for one in player.facts(Received) if one.role][-1] == "recover"


def test_retries_end_later_with_a_maximum_of_ones_own() -> None:
    player = begun(MOST_ATTEMPTS + 5)
    for _ in range(MOST_ATTEMPTS + 5):
        retry(player)
        player.reply("expert/1")
    player.fail("legs/1", "slip")
    assert len(player.facts(Retried)) == MOST_ATTEMPTS + 5


def test_log_warns_once_of_a_task_that_is_retried_often(caplog: pytest.LogCaptureFixture) -> None:
    player = begun()
    lines = LogLines(logging.getLogger("often"), player.central)
    for _ in range(2 * OFTEN):
        retry(player)
        lines.write(Record(player.entries[-1]))
        player.reply("expert/1")
    assert [f"handled {OFTEN} times" in line for line in caplog.messages] == [True]
