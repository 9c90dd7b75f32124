"""Which messages a slot has ahead, and which it does not: every condition of decision 68 that is central's alone."""

import pytest
from central.player import Player

from tca_central.order import ahead
from tca_wire.packets import headers
from tca_wire.vocabulary import Condition

LATER = [Condition.WHEN_SENT, Condition.AFTER_HANDLED, Condition.AFTER_REPLIED]
AT_ONCE = [Condition.BEFORE_HANDLING, Condition.WHILE_HANDLING]


class Ears(Player):
    """Slots take eight messages ahead."""

    prefetch = 8


@pytest.fixture(autouse=True)
def every_handler_is_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "QUICK", 100.0)
    monkeypatch.setattr(ahead, "QUICK_RUNS", 0)


def got(player: Player, slot: str) -> list[int]:
    """The deliveries that a slot was sent, ahead or not."""
    return [header.delivery for header, _ in player.inbox[slot] if isinstance(header, headers.Deliver)]


def ask_three(player: Player, condition: Condition) -> None:
    """Three questions, to which somebody listens."""
    player.receive("user", headers.Tap(player.number("user"), condition, "seen", "where"))
    for _ in range(3):
        player.send("user", "where")


@pytest.mark.parametrize("condition", LATER)
def test_wiretaps_that_fire_before_or_after_hold_nothing_back(condition: Condition) -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    ask_three(player, condition)
    assert len(got(player, "ear/1")) == 3
    heard = len(got(player, "eye/1"))
    player.reply("ear/1")
    assert (heard, len(got(player, "eye/1"))) == ((1, 1) if condition is Condition.WHEN_SENT else (0, 1))


@pytest.mark.parametrize("condition", AT_ONCE)
def test_nothing_is_ahead_of_which_a_listener_is_told_when_it_is_delivered(condition: Condition) -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    ask_three(player, condition)
    assert len(got(player, "ear/1")) == 1
