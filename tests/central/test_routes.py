"""Who is told that a message may go directly, and when it must not any more."""

from collections.abc import Callable
from typing import Any

import pytest
from central.player import IN_PYTHON, Player

from tca_central.events import AccessRule, KeysChanged, PermissionsChanged
from tca_central.outgoing import direct_routes
from tca_wire.journal.facts import HandledDirectly, LostDirectly
from tca_wire.packets import headers
from tca_wire.packets.licences import number_of
from tca_wire.packets.parts import HandlerFormat
from tca_wire.packets.routes import Barred, Entrance, EntranceGone, Loss, Note, Noted, Route, WatchEntrance
from tca_wire.vocabulary import Condition, Outcome, Permission, Refusal


@pytest.fixture
def player() -> Player:
    """A map that takes queries directly, and a user who has asked once and knows it."""
    player = Player()
    player.module("map", "query height", "inform pose", direct=True)
    player.module("user")
    player.send("user", "height")
    player.reply("map/1")
    return player


def told(player: Player, connection: str = "user") -> list[Any]:
    """What a connection was told of routes, and forget it."""
    inbox = player.inbox[connection]
    found = [header for header, _ in inbox if isinstance(header, Route | EntranceGone)]
    inbox.clear()
    return [to_words(header) for header in found]


def to_words(header: Route | EntranceGone) -> str:
    if isinstance(header, EntranceGone):
        return f"{header.endpoint.removeprefix('ipc:///')} is {'lost' if header.lost else 'gone'}: {header.text}"
    return f"{header.message} to {[entrance.endpoint.removeprefix('ipc:///') for entrance in header.entrances]}"


def test_who_sends_through_central_is_told_once(player: Player) -> None:
    assert told(player) == ["height to ['map/1']"]
    player.send("user", "height")
    player.send("user", "pose")
    player.send("user", "pose")
    assert told(player) == ["pose to ['map/1']"]


def test_whoever_has_not_sent_it_is_not_told(player: Player) -> None:
    player.module("other")
    player.declare("other", "query height")
    player.module("tapper", "inform heard")
    tap(player)
    assert told(player, "other") == []


def tap(player: Player) -> int:
    number = player.number("tapper")
    header = headers.Tap(number, Condition.WHEN_SENT, "heard", "height")
    (answer,) = [one for one in player.receive("tapper", header) if isinstance(one, headers.Accepted)]
    return answer.id


def test_a_wiretap_takes_the_route_away_as_long_as_it_lasts(player: Player) -> None:
    player.module("tapper", "inform heard")
    told(player)
    one, other = tap(player), tap(player)
    assert one == other
    assert told(player) == ["height to []"]
    player.receive("tapper", headers.Remove(player.number("tapper"), one))
    assert told(player) == ["height to ['map/1']"]


def test_a_newer_handler_takes_over_and_gives_back(player: Player) -> None:
    told(player)
    player.module("new map", "query height")
    assert told(player) == ["height to []"]
    player.receive("new map", headers.Unregister(player.number("new map"), []))
    assert told(player) == ["height to ['map/1']"]
    player.module("third map", "query height", direct=True)
    assert told(player) == ["height to []", "height to ['third map/1']"]  # it registers before its slot is there


def test_handlers_that_share_a_message_need_central() -> None:
    player = Player()
    player.module("one", "query height", pool="maps", direct=True)
    player.module("user")
    player.send("user", "height")
    assert told(player) == ["height to ['one/1']"]
    player.module("two", "query height", pool="maps", direct=True)
    assert told(player) == ["height to []"]
    player.receive("two", headers.Unregister(player.number("two"), []))
    assert told(player) == ["height to ['one/1']"]


def test_a_pending_limit_needs_central() -> None:
    player = Player()
    player.module("map", "query height", pending=3, direct=True)
    player.module("user")
    player.send("user", "height")
    assert told(player) == []


def test_all_slots_of_a_resource_take_part(player: Player) -> None:
    told(player)
    player.hello("map/2", "map", "map", direct=True)
    assert told(player) == ["height to ['map/1', 'map/2']"]
    player.lose("map/1")
    assert told(player) == ["height to ['map/2']", "map/1 is lost: module 'map' was lost: its connection closed"]
    player.hello("map/3", "map", "map")
    assert told(player) == ["height to []"]  # that one has no entrance, and must not be idle


def leaves(player: Player) -> None:
    player.receive("map", headers.Unregister(player.number("map"), []))
    player.receive("map/1", headers.Bye())
    player.receive("map", headers.Bye())


def dies(player: Player) -> None:
    player.lose("map/1")
    player.lose("map")


@pytest.mark.parametrize(("end", "word"), [(leaves, "gone"), (dies, "lost")])
def test_the_end_of_a_slot_is_told(player: Player, end: Callable[[Player], None], word: str) -> None:
    told(player)
    end(player)
    route, gone = told(player)
    assert route == "height to []"
    assert gone.startswith(f"map/1 is {word}: module 'map' was lost: ")
    assert not player.central.registry.messages["height"].route


