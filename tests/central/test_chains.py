"""Limits of endless chains: listeners of wiretaps that send what they tap, and tasks under tasks."""

import pytest
from central.player import Player

from tca_central.__main__ import central as command
from tca_central.events import LimitsSet
from tca_wire.journal.facts import Received
from tca_wire.packets import headers
from tca_wire.vocabulary import Condition, Refusal, Role


def tapped(message: str, condition: Condition) -> Player:
    """A message that a note listens to."""
    player = Player.of(f"legs: {message}", "user", "note: inform note")
    name = Player.format(message).name
    player.receive("user", headers.Tap(player.number("user"), condition, "note", name))
    player.declare("note", message)
    return player


@pytest.mark.parametrize("message", ["command move", "inform move", "broadcast move", "query move", "goal move"])
@pytest.mark.parametrize("condition", [Condition.WHEN_SENT, Condition.BEFORE_HANDLING, Condition.AFTER_HANDLED])
def test_a_listener_that_sends_what_it_taps_is_stopped(message: str, condition: Condition) -> None:
    player = tapped(message, condition)
    told = player.send("user", "move")
    while not (refused := [one for one in told if isinstance(one, headers.Refused)]) and player.time < 100:
        for legs in player.delivered("legs/1"):
            player.reply("legs/1", legs)
        note = player.delivered("note/1")[0]
        told = player.send("note", "move", origin=note)
        player.reply("note/1", note)
    assert sum(fact.role is Role.LISTENER for fact in player.facts(Received)) == 8
    assert refused[0].refusal is Refusal.OVERLOAD
    assert player.central.registry.messages["move"].dropped == 1


def test_a_setter_of_a_tapped_variable_is_stopped() -> None:
    player = tapped("variable mode", Condition.WHILE_HANDLING)
    player.event(LimitsSet(player.time, 1 << 20, 1, 10))
    player.set_variable("user", "mode", 1)
    header = headers.SetVariable(player.number("note"), "mode", player.delivered("note/1")[0])
    (refused,) = player.receive("note", header, b"\x01")
    assert refused.refusal is Refusal.OVERLOAD


def test_the_daemon_has_the_same_limits_as_the_core() -> None:
    defaults = {option.name: option.default for option in command.params}
    budget = Player().central.budget
    assert (budget.tap_depth, budget.task_depth) == (defaults["tap_depth"], defaults["task_depth"]) == (8, 20_000)
