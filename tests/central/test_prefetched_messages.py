"""Prefetching: which messages central sends to a slot before it is free (decision 68)."""

import logging

import pytest
from central.player import Player

from tca_central.events import Record
from tca_central.order import prefetching
from tca_central.shell.log_lines import LogLines
from tca_wire.journal.facts import Dropped
from tca_wire.packets import headers
from tca_wire.packets.parts import HandlerFormat
from tca_wire.vocabulary import Condition

AT_SENDING_OR_RETURN = [Condition.WHEN_SENT, Condition.AFTER_HANDLED, Condition.AFTER_REPLIED]
AT_DELIVERY = [Condition.BEFORE_HANDLING, Condition.WHILE_HANDLING]


class Ears(Player):
    """A player whose slots prefetch up to eight messages."""

    prefetch = 8


def trust_every_handler(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(prefetching, "QUICK", 100.0)
    patch.setattr(prefetching, "QUICK_RUNS", 0)


@pytest.fixture(autouse=True)
def every_handler_is_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    trust_every_handler(monkeypatch)


def deliveries(player: Player, slot: str) -> list[int]:
    """Return the deliveries that central sent to a slot, prefetched or not."""
    return [
        header.delivery for header, _ in player.inbox[slot] if isinstance(header, headers.Deliver)
    ]


def send_three_tapped_queries(player: Player, condition: Condition) -> None:
    """Send three queries that are tapped."""
    player.request("user", headers.Tap, condition, "seen", "where")
    for _ in range(3):
        player.send("user", "where")


@pytest.mark.parametrize("condition", AT_SENDING_OR_RETURN)
def test_wiretap_at_sending_or_return_allows_prefetch(condition: Condition) -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    send_three_tapped_queries(player, condition)
    assert len(deliveries(player, "ear/1")) == 3
    before_return = len(deliveries(player, "eye/1"))
    player.reply("ear/1")
    assert (before_return, len(deliveries(player, "eye/1"))) == (
        (1, 1) if condition is Condition.WHEN_SENT else (0, 1)
    )


@pytest.mark.parametrize("condition", AT_DELIVERY)
def test_wiretap_at_delivery_prevents_prefetch(
    condition: Condition,
) -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    send_three_tapped_queries(player, condition)
    assert len(deliveries(player, "ear/1")) == 1


@pytest.mark.parametrize("condition", AT_DELIVERY)
def test_late_wiretap_recalls_prefetched_messages(condition: Condition) -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    for _ in range(3):
        player.send("user", "where")
    first, *others = deliveries(player, "ear/1")
    player.request("user", headers.Tap, condition, "seen", "where")
    recalled = [
        header.deliveries
        for header, _ in player.inbox["ear/1"]
        if isinstance(header, headers.Recall)
    ]
    assert recalled == [others]
    player.receive("ear/1", headers.Recalled(others))
    player.reply("ear/1", first)
    assert len(deliveries(player, "eye/1")) == 1
    assert deliveries(player, "ear/1") == [first, *others, others[0]]


def test_message_with_pending_limit_is_not_prefetched() -> None:
    player = Ears.of("user")
    player.module("ear", "inform note", pending=2)
    for _ in range(5):
        player.send("user", "note")
    assert len(deliveries(player, "ear/1")) == 1
    assert len(player.facts(Dropped)) == 2


def test_unregistered_handler_returns_prefetched_messages() -> None:
    player = Ears.of("spare: query where", "ear: query where, inform note", "user")
    for _ in range(3):
        player.send("user", "where")
    first, *others = deliveries(player, "ear/1")
    player.request("ear", headers.Unregister, ["where"])
    recalled = [
        header.deliveries
        for header, _ in player.inbox["ear/1"]
        if isinstance(header, headers.Recall)
    ]
    assert recalled == [others]
    player.receive("ear/1", headers.Recalled(others))
    player.reply("ear/1", first)
    assert deliveries(player, "spare/1") == others
    assert deliveries(player, "ear/1") == [first, *others]


def test_module_loss_is_logged_as_one_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    player = Ears.of("ear: query where", "user")
    for _ in range(5):
        player.send("user", "where")
    lines = LogLines(logging.getLogger("t"), player.central)
    for effect in player.lose("ear/1"):
        if isinstance(effect, Record):
            lines.write(effect)
    first, *_ = deliveries(player, "ear/1")
    named = ", ".join(f"where {{{number}}}" for number in range(first, first + 3))
    assert [line for line in caplog.messages if "failure" in line] == [
        f"failure 'module lost' of {named} and 2 more: module 'ear' was lost: its connection closed"
    ]


def test_slot_may_keep_a_later_message_than_it_returns() -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    for _ in range(4):
        player.send("user", "where")
    first, *others, last = deliveries(player, "ear/1")
    player.request("user", headers.Tap, Condition.BEFORE_HANDLING, "seen", "where")
    player.receive("ear/1", headers.Recalled(others))
    # After a power cut, central may have lost the replies to the others.
    for delivery in (first, last, *others):
        player.reply("ear/1", delivery)
    answered = [
        header.number for header, _ in player.inbox["user"] if isinstance(header, headers.Answer)
    ]
    assert len(answered) == len(set(answered)) == 4


def test_slot_is_recalled_only_once_until_it_answers() -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    for _ in range(3):
        player.send("user", "where")
    for condition in AT_DELIVERY:
        player.receive("user", headers.Tap(player.number("user"), condition, "seen", "where"))
    assert (
        len([header for header, _ in player.inbox["ear/1"] if isinstance(header, headers.Recall)])
        == 1
    )


def test_lock_of_copies_waits_for_the_recall_of_one() -> None:
    player = Ears.of("ear: query where", "eye: inform seen", "user")
    for _ in range(3):
        player.send("user", "where")
    player.request("user", headers.Tap, Condition.BEFORE_HANDLING, "seen", "where")  # recalls them
    player.request("user", headers.Lock, "ear")
    granted = headers.Answer(player.numbers["user"])
    for delivery in deliveries(player, "ear/1"):
        player.reply("ear/1", delivery)
    player.hello("two", "ear", incarnation="run of two")
    player.request("two", headers.Register, [], [HandlerFormat("where", "ear")])
    assert granted not in [header for header, _ in player.inbox["user"]]
    player.receive("ear/1", headers.Recalled([], is_answer=True))
    assert granted in [header for header, _ in player.inbox["user"]]
