"""Hung handlers: their slots are replaced if the module has set a hang limit."""

import pytest
from central.player import Player, point

from tca_central.events import Tick
from tca_wire.packets import headers
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Refusal

AFTER = 5.0


@pytest.fixture
def player() -> Player:
    player = Player()
    player.module("legs", "command move", "query where", capacity=0)
    slot(player, "legs/1", 1)
    player.module("user")
    return player


def slot(player: Player, connection: str, number: int, hung_after: float = AFTER) -> list[object]:
    return player.request(
        connection,
        headers.Hello,
        headers.PROTOCOL_VERSION,
        "legs",
        "run of legs",
        number,
        "legs",
        "here:1",
        hung_after=hung_after,
    )


def pass_time(player: Player, seconds: float) -> None:
    player.time += seconds
    player.event(Tick(player.time))


def headers_sent(player: Player, connection: str) -> list[object]:
    return [header for header, _ in player.inbox[connection]]


def test_slot_of_hung_handler_is_replaced_after_a_kill(
    player: Player,
) -> None:
    first, second = player.task("user", "move"), player.task("user", "move")
    waiting = headers.AwaitPoint(player.number("user"), point(first, Moment.END_ACHIEVING))
    player.receive("user", waiting)
    player.request("user", headers.Kill, TaskId(first))
    pass_time(player, AFTER - 2)
    assert first in player.central.tree.tasks
    pass_time(player, 2.0)
    assert first not in player.central.tree.tasks
    answers = [one for one in headers_sent(player, "user") if isinstance(one, headers.Answer)]
    assert [one.number for one in answers] == [waiting.number]
    (replace,) = [one for one in headers_sent(player, "legs") if isinstance(one, headers.Replace)]
    assert (replace.number, "'move' hangs" in replace.text) == (1, True)
    assert second in player.central.tree.tasks
    slot(player, "legs/2", 2)
    assert player.delivered("legs/2") == [second]
    player.reply("legs/2")
    assert not player.central.tree.tasks


def test_abandoned_slot_is_refused_when_it_answers_or_returns(player: Player) -> None:
    task = player.task("user", "move")
    player.request("user", headers.Kill, TaskId(task))
    pass_time(player, AFTER + 1)
    (answer,) = player.receive("legs/1", headers.Reply(task), b"\xc0")
    assert isinstance(answer, headers.Unknown)
    (refused,) = slot(player, "legs/1 again", 1)
    assert isinstance(refused, headers.Refused)
    assert refused.refusal is Refusal.TOO_LATE
    resource = player.central.registry.modules["run of legs"].resources["legs"]
    assert (resource.capacity, resource.replaced) == (0, 1)


def test_slot_of_hung_query_is_replaced_after_sender_gives_up(player: Player) -> None:
    player.send("user", "where")
    player.receive("user", headers.GiveUp(player.numbers["user"]))
    pass_time(player, AFTER + 1)
    assert any(isinstance(one, headers.Replace) for one in headers_sent(player, "legs"))


def test_handler_that_returns_in_time_keeps_its_slot(player: Player) -> None:
    task = player.task("user", "move")
    player.request("user", headers.Kill, TaskId(task))
    player.reply("legs/1")
    following = player.task("user", "move")
    pass_time(player, 2 * AFTER)
    assert player.central.tree.tasks[following].is_running
    assert not any(isinstance(one, headers.Replace) for one in headers_sent(player, "legs"))


def test_handler_without_hang_limit_is_never_replaced(player: Player) -> None:
    player.module("arms", "command lift", capacity=1)
    task = player.task("user", "lift")
    player.request("user", headers.Kill, TaskId(task))
    pass_time(player, 10_000.0)
    assert player.central.tree.tasks[task].killed
    assert player.central.clock.next is None


def test_replacement_is_requested_again_after_reconnect(player: Player) -> None:
    task = player.task("user", "move")
    player.request("user", headers.Kill, TaskId(task))
    pass_time(player, AFTER + 1)
    player.inbox["legs"].clear()
    sent = player.hello("legs back", "legs", incarnation="run of legs")
    assert any(isinstance(one, headers.Replace) for one in sent)
