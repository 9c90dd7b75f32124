"""After a restart of central: who does not come back has perhaps ended his work, and who does may say it again."""

from typing import Any

from central.player import Player

from tca_central.events import Restarted
from tca_wire.journal.facts import Failed
from tca_wire.packets import headers

GRACE = 10.0


def restarted() -> tuple[Player, int]:
    """Legs were at a move when central was away."""
    player = Player.of("legs: command move", "user")
    move = player.task("user", "move")
    restart(player)
    return player, move


def restart(player: Player) -> None:
    player.event(Restarted(player.time, 1.0, GRACE))


def back(player: Player, *connections: str) -> None:
    """They show who they are by what they said when they came first."""
    for connection in connections:
        module, _, number = connection.partition("/")
        hello = headers.Hello(
            0,
            headers.PROTOCOL_VERSION,
            module,
            f"run of {module}",
            int(number or 0),
            module if number else "",
            "here:1",
        )
        player.receive(connection, hello)


def failures(player: Player) -> list[str]:
    return [fact.failure for fact in player.facts(Failed)]


def complaints(answers: list[Any]) -> list[Any]:
    return [one for one in answers if isinstance(one, headers.Refused)]


def test_who_does_not_come_back_has_perhaps_ended_what_he_had() -> None:
    player, _ = restarted()
    back(player, "user")
    player.tick(GRACE)
    assert failures(player) == ["uncertain"]


def test_who_is_back_and_is_lost_later_has_not_ended_it() -> None:
    player, _ = restarted()
    back(player, "user", "legs", "legs/1")
    player.lose("legs/1")
    assert failures(player) == ["module lost"]


def test_another_restart_begins_the_wait_anew() -> None:
    player, _ = restarted()
    player.tick(GRACE - 1)
    restart(player)
    player.tick(GRACE - 1)
    assert failures(player) == []
    player.tick(1)
    assert failures(player) == ["uncertain"]


def test_an_answer_that_may_have_been_lost_is_taken_once_and_its_repeat_is_no_fault() -> None:
    player, move = restarted()
    back(player, "user", "legs", "legs/1")
    assert complaints(player.reply("legs/1", move)) == []
    before = len(player.entries)
    assert player.reply("legs/1", move) == []
    assert len(player.entries) == before or not player.entries[-1].facts


def test_an_answer_that_was_never_in_doubt_is_a_fault_the_second_time() -> None:
    player, _ = restarted()
    back(player, "user", "legs", "legs/1")
    player.reply("legs/1")
    later = player.task("user", "move")
    assert complaints(player.reply("legs/1", later)) == []
    assert len(complaints(player.reply("legs/1", later))) == 1
