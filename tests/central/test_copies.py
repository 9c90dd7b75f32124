"""A program that runs in several copies: a lock or reservation is for all of them."""

import pytest
from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from tools.runs import OPENED, checked

from tca_wire.constraints import Flags
from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.parts import HandlerFormat


@pytest.fixture
def robot() -> Player:
    return Player.of("legs: command move", "user", "other")


def join(player: Player, connection: str, *, pool: str = "") -> None:
    """One more copy of the legs' program, with one slot."""
    incarnation = f"run of {connection}"
    player.hello(connection, "legs", incarnation=incarnation)
    handled = [HandlerFormat("move", "legs", pool)]
    player.receive(connection, headers.Register(player.number(connection), [player.format("command move")], handled))
    player.hello(f"{connection}/1", "legs", "legs", incarnation)


def lock(player: Player, connection: str, *, reserve: bool = False) -> int:
    """Want the legs; the number of the request."""
    number = player.number(connection)
    player.receive(connection, headers.Lock(number, "legs", reserve=reserve))
    return number


def is_granted(player: Player, connection: str, number: int) -> bool:
    return any(isinstance(one, headers.Answer) and one.number == number for one, _ in player.inbox[connection])


def test_a_copy_that_comes_is_locked_too(robot: Player) -> None:
    mine = lock(robot, "user")
    assert is_granted(robot, "user", mine)
    robot.task("user", "move")
    join(robot, "new")
    assert not robot.delivered("legs/1") + robot.delivered("new/1")
    robot.receive("user", headers.Release(robot.number("user"), mine))
    assert robot.delivered("new/1") == [2]


def test_all_copies_are_waited_for(robot: Player) -> None:
    first = robot.task("user", "move")
    join(robot, "new")
    second = robot.task("user", "move", flags=Flags.NONE)
    assert (robot.delivered("legs/1"), robot.delivered("new/1")) == ([first], [second])
    mine = lock(robot, "user")
    robot.task("user", "move", flags=Flags.NONE)
    robot.reply("new/1")
    assert not is_granted(robot, "user", mine), "the older copy still moves"
    assert not robot.delivered("new/1"), "who wants a lock goes before what comes later"
    robot.reply("legs/1")
    assert is_granted(robot, "user", mine)


def test_a_lock_outlives_the_copy_that_it_was_asked_of(robot: Player) -> None:
    join(robot, "new")
    mine = lock(robot, "user")
    waits = lock(robot, "other")
    robot.lose("new/1")
    robot.lose("new")
    robot.task("user", "move")
    assert not robot.delivered("legs/1")
    robot.receive("user", headers.Release(robot.number("user"), mine))
    assert is_granted(robot, "other", waits)
    assert not robot.facts(facts.RequestRefused)


def test_with_the_last_copy_it_is_lost(robot: Player) -> None:
    join(robot, "new")
    lock(robot, "user")
    for gone in ("legs/1", "legs", "new/1", "new"):
        robot.lose(gone)
    assert [fact.why for fact in robot.facts(facts.ClaimEnded)] == ["module 'legs#2' has gone: its connection closed"]


def test_a_lock_gets_in_when_the_message_before_it_is_given_up(robot: Player) -> None:
    robot.module("map", "query where", capacity=0)
    robot.send("user", "where")
    number = robot.number("other")
    robot.receive("other", headers.Lock(number, "map"))
    assert not is_granted(robot, "other", number)
    robot.receive("user", headers.GiveUp(robot.numbers["user"]))
    assert is_granted(robot, "other", number)


CLIENTS = ("one", "two", "three")
OPERATIONS = ("join", "pool", "lose", "move", "reply", "lock", "reserve", "release")


@given(st.lists(st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 7)), max_size=60))
@settings(max_examples=50)
def test_whatever_comes_and_goes_nobody_is_let_in(life: list[tuple[str, int]]) -> None:
    """The invariants are looked at after each event; in the end all is handled, and the journal says nothing else."""
    player, made = Player(), 0
    wanted: list[tuple[str, int]] = []
    for client in ("user", *CLIENTS):
        player.module(client)
    player.declare("user", "command move")
    copies: list[str] = []
    for name, choice in [*life, ("join", 0)]:
        if name in ("join", "pool"):
            made += 1
            copies.append(f"copy{made}")
            join(player, copies[-1], pool=name if name == "pool" else "")
        elif name == "lose" and copies:
            gone = copies.pop(choice % len(copies))
            for connection in (f"{gone}/1", gone)[:: 1 if choice > 3 else -1]:
                player.lose(connection)
        elif name == "move":
            player.send(("user", *CLIENTS)[choice % 4], "move", flags=Flags.NONE)
        elif name == "reply" and (busy := [one for one in copies if player.delivered(f"{one}/1")]):
            player.reply(f"{busy[choice % len(busy)]}/1")
        elif name in ("lock", "reserve") and copies:
            client = CLIENTS[choice % len(CLIENTS)]
            wanted.append((client, lock(player, client, reserve=name == "reserve")))
        elif name == "release" and wanted:
            client, number = wanted.pop(choice % len(wanted))
            player.receive(client, headers.Release(player.number(client), number))
    for client, number in wanted:
        player.receive(client, headers.Release(player.number(client), number))
    while busy := [one for one in copies if player.delivered(f"{one}/1")]:
        player.reply(f"{busy[0]}/1")
    assert not player.central.claims
    assert not player.central.tree.tasks
    assert not checked([OPENED, *player.entries])
