"""While the disk of the journal is nearly full no new task is taken; all else goes on."""

from central.player import Player

from tca_central.events import DiskSpace
from tca_wire.packets import headers


def test_no_task_is_taken_before_there_is_room() -> None:
    player = Player.of("legs: command move, query where", "user")
    running = player.task("user", "move")
    player.event(DiskSpace(player.time, is_low=True))
    (refused,) = player.send("user", "move")
    assert refused.text == "the disk of central's journal is nearly full: no command is taken before there is room"
    player.reply("legs/1", running)
    player.send("user", "where")
    assert any(isinstance(one, headers.Deliver) for one, _ in player.inbox["legs/1"])
    player.reply("legs/1")
    player.event(DiskSpace(player.time, is_low=False))
    assert player.task("user", "move")
