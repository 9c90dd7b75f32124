"""Inputs that no central has written: they are none, or lead to nothing."""

from collections.abc import Callable

import msgspec
import pytest

from tca_central.events import (
    Arrived,
    ConnectionId,
    DiskSpace,
    Input,
    LimitsSet,
    RequestReceived,
    Restarted,
    Tick,
)
from tca_central.inputs import events_of
from tca_wire.packets.codec import pack_item
from tca_wire.packets.headers import Ask


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1.0, 1e300])
@pytest.mark.parametrize(
    "at", [Tick, lambda it: DiskSpace(it, True), lambda it: LimitsSet(it, 1, 1, 1),
           lambda it: Restarted(1.0, it, 10.0), lambda it: Restarted(1.0, 0.0, it)],
    ids=["tick", "disk space", "limits", "away", "grace"],
)  # fmt: skip
def test_an_input_with_a_time_that_is_none_is_no_input(at: Callable[[float], Input], seconds: float) -> None:
    """A monitor that is to test every second would test for ever; a journal with NaN would never equal itself."""
    with pytest.raises(msgspec.ValidationError):
        msgspec.msgpack.decode(msgspec.msgpack.encode(at(seconds)), type=Input)


def test_a_request_that_is_not_there_is_not_spared() -> None:
    arrived = Arrived(1.0, ConnectionId(b"user"), pack_item(Ask(1, "status")))
    assert [type(one) for one in events_of(arrived, spared=7)] == [RequestReceived]
