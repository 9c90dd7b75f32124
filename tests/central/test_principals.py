"""Whose a connection is: nobody takes over what somebody else has, whatever he knows of it."""

import pytest
from central.player import Player

from tca_wire.journal import facts
from tca_wire.packets import headers
from tca_wire.packets.headers import Deliver, Refused, Unknown, Welcome
from tca_wire.vocabulary import Refusal


def player() -> Player:
    made = Player()
    made.principals |= {"arm": "arm", "arm/1": "arm", "thief": "thief"}
    made.module("arm", "command grip")
    return made


def refusals(sent: list[object]) -> list[Refusal]:
    return [header.refusal for header in sent if isinstance(header, Refused)]


def test_a_module_joins_with_its_principal() -> None:
    joined = [fact for entry in player().entries for fact in entry.facts if isinstance(fact, facts.ModuleJoined)]
    assert [(fact.module, fact.principal) for fact in joined] == [("arm", "arm")]


def test_nobody_takes_over_the_session_of_somebody_else() -> None:
    central = player()
    for number in range(3):
        hello = headers.Hello(1, headers.PROTOCOL_VERSION, "arm", "run of arm", number, "arm" if number else "")
        assert refusals(central.receive("thief", hello)) == [Refusal.FORBIDDEN]
    assert {one.principal for one in central.central.registry.connections.values()} == {"arm"}
    assert not any(isinstance(header, Deliver) for header, _ in central.inbox["thief"])


def test_nor_what_a_lost_connection_leaves_behind() -> None:
    central = player()
    for name in ("arm", *[name for name in central.inbox if name.startswith("arm/")]):
        central.lose(name)
    hello = headers.Hello(1, headers.PROTOCOL_VERSION, "arm", "run of arm")
    assert refusals(central.receive("thief", hello)) == [Refusal.FORBIDDEN]
    assert any(isinstance(header, Welcome) for header in central.receive("arm", hello)), "who had it gets it back"


@pytest.mark.parametrize("said", [headers.Unregister(9, []), headers.Bye(), headers.Reply(1), headers.Lock(9, "arm")])
def test_a_line_that_calls_itself_like_one_of_somebody_else_has_no_say(said: object) -> None:
    """A line can have the name of one that is gone before central has noticed that it is."""
    central = player()
    central.principals["arm/1"] = "thief"
    assert [type(one) for one in central.receive("arm/1", said)] == [Unknown]
    central.principals["arm/1"] = "arm"
    assert not any(isinstance(header, Deliver) for header, _ in central.inbox["arm/1"])
    assert central.central.registry.messages["grip"].handlers
    changed = [fact for fact in central.facts(facts.ResourceChanged) if fact.resource == "arm"]
    assert [fact.capacity for fact in changed] == [1, 0], "the slot counts as lost"
