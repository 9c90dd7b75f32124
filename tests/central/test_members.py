"""The centrals with the same replicated log: who leads, and who can take over."""

from central.player import Player

from tca_central.core import Central
from tca_central.events import MembersChanged, Standby
from tca_central.image.decoder import decode
from tca_central.image.encoder import encode
from tca_central.status.topics import overview
from tca_wire.journal import facts

FOLLOWING = Standby("two:7", "tcp://two:5555")
BEHIND = Standby("three:8", "tcp://three:5555", behind=10)


def changed() -> Player:
    player = Player.of("user")
    standbys = (FOLLOWING, BEHIND)
    player.event(MembersChanged(player.time, "one:5", "tcp://one:5555", standbys))
    return player


def members_in(central: Central) -> list[tuple[str, int]]:
    return [(one["process"], one["behind"]) for one in overview(central)["members"]["standbys"]]


def test_status_shows_who_leads_and_who_follows() -> None:
    central = changed().central
    assert overview(central)["members"]["leader"] == "one:5"
    assert members_in(central) == [("two:7", 0), ("three:8", 10)]


def test_status_has_no_members_without_a_replicated_log() -> None:
    assert "members" not in overview(Central())


def test_journal_records_a_change_of_members() -> None:
    (fact,) = changed().entries[-1].facts
    assert fact == facts.MembersChanged("one:5", ["two:7", "three:8"], ["three:8"])


def test_image_keeps_the_members() -> None:
    central = changed().central
    assert members_in(decode(encode(central))) == members_in(central)
