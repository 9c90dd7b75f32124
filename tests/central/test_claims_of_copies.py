"""A lock or reservation covers all copies of a program that runs several times."""

from central.player import Player
from hypothesis import given, settings
from hypothesis import strategies as st
from tools.runs import OPENED, checked

from tca_wire.constraints import Flags
from tca_wire.packets import headers
from tca_wire.packets.parts import HandlerFormat


def join(player: Player, connection: str, *, pool: str = "") -> None:
    """Let one more copy of the legs' program join, with one slot."""
    incarnation = f"run of {connection}"
    player.hello(connection, "legs", incarnation=incarnation)
    handled = [HandlerFormat("move", "legs", pool)]
    player.request(connection, headers.Register, [player.format("command move")], handled)
    player.hello(f"{connection}/1", "legs", "legs", incarnation)


def lock(player: Player, connection: str, *, reserve: bool = False) -> int:
    """Claim the legs. Return the number of the request."""
    number = player.number(connection)
    player.receive(connection, headers.Lock(number, "legs", reserve=reserve))
    return number


def is_granted(player: Player, connection: str, number: int) -> bool:
    return any(
        isinstance(one, headers.Answer) and one.number == number
        for one, _ in player.inbox[connection]
    )


CLIENTS = ("one", "two", "three")
OPERATIONS = ("join", "pool", "lose", "move", "reply", "lock", "reserve", "release")


@given(st.lists(st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 7)), max_size=60))
@settings(max_examples=50)
def test_claims_hold_for_all_copies_in_random_lives(life: list[tuple[str, int]]) -> None:
    """The invariants are checked after each event. At the end no task is left, and the journal
    passes all checks.
    """
    player, joined = Player(), 0
    wanted: list[tuple[str, int]] = []
    for client in ("user", *CLIENTS):
        player.module(client)
    player.declare("user", "command move")
    copies: list[str] = []
    for name, choice in [*life, ("join", 0)]:
        if name in ("join", "pool"):
            joined += 1
            copies.append(f"copy{joined}")
            join(player, copies[-1], pool=name if name == "pool" else "")
        elif name == "lose" and copies:
            lost_copy = copies.pop(choice % len(copies))
            for connection in (f"{lost_copy}/1", lost_copy)[:: 1 if choice > 3 else -1]:
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
            player.request(client, headers.Release, number)
    for client, number in wanted:
        player.request(client, headers.Release, number)
    while busy := [one for one in copies if player.delivered(f"{one}/1")]:
        player.reply(f"{busy[0]}/1")
    assert not player.central.claims
    assert not player.central.tree.tasks
    assert not checked([OPENED, *player.entries])
