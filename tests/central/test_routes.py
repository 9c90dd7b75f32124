"""Direct routes. Central gives them to senders, and withdraws them."""

from typing import Any

import pytest
from central.player import IN_PYTHON, Player

from tca_central.events import AccessRule, KeysChanged, PermissionsChanged
from tca_central.outgoing import direct_routes
from tca_wire.packets import headers
from tca_wire.packets.licences import number_of
from tca_wire.packets.parts import HandlerFormat
from tca_wire.packets.routes import Barred, Entrance, EntranceGone, Loss, Note, Noted, Route
from tca_wire.vocabulary import Condition, Permission, Refusal


@pytest.fixture
def player() -> Player:
    """Return a player with a map that has direct handlers. The user got its route with a first
    query.
    """
    player = Player()
    player.module("map", "query height", "inform pose", direct=True)
    player.module("user")
    player.send("user", "height")
    player.reply("map/1")
    return player


def drain_routes(player: Player, connection: str = "user") -> list[Any]:
    """Return the routes that central sent to a connection, and clear the connection's inbox."""
    inbox = player.inbox[connection]
    found = [header for header, _ in inbox if isinstance(header, Route | EntranceGone)]
    inbox.clear()
    return [to_words(header) for header in found]


def to_words(header: Route | EntranceGone) -> str:
    if isinstance(header, EntranceGone):
        return f"{header.endpoint.removeprefix('ipc:///')} is {'lost' if header.lost else 'gone'}: {header.text}"
    return f"{header.message} to {[entrance.endpoint.removeprefix('ipc:///') for entrance in header.entrances]}"


def tap(player: Player) -> int:
    number = player.number("tapper")
    header = headers.Tap(number, Condition.WHEN_SENT, "heard", "height")
    (answer,) = [
        one for one in player.receive("tapper", header) if isinstance(one, headers.Accepted)
    ]
    return answer.id


def test_resource_sends_to_itself_through_central(player: Player) -> None:
    """The slot handles its own query within its wait. The delivery is marked `own`, because the
    slot may be busy without central's knowledge.
    """
    player.declare("map/1", "query height")
    (route, delivery) = player.send("map/1", "height")
    assert (to_words(route), delivery.own) == ("height to []", True)
    player.reply("map/1")
    (delivery,) = player.send("user", "height")
    assert not delivery.own


@pytest.mark.parametrize(
    ("header", "refusal"),
    [
        (Noted([Note("un\nheard of", "user", 0, 1, 0, 0)]), Refusal.PROTOCOL),
        (Noted([Note("height", "user", 0, 1, float("nan"), 0)]), Refusal.PROTOCOL),
        (Noted([Note("height", "user", 0, 1, 0, -1)]), Refusal.PROTOCOL),
        (Noted([Note("height", "user", 0, 1, 0, 0)], [Loss("x" * 129, 1)]), Refusal.PROTOCOL),
        (Noted([Note("height", "user", 0, 1, 0, 0)] * 2001), Refusal.OVERLOAD),
        (headers.Register(1000, [], [HandlerFormat("walk", "map", direct=True)]), Refusal.PROTOCOL),
    ],
)
def test_invalid_direct_request_is_refused_without_effect(
    player: Player, header: Any, refusal: Refusal
) -> None:
    player.declare("map/1", "command walk")
    player.entries.clear()
    (answer,) = player.receive("map/1", header)
    assert answer.refusal is refusal
    assert [type(fact).__name__ for fact in player.entries[-1].facts] == ["RequestRefused"]


@pytest.mark.parametrize("endpoint", ["inproc://x", "ipc:///a\nb", "tcp://" + "x" * 300])
def test_entrance_with_invalid_address_is_refused(endpoint: str) -> None:
    player = Player()
    hello = headers.Hello(
        1, headers.PROTOCOL_VERSION, "map", "run", 1, "map", "here:1", Entrance(endpoint, "key")
    )
    (answer,) = player.receive("map/1", hello)
    assert answer.refusal is Refusal.PROTOCOL


def test_lost_sender_leaves_no_route_state(player: Player) -> None:
    drain_routes(player)
    player.lose("user")
    message = player.central.registry.messages["height"]
    (slot,) = message.route
    assert not message.informed_senders
    assert not slot.watchers


# --- licences -------------------------------------------------------------------------------------


def robot() -> Player:
    """Return a player with two senders that have keys of their own, and a route to the same map."""
    player = Player()
    player.principals |= {"a": "a", "b": "b"}
    player.module("map", "query height", direct=True)
    for name in ("a", "b"):
        player.module(name)
        player.send(name, "height")
    return player


def licences(player: Player, name: str) -> list[list[str]]:
    """Return the licences in each route that central sent to a sender."""
    routes = [header for header, _ in player.inbox[name] if isinstance(header, Route)]
    return [
        [number_of(one.key, "key of map/1") or "forged" for one in route.entrances]
        for route in routes
    ]


def barred(player: Player) -> list[str]:
    """Return the licences that central has told the map's slot to refuse."""
    return [
        one
        for header, _ in player.inbox["map/1"]
        if isinstance(header, Barred)
        for one in header.numbers
    ]


def test_each_sender_gets_its_own_licence_and_no_key() -> None:
    player = robot()
    assert (licences(player, "a"), licences(player, "b")) == ([["test.1"]], [["test.2"]])
    assert "key of map/1" not in str(player.inbox["a"])


def test_revoked_key_ends_licences_of_lost_senders_too() -> None:
    player = robot()
    player.lose("a")
    player.event(KeysChanged(60.0, [], ["a"]))
    assert barred(player) == ["test.1"]
    player.hello("map/1", "map", "map", direct=True)  # a slot that was lost may have missed the bar
    assert licences(player, "b") == [["test.2"]]
    assert barred(player) == ["test.1"] * 2


def test_revoked_key_gets_no_new_licence_while_connected() -> None:
    player = robot()
    player.event(KeysChanged(60.0, [], ["a"]))
    assert licences(player, "a") == [["test.1"]]


def test_licence_is_withdrawn_with_the_permission_to_send() -> None:
    rule = AccessRule(("a",), allowed=((Permission.SEND, ("height",)),))
    everything = AccessRule(("owner", "b"), allowed=tuple((one, ("*",)) for one in Permission))
    player = robot()
    player.event(PermissionsChanged(60.0, (rule, everything)))
    assert barred(player) == []
    player.event(PermissionsChanged(61.0, (AccessRule(("a",)), everything)))
    assert barred(player) == ["test.1"]
    assert licences(player, "a") == [["test.1"], []]
    player.event(PermissionsChanged(62.0, None))
    player.hello("a")
    player.send("a", "height")
    assert licences(player, "a")[-1] == ["test.3"], "a withdrawn licence is never given again"


def test_slot_with_forbidden_messages_gives_no_licence() -> None:
    player = Player()
    rule = AccessRule(("a",), allowed=((Permission.SEND, ("height",)),))
    owner = AccessRule(("owner",), allowed=tuple((one, ("*",)) for one in Permission))
    player.event(PermissionsChanged(0.0, (rule, owner)))
    player.principals |= {"a": "a"}
    player.module("map", "query height", "inform erase", direct=True)
    player.module("a")
    player.send("a", "height")
    assert licences(player, "a") == [[]]


@IN_PYTHON
def test_oldest_licence_is_barred_beyond_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(direct_routes, "MOST_LICENCES", 1)
    assert barred(robot())[:1] == ["test.1"]
