"""How a deadline ran out, step by step: what was waited for, and who had that when time was up."""

from central.player import Player

from tca_tools.run.fold import History
from tca_tools.tasktree_viz.failing import failure_chain
from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.points import TaskId


def playing() -> Player:
    player = Player()
    player.module("baker", "goal bake")
    player.module("oven", "command heat")
    player.module("user")
    return player


def steps(player: Player, number: int, moment: float | None = None) -> list[str]:
    run = History.until(player.entries)
    links = failure_chain(run, TaskId(number), run.time if moment is None else moment)
    return ["  " * one.depth + one.text for one in links]


def test_who_handled_what_was_waited_for_when_time_ran_out() -> None:
    player = playing()
    bake = player.task("user", "bake", deadline=20.0)
    player.task("baker/1", "heat", under=bake, flags=Flags(0))
    player.reply("baker/1")
    player.receive("user", headers.Suspend(player.number("user"), TaskId(bake)))
    player.tick(2.0)
    player.receive("user", headers.Suspend(player.number("user"), TaskId(bake), resume=True))
    before = player.time
    player.tick(30.0)
    assert steps(player, bake)[:3] == [
        "  heat {2} was being handled by oven, for 35 s when time ran out",
        "bake {1} was suspended by user, for 3 s",
        "bake {1} waited until heat {2} is achieved, for 30 s",
    ]
    assert steps(player, bake, before) == [], "nobody knew that time would run out"


def test_who_had_locked_what_was_waited_for() -> None:
    player = playing()
    player.receive("user", headers.Lock(player.number("user"), "oven"))
    heat = player.task("user", "heat", deadline=20.0)
    player.tick(30.0)
    assert steps(player, heat)[:2] == [
        "  user had the lock of oven {1}, for 31 s when time ran out",
        "heat {2} waited for oven, which user has locked, for 30 s",
    ]


def test_its_own_handler_was_at_it() -> None:
    player = playing()
    bake = player.task("user", "bake", deadline=20.0)
    player.tick(30.0)
    assert steps(player, bake)[0] == "bake {1} was being handled by baker, for 30 s when time ran out"
