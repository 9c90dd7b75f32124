"""Variables: the limit of their total size, and their fate after a new declaration."""

import msgspec
import pytest
from central.player import Player

from tca_wire.journal.facts import Dropped
from tca_wire.packets import headers
from tca_wire.packets.headers import Answer
from tca_wire.packets.parts import MessageFormat
from tca_wire.vocabulary import MessageClass, Refusal


def get(player: Player, module: str, variable: str) -> bytes:
    answer, *_ = player.request(module, headers.GetVariable, variable)
    assert isinstance(answer, Answer), answer
    return player.inbox[module][-1][1]


def declare(player: Player, module: str, data: str) -> None:
    formats = [MessageFormat("pose", MessageClass.VARIABLE, data)]
    player.request(module, headers.Register, formats)


@pytest.fixture
def player() -> Player:
    player = Player.of("user")
    player.declare("user", "variable pose", "variable map")
    return player


def test_bytes_of_all_variables_are_limited(player: Player) -> None:
    player.central.budget.variables = 20
    player.set_variable("user", "pose", "x" * 9)
    player.set_variable("user", "map", "x" * 9)
    (answer,) = player.set_variable("user", "map", "x" * 10)
    assert answer.refusal is Refusal.OVERLOAD
    assert answer.text == "with 11 bytes in 'map' all variables would hold 21: 20 are allowed"
    assert get(player, "user", "map") == msgspec.msgpack.encode("x" * 9)
    player.set_variable("user", "pose", 1)
    player.set_variable("user", "map", "x" * 10)
    assert get(player, "user", "map") == msgspec.msgpack.encode("x" * 10)


@pytest.mark.parametrize(
    ("data", "is_kept"),
    [
        ('{"type":"integer","description":"metres"}', True),
        ('{"type":"string"}', False),
    ],
)
def test_value_is_forgotten_when_redeclared_with_another_format(
    player: Player, data: str, is_kept: bool
) -> None:
    player.set_variable("user", "pose", 1)
    player.receive("user", headers.Bye())
    player.module("other")
    declare(player, "other", data)
    assert (get(player, "other", "pose") != b"") is is_kept
    assert [fact.why for fact in player.facts(Dropped)] == (
        [] if is_kept else ["its variable was declared again with another format"]
    )
