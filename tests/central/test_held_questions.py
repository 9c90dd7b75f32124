"""After a restart of central no task starts before all are back; questions are answered meanwhile."""

from central.player import Player

from tca_central.events import Restarted
from tca_wire.packets import headers
from tca_wire.points import TaskId


def restarted() -> Player:
    """Legs and user are back, a third is not."""
    player = Player.of("legs: command move, query stance", "idle", "user")
    player.event(Restarted(player.time, 1.0, 10.0))
    for connection, module, number in (("legs", "legs", 0), ("legs/1", "legs", 1), ("user", "user", 0)):
        resource = module if number else ""
        hello = headers.Hello(0, headers.PROTOCOL_VERSION, module, f"run of {module}", number, resource, "here:1")
        player.receive(connection, hello)
    assert player.central.dispatcher.is_holding
    return player


def test_a_question_passes_tasks_that_may_not_start() -> None:
    player = restarted()
    move = player.task("user", "move")
    assert not player.delivered("legs/1")
    player.send("user", "stance")
    player.send("user", "stance")
    for _ in range(2):
        (question,) = player.delivered("legs/1")
        assert question != move
        player.reply("legs/1", question, 3)
    assert not player.delivered("legs/1")
    player.receive("user", headers.GoOn(player.number("user")))
    assert player.delivered("legs/1") == [move]


def test_a_question_passes_a_claim_no_more_than_otherwise() -> None:
    player = restarted()
    move = player.task("user", "move")
    lock = player.number("user")
    player.receive("user", headers.Lock(lock, "legs", "legs"))
    player.send("user", "stance")
    assert not player.delivered("legs/1")
    player.receive("user", headers.Kill(player.number("user"), TaskId(move)))
    assert not player.delivered("legs/1")
    player.receive("user", headers.GiveUp(lock))
    assert len(player.delivered("legs/1")) == 1
