"""Inputs that no central has written: they are none, or lead to nothing."""

import msgspec
import pytest

from tca_central.events import Arrived, ConnectionId, Input, RequestReceived, Tick
from tca_central.inputs import events_of
from tca_wire.packets.codec import pack_item
from tca_wire.packets.headers import Ask


@pytest.mark.parametrize("time", [float("nan"), float("inf"), -1.0, 1e300])
def test_an_input_at_a_time_that_is_none_is_no_input(time: float) -> None:
    """A monitor that is to test every second would test for ever."""
    with pytest.raises(msgspec.ValidationError):
        msgspec.msgpack.decode(msgspec.msgpack.encode(Tick(time)), type=Input)


def test_a_request_that_is_not_there_is_not_spared() -> None:
    arrived = Arrived(1.0, ConnectionId(b"user"), pack_item(Ask(1, "status")))
    assert [type(one) for one in events_of(arrived, spared=7)] == [RequestReceived]
