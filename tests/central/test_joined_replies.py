"""A slot reports several returned handlers with one header. Each of them counts as if it had a
reply of its own.
"""

import pytest
from central.player import Player

from tca_central.order import prefetching
from tca_wire.journal.facts import Answered, Delivered, Queued, RequestRefused, Returned
from tca_wire.packets import headers
from tca_wire.packets.parts import EndedRun

NIL = b"\xc0"


class Ears(Player):
    """A player whose slots prefetch up to eight messages."""

    prefetch = 8


@pytest.fixture
def player(monkeypatch: pytest.MonkeyPatch) -> Ears:
    """Return a player with a slot that handles a note, and has prefetched three more notes and a
    query.
    """
    monkeypatch.setattr(prefetching, "QUICK", 100.0)
    monkeypatch.setattr(prefetching, "QUICK_RUNS", 0)
    player = Ears.of("ear: inform note, query where", "user")
    for message in ("note", "note", "note", "note", "where"):
        player.send("user", message)
    return player


def report_returns(
    player: Player, *runs: tuple[int, float, float], begun: float = -1.0
) -> list[object]:
    """Report returned handlers: the number, the age of the end and the run time of each."""
    return player.receive("ear/1", headers.Replies([EndedRun(*run) for run in runs], begun))


def test_joined_returns_make_one_entry_and_free_the_slot(player: Ears) -> None:
    report_returns(player, (1, 0.3, 0.1), (2, 0.2, 0.1), (3, 0.1, 0.1))
    assert [fact.id for fact in player.entries[-1].facts if isinstance(fact, Returned)] == [1, 2, 3]
    assert [fact.id for fact in player.facts(Delivered)] == [1, 2, 3, 4]
    assert player.delivered("ear/1") == [4]


def test_joined_replies_keep_their_own_bodies(player: Ears) -> None:
    report_returns(player, *((number, 0.1, 0.0) for number in (1, 2, 3)))
    runs = [EndedRun(4, 0.0, 0.0), EndedRun(5, 0.0, 0.0, 2)]
    player.receive("ear/1", headers.Replies(runs), b"\xcc\xc8")
    assert [fact.body for fact in player.facts(Returned)] == [NIL] * 4 + [b"\xcc\xc8"]
    assert [fact.id for fact in player.facts(Answered)] == [5]
    assert player.inbox["user"][-1] == (headers.Answer(7), b"\xcc\xc8")


def test_invalid_joined_reply_does_not_lose_the_others(player: Ears) -> None:
    headers_sent = report_returns(
        player, (1, 0.1, 0.0), (99, 0.1, 0.0), (1, 0.1, 0.0), (2, 0.1, 0.0)
    )
    assert [fact.id for fact in player.facts(Returned)] == [1, 2]
    assert (
        len(player.facts(RequestRefused))
        == len([one for one in headers_sent if isinstance(one, headers.Refused)])
        == 2
    )


@pytest.mark.parametrize("body", [b"", b"\xc0\xc0\xc0"])
def test_joined_replies_with_wrong_body_size_are_refused(player: Ears, body: bytes) -> None:
    player.receive(
        "ear/1", headers.Replies([EndedRun(1, 0.0, 0.0), EndedRun(2, 0.0, 0.0, 2)]), body
    )
    assert not player.facts(Returned)
    assert player.delivered("ear/1") == [1]


def times(player: Player) -> list[tuple[float, float]]:
    """Return the start and end of each run in the journal."""
    began, ended = ({}, {})  # type: tuple[dict[int, float], dict[int, float]]
    for entry in player.entries:
        for fact in entry.facts:
            if isinstance(fact, Delivered):
                began[fact.id] = fact.began or entry.time
            elif isinstance(fact, Returned):
                ended[fact.id] = fact.ended or entry.time
    return [(began[one], ended.get(one, 0.0)) for one in began]


def test_journal_records_when_each_joined_run_began_and_ended(player: Ears) -> None:
    start = player.time
    player.time += 9.0
    report_returns(player, (1, 4.0, 1.0), (2, 3.0, 0.5), (3, 1.0, 1.5), begun=0.5)
    (first, *others), now = times(player), start + 10.0
    assert first == (
        player.entries[-5].time - 1.0,
        now - 4.0,
    )  # central knows when it delivered the first message
    assert others == [(now - 3.5, now - 3.0), (now - 2.5, now - 1.0), (now - 0.5, 0.0)]
    assert player.central.dispatcher.running[4].since == now - 0.5
    (slot,) = player.central.registry.modules["run of ear"].resources.values()
    assert slot.busy == pytest.approx(now - 4.0 - first[0] + 0.5 + 1.5)


@pytest.mark.parametrize("wrong", [1e300, float("inf"), float("nan"), -5.0])
def test_reported_run_times_are_clamped_to_plausible_times(player: Ears, wrong: float) -> None:
    queued = {
        fact.id: entry.time
        for entry in player.entries
        for fact in entry.facts
        if isinstance(fact, Queued)
    }
    report_returns(player, (1, wrong, 0.0), (2, 0.0, wrong), (3, wrong, wrong), begun=abs(wrong))
    over = 0.0
    for number, (began, ended) in enumerate(times(player), 1):
        assert max(over, queued.get(number, 0.0)) <= began <= player.time
        assert began <= ended <= player.time or not ended
        over = ended
