"""Limits of endless chains: listeners that send the message they tap, deep trees, and repeated
retries.
"""

import logging
from typing import Any

import pytest
from central.player import Player

from tca_central.__main__ import central as command
from tca_central.events import LimitsSet, Record
from tca_central.failing.failures import MOST_ATTEMPTS
from tca_central.shell.log_lines import OFTEN, LogLines
from tca_wire.journal.facts import Caught, Received, Retried
from tca_wire.packets import headers
from tca_wire.packets.parts import Attachment
from tca_wire.points import TaskId
from tca_wire.vocabulary import Condition, Refusal, Role


def tapped(message: str, condition: Condition) -> Player:
    """Return a player in which a wiretap on *message* has the listener "note"."""
    player = Player.of(f"legs: {message}", "user", "note: inform note")
    name = Player.format(message).name
    player.request("user", headers.Tap, condition, "note", name)
    player.declare("note", message)
    return player


@pytest.mark.parametrize(
    "message", ["command move", "inform move", "broadcast move", "query move", "goal move"]
)
@pytest.mark.parametrize(
    "condition", [Condition.WHEN_SENT, Condition.BEFORE_HANDLING, Condition.AFTER_HANDLED]
)
def test_listener_that_sends_its_tapped_message_is_stopped(
    message: str, condition: Condition
) -> None:
    player = tapped(message, condition)
    answers = player.send("user", "move")
    while (
        not (refused := [one for one in answers if isinstance(one, headers.Refused)])
        and player.time < 100
    ):
        for legs in player.delivered("legs/1"):
            player.reply("legs/1", legs)
        note = player.delivered("note/1")[0]
        answers = player.send("note", "move", origin=note)
        player.reply("note/1", note)
    assert sum(fact.role is Role.LISTENER for fact in player.facts(Received)) == 8
    assert refused[0].refusal is Refusal.OVERLOAD
    assert player.central.registry.messages["move"].dropped == 1


def test_listener_that_sets_its_tapped_variable_is_stopped() -> None:
    player = tapped("variable mode", Condition.WHILE_HANDLING)
    player.event(LimitsSet(player.time, 1 << 20, 1, 10))
    player.set_variable("user", "mode", 1)
    (refused,) = player.request(
        "note", headers.SetVariable, "mode", player.delivered("note/1")[0], body=b"\x01"
    )
    assert refused.refusal is Refusal.OVERLOAD


def test_daemon_chain_limits_match_the_core() -> None:
    defaults = {option.name: option.default for option in command.params}
    budget = Player().central.budget
    assert (
        (budget.tap_depth, budget.task_depth)
        == (defaults["tap_depth"], defaults["task_depth"])
        == (8, 20_000)
    )


# --- retries of a task that fails each time -------------------------------------------------------


def begun(maximum: int = 0, failure: str = "slip") -> Player:
    """Return a player with a running move. One exception handler can retry the move; another one is
    attached to the root.
    """
    handlers = "expert: exception handler recover, exception handler stop"
    player = Player.of("legs: command move", handlers, "user", check=False)
    player.request("user", headers.Attach, Attachment("", "stop"))
    player.task("user", "move", attachments=[Attachment(failure, "recover", maximum)])
    return player


def retry(player: Player) -> Any:
    """Let the move fail. Return the answer to the retry that its exception handler requests."""
    player.fail("legs/1", "slip")
    return player.request("expert/1", headers.Retry, TaskId(2))[-1]


def test_retries_stop_at_default_limit_and_search_continues() -> None:
    player = begun()
    while not isinstance(answer := retry(player), headers.Refused):
        player.reply("expert/1")
    assert (answer.refusal, len(player.facts(Retried))) == (Refusal.OVERLOAD, MOST_ATTEMPTS - 1)
    assert "stop" in [
        one.message
        for one in player.fail("expert/1", "handler error")
        if isinstance(one, headers.Deliver)
    ]


def test_catch_all_handler_is_not_called_for_its_refused_retry() -> None:
    player = begun(failure="")
    while not isinstance(retry(player), headers.Refused):
        player.reply("expert/1")
    called = [
        one.message
        for one in player.fail("expert/1", "handler error")
        if isinstance(one, headers.Deliver)
    ]
    assert called == ["stop"]


def test_catch_all_handler_is_called_for_failure_of_its_subtask() -> None:
    player = begun(failure="")
    while not isinstance(retry(player), headers.Refused):
        player.reply("expert/1")
    (*_, handler) = player.facts(Caught)
    player.task("expert/1", "move", under=handler.handler)
    player.fail("legs/1", "slip")
    assert [one.message for one in player.facts(Received) if one.role][-1] == "recover"


def test_attachment_maximum_raises_the_retry_limit() -> None:
    player = begun(MOST_ATTEMPTS + 5)
    for _ in range(MOST_ATTEMPTS + 5):
        retry(player)
        player.reply("expert/1")
    player.fail("legs/1", "slip")
    assert len(player.facts(Retried)) == MOST_ATTEMPTS + 5


def test_frequent_retries_are_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    player = begun()
    lines = LogLines(logging.getLogger("often"), player.central)
    for _ in range(2 * OFTEN):
        retry(player)
        lines.write(Record(player.entries[-1]))
        player.reply("expert/1")
    assert [f"handled {OFTEN} times" in line for line in caplog.messages] == [True]