def test_a_resource_asks_itself_through_central(player: Player) -> None:
    """Its slot handles the question inside of its wait; and is told so, for it may be busy and central not know."""
    player.declare("map/1", "query height")
    (route, delivery) = player.send("map/1", "height")
    assert (to_words(route), delivery.own) == ("height to []", True)
    player.reply("map/1")
    (delivery,) = player.send("user", "height")
    assert not delivery.own


def test_who_comes_back_is_told_anew_and_learns_what_it_missed(player: Player) -> None:
    told(player)
    player.hello("user")  # as after a break that central has not noticed
    player.module("tapper", "inform heard")
    tapped = tap(player)
    assert told(player) == []
    player.receive("tapper", headers.Remove(player.number("tapper"), tapped))
    player.receive("user", WatchEntrance("ipc:///map/1"))
    player.receive("user", WatchEntrance("ipc:///elsewhere"))
    assert told(player) == ["elsewhere is lost: the module was lost meanwhile"]
    player.send("user", "height")
    assert told(player) == ["height to ['map/1']"]
    player.lose("map/1")
    assert told(player) == ["height to []", "map/1 is lost: module 'map' was lost: its connection closed"]


def test_notes_become_facts(player: Player) -> None:
    note = Note("height", "user", 3, 12, 0.5, 0.25, Outcome.FAILED, "handler error")
    player.receive("map/1", Noted([note], [Loss("pose", 2), Loss("", 1)]))
    assert player.entries[-1].facts == [
        HandledDirectly(
            "height", "map", "map", "user", 3, 12, player.time - 0.5, 0.25, Outcome.FAILED, "handler error"
        ),
        LostDirectly("map", "pose", 2),
        LostDirectly("map", "", 1),
    ]


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
def test_nonsense_is_refused_and_leaves_nothing(player: Player, header: Any, refusal: Refusal) -> None:
    player.declare("map/1", "command walk")
    player.entries.clear()
    (answer,) = player.receive("map/1", header)
    assert answer.refusal is refusal
    assert [type(fact).__name__ for fact in player.entries[-1].facts] == ["RequestRefused"]


@pytest.mark.parametrize("endpoint", ["inproc://x", "ipc:///a\nb", "tcp://" + "x" * 300])
def test_an_entrance_has_an_address(endpoint: str) -> None:
    player = Player()
    hello = headers.Hello(1, headers.PROTOCOL_VERSION, "map", "run", 1, "map", "here:1", Entrance(endpoint, "key"))
    (answer,) = player.receive("map/1", hello)
    assert answer.refusal is Refusal.PROTOCOL


def test_nothing_is_left_of_those_who_go(player: Player) -> None:
    told(player)
    player.lose("user")
    message = player.central.registry.messages["height"]
    (slot,) = message.route
    assert not message.senders_told
    assert not slot.watchers


def test_while_a_resource_is_locked_or_wanted_everything_goes_through_central(player: Player) -> None:
    told(player)
    number = player.number("user")
    player.receive("user", headers.Lock(number, "map"))
    assert told(player) == ["height to []"]
    player.receive("user", headers.GiveUp(number))
    assert told(player) == ["height to ['map/1']"]


# --- licences --------------------------------------------------------------------------------------------------------


def robot() -> Player:
    """Two senders that know the way to a map, with keys of their own."""
    player = Player()
    player.principals |= {"a": "a", "b": "b"}
    player.module("map", "query height", direct=True)
    for name in ("a", "b"):
        player.module(name)
        player.send(name, "height")
    return player


def licences(player: Player, name: str) -> list[list[str]]:
    """By what a sender may send, of each route that it was told of."""
    routes = [header for header, _ in player.inbox[name] if isinstance(header, Route)]
    return [[number_of(one.key, "key of map/1") or "forged" for one in route.entrances] for route in routes]


def barred(player: Player) -> list[str]:
    return [one for header, _ in player.inbox["map/1"] if isinstance(header, Barred) for one in header.numbers]


def test_each_sender_has_a_licence_of_its_own_and_nobody_the_key() -> None:
    player = robot()
    assert (licences(player, "a"), licences(player, "b")) == ([["test.1"]], [["test.2"]])
    assert "key of map/1" not in str(player.inbox["a"])


def test_a_revoked_key_ends_its_licences_also_of_those_who_are_away() -> None:
    player = robot()
    player.lose("a")
    player.event(KeysChanged(60.0, [], ["a"]))
    assert barred(player) == ["test.1"]
    player.hello("map/1", "map", "map", direct=True)  # a slot that comes back may not have heard it
    assert licences(player, "b") == [["test.2"]]
    assert barred(player) == ["test.1"] * 2


def test_a_revoked_key_gets_no_new_licence_while_its_line_is_there() -> None:
    player = robot()
    player.event(KeysChanged(60.0, [], ["a"]))
    assert licences(player, "a") == [["test.1"]]


def test_who_may_not_send_all_that_a_slot_takes_sends_through_central() -> None:
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
    assert licences(player, "a")[-1] == ["test.3"], "a licence that was withdrawn is never given again"


def test_a_slot_that_takes_more_than_one_may_send_is_closed_to_him() -> None:
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
def test_licences_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(direct_routes, "MOST_LICENCES", 1)
    assert barred(robot())[:1] == ["test.1"]
