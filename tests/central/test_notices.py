"""Names and formats of central's own messages are central's."""

import pytest
from central.player import ANY, Player

from tca_wire.messages.notices import MODULE_LEFT, NOTICES
from tca_wire.packets import headers
from tca_wire.packets.headers import Refused
from tca_wire.packets.parts import MessageFormat
from tca_wire.vocabulary import MessageClass


def declare(player: Player, *formats: MessageFormat) -> Refused:
    (answer,) = player.receive("user", headers.Register(player.number("user"), list(formats)))
    assert isinstance(answer, Refused)
    return answer


@pytest.fixture
def player() -> Player:
    player = Player()
    player.module("user")
    return player


def test_a_notice_is_declared_as_central_has_it(player: Player) -> None:
    other_class = MessageFormat(MODULE_LEFT.name, MessageClass.INFORM, MODULE_LEFT.format.data)
    assert declare(player, other_class).text == (
        "two formats for message 'tca: module left': a inform here, a broadcast there "
        "(here = module 'user', there = central)"
    )
    other_data = MessageFormat(MODULE_LEFT.name, MessageClass.BROADCAST, ANY)
    assert "data $: integer here, " in declare(player, other_data).text


def test_no_other_name_begins_like_a_notice(player: Player) -> None:
    refused = declare(player, MessageFormat("tca: module slept", MessageClass.INFORM, ANY))
    assert refused.text == (
        "'tca: module slept': names that begin with 'tca: ' are central's own, and it sends no such notice"
    )


@pytest.mark.parametrize("number", [0, 7])
def test_only_central_sends_notices(player: Player, number: int) -> None:
    player.receive("user", headers.Register(player.number("user"), [notice.format for notice in NOTICES.values()]))
    for name in NOTICES:
        (answer,) = player.receive("user", headers.Send(number and player.number("user"), name))
        assert answer.text == f"'{name}' is a notice: only central sends it"


def test_waits_for_handlers_are_bounded(player: Player) -> None:
    (answer,) = player.receive("user", headers.WaitUntilHandled(player.number("user"), ["a"] * 1001))
    assert answer.text == "1001 messages in one wait: 1000 are allowed, send several requests"
    (answer,) = player.receive("user", headers.WaitUntilHandled(0, ["a"]))
    assert answer.text == "a wait until messages are handled needs a request number"
    (answer,) = player.receive("user", headers.WaitUntilHandled(player.number("user"), []))
    assert isinstance(answer, headers.Answer)
