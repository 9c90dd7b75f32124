"""Limits of endless chains: listeners of wiretaps that send what they tap, and tasks under tasks."""

import pytest
from central.player import Player

from tca_central.__main__ import central as command
from tca_central.events import LimitsSet
from tca_wire.journal.facts import Delivered, Received, RequestRefused, TapFired
from tca_wire.packets import headers
from tca_wire.vocabulary import Condition, Refusal, Role

MEMORY = 512 << 20


def tapped(message: str, *listeners: str, condition: Condition = Condition.WHEN_SENT) -> Player:
    """A message with its wiretaps, oldest first; each listener is handled by a module of its name."""
    player = Player.of(f"legs: {message}", "user", *(f"{one}: inform {one}" for one in listeners))
    for one in listeners:
        player.receive("user", headers.Tap(player.number("user"), condition, one, Player.format(message).name))
        player.declare(one, message)
    return player


def go_round(player: Player, message: str, *listeners: str, most: int = 40) -> list[headers.Refused]:
    """Let each listener send the message again until one is refused; all refusals."""
    player.send("user", message)
    for _ in range(most):
        for one in ("legs", *listeners):
            while mine := player.delivered(f"{one}/1"):
                told = player.send(one, message, origin=mine[0]) if one != "legs" else []
                if refused := [header for header in told if isinstance(header, headers.Refused)]:
                    return refused
                player.reply(f"{one}/1", mine[0])
    pytest.fail("the circle has no end")


def listened(player: Player) -> int:
    return sum(fact.role is Role.LISTENER for fact in player.facts(Received))


@pytest.mark.parametrize("message", ["command move", "inform move", "broadcast move", "query move", "goal move"])
@pytest.mark.parametrize("condition", [Condition.WHEN_SENT, Condition.BEFORE_HANDLING, Condition.AFTER_HANDLED])
def test_a_listener_that_sends_what_it_taps_is_stopped(message: str, condition: Condition) -> None:
    player = tapped(message, "note", condition=condition)
    (refused,) = go_round(player, "move", "note")
    assert listened(player) == 8
    assert refused.refusal is Refusal.OVERLOAD
    assert "would call 'note' (wiretap " in refused.text
    assert "--tap-depth" in refused.text
    assert player.central.registry.messages["move"].dropped == 1


def test_listeners_that_call_each_other_are_stopped() -> None:
    player = tapped("inform move", "note")
    player.module("echo", "inform echo")
    player.declare("echo", "inform call")
    player.receive("user", headers.Tap(player.number("user"), Condition.WHEN_SENT, "echo", "call"))
    told = player.send("user", "move")
    while not (refused := [one for one in told if isinstance(one, headers.Refused)]) and player.time < 100:
        note, echo = player.delivered("note/1"), player.delivered("echo/1")
        told = player.send("note", "call", origin=note[0]) if note else player.send("echo", "move", origin=echo[0])
        player.reply("note/1" if note else "echo/1")
    assert refused[0].refusal is Refusal.OVERLOAD
    assert listened(player) == 8


def test_a_setter_of_a_tapped_variable_is_stopped() -> None:
    player = tapped("variable mode", "note")
    player.event(LimitsSet(player.time, MEMORY, 1, 10))
    player.receive("user", headers.Tap(player.number("user"), Condition.WHILE_HANDLING, "note", "mode"))
    player.set_variable("user", "mode", 1)
    header = headers.SetVariable(player.number("note"), "mode", player.delivered("note/1")[0])
    (refused,) = player.receive("note", header, b"\x01")
    assert refused.refusal is Refusal.OVERLOAD


def test_chains_below_the_limit_are_not_touched() -> None:
    player = tapped("inform move", "note")
    for _ in range(30):  # each is the first listener of its own chain
        player.send("user", "move")
    while mine := player.delivered("note/1"):
        player.reply("note/1", mine[0])
    assert listened(player) == 30
    assert not player.facts(RequestRefused)


def test_a_wiretap_that_comes_late_is_passed_over_at_the_limit() -> None:
    player = tapped("command move", "note")
    player.event(LimitsSet(player.time, MEMORY, 1, 10))
    player.declare("note", "command lift")
    player.send("user", "move")
    lift = player.task("note", "lift", origin=player.delivered("note/1")[0])
    player.receive("user", headers.Tap(player.number("user"), Condition.BEFORE_HANDLING, "note", "lift"))
    player.module("arm", "command lift")
    assert [fact.id for fact in player.facts(Delivered)][-1] == lift
    assert player.facts(TapFired)[-1].listener == 0
    assert "--tap-depth" in player.facts(RequestRefused)[-1].text
    assert player.central.registry.messages["note"].dropped == 1


def test_tasks_stand_at_most_so_deep() -> None:
    player = Player.of("planner: goal walk", "user")
    player.event(LimitsSet(0.0, MEMORY, 8, 3))
    task = 0
    for _ in range(3):
        task = player.task("user", "walk", under=task)
    (refused,) = player.send("user", "walk", under=task)
    assert refused.refusal is Refusal.OVERLOAD
    assert "--task-depth" in refused.text
    assert player.central.registry.messages["walk"].dropped == 1
    assert player.task("user", "walk", under=task - 1)


def test_the_daemon_has_the_same_limits_as_the_core() -> None:
    defaults = {option.name: option.default for option in command.params}
    budget = Player().central.budget
    assert (budget.tap_depth, budget.task_depth) == (defaults["tap_depth"], defaults["task_depth"]) == (8, 20_000)
