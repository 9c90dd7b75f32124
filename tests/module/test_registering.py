"""Declarations are divided into requests that central takes, in an order in which each can stand alone."""

import pytest

from tca_module.session.registering import registers
from tca_wire.packets import codec
from tca_wire.packets.headers import Register
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import Limit, MessageClass


@pytest.mark.parametrize(("number", "size", "expected"), [(0, 0, 1), (500, 40, 1), (1200, 40, 6), (9, 200_000, 6)])
def test_any_number_of_declarations_is_taken(number: int, size: int, expected: int) -> None:
    messages = [MessageFormat(f"m{one}", MessageClass.INFORM, "x" * size) for one in range(number)]
    handlers = [HandlerFormat(message.name, "r") for message in messages] if expected > 1 else []
    found = registers(messages, handlers, is_ready=True)
    assert len(found) == expected
    assert [message for one in found for message in one.messages] == messages
    assert [handled for one in found for handled in one.handlers] == handlers
    assert [one.is_ready for one in found] == [False] * (expected - 1) + [True]
    declared: set[str] = set()
    for one in found:
        declared |= {message.name for message in one.messages}
        assert {handled.message for handled in one.handlers} <= declared
    packets = codec.packets([(one, b"") for one in found])
    taken = [header for _, packet in packets for header, _ in codec.unpack_to_central(packet)]
    assert taken == found
    assert all(isinstance(one, Register) and len(one.messages) <= Limit.LIST for one in taken)
