"""Packets: decoding returns the encoded items, and other bytes raise only ProtocolError."""

import re
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tca_wire.constraints import Constraint, Flags
from tca_wire.errors import ProtocolError
from tca_wire.packets import codec, headers
from tca_wire.packets.parts import MessageFormat
from tca_wire.points import Moment, Point, TaskId
from tca_wire.vocabulary import Limit, MessageClass

points = st.builds(Point, st.integers(-1, 2**40).map(TaskId), st.sampled_from(Moment))
sends = st.builds(
    headers.Send,
    number=st.integers(0, 2**62),
    message=st.text(max_size=20),
    parent=st.integers(0, 2**40).map(TaskId),
    flags=st.integers(0, 15).map(Flags),
    constraints=st.lists(st.builds(Constraint, points, points), max_size=3),
)
to_central = st.one_of(
    sends,
    st.builds(headers.Reply, st.integers(0, 2**62)),
    st.builds(headers.Fail, st.integers(0, 2**62), st.text(max_size=9), st.text(max_size=9)),
    st.builds(headers.AwaitPoint, st.integers(0, 2**62), points),
)


@given(st.lists(st.tuples(to_central, st.binary(max_size=50)), min_size=1, max_size=8))
def test_packet_round_trip_keeps_items(items: list[tuple[headers.ToCentral, bytes]]) -> None:
    assert codec.unpack_to_central(codec.pack(items)) == items


@given(st.lists(st.tuples(to_central, st.binary(max_size=20)), min_size=1, max_size=3), st.data())
def test_truncated_packet_is_refused_or_ends_at_an_item(
    items: list[tuple[headers.ToCentral, bytes]], data: st.DataObject
) -> None:
    packet = codec.pack(items)
    cut = data.draw(st.integers(0, len(packet) - 1))
    with suppress(ProtocolError):
        unpacked = codec.unpack_to_central(packet[:cut])
        assert unpacked == items[: len(unpacked)]


@given(st.binary(max_size=200))
def test_arbitrary_bytes_raise_only_protocol_error(packet: bytes) -> None:
    for unpack in (codec.unpack_to_central, codec.unpack_to_module):
        with suppress(ProtocolError):
            unpack(packet)


def item(header: bytes, body: bytes = b"") -> bytes:
    return len(header).to_bytes(4, "big") + len(body).to_bytes(4, "big") + header + body


@pytest.mark.parametrize(
    ("packet", "why"),
    [
        (b"", "a packet of 0 bytes"),
        (b"\0\0\0", "ends inside the lengths"),
        (item(b"\x91\x05")[:-1], "more than the packet's"),
        (item(b""), "truncated"),
        (item(b"\xc1"), "malformed"),
        (item(msgspec.msgpack.encode([99, 1])), "Invalid value 99"),
        (item(msgspec.msgpack.encode([5, 1, 2, 3, "", 4])), "at most length 4"),
        (item(msgspec.msgpack.encode([5, "one"])), "Expected `int`, got `str`"),
        (item(b"\x92\x05" + b"\x91" * 100_000), "not a message to central"),
        (item(b"\x92\x05\xa2\xff\xfe"), "not a message to central"),
    ],
)
def test_malformed_packet_is_refused_with_a_reason(packet: bytes, why: str) -> None:
    with pytest.raises(ProtocolError, match=why):
        codec.unpack_to_central(packet)


def test_reply_packet_matches_the_documented_bytes() -> None:
    reply = codec.pack([(headers.Reply(7), b"\xc0")])
    assert reply.hex(" ") == "00 00 00 06 00 00 00 01 95 05 07 00 00 a0 c0"


def test_hello_of_a_later_version_is_read() -> None:
    """Otherwise central could not answer a newer module with the version that it speaks."""
    hello = headers.Hello(1, headers.PROTOCOL_VERSION + 1, "legs", "run")
    later = msgspec.msgpack.encode(
        [*msgspec.msgpack.decode(msgspec.msgpack.encode(hello)), "more", 7]
    )
    packet = codec.pack_item(hello).replace(msgspec.msgpack.encode(hello), b"")
    packet = len(later).to_bytes(4, "big") + packet[4:8] + later
    assert codec.unpack_to_central(packet) == [(hello, b"")]


def test_oversized_header_is_reported_before_sending() -> None:
    """A packet beyond the limit would close the connection without an error message."""
    formats = [MessageFormat("walk", MessageClass.GOAL, "x" * (8 << 20))]
    assert "8,388,6" in codec.misfit(headers.Register(1, formats))
    assert not codec.misfit(headers.Ask(1, "status"))


CONSTRAINT = Constraint(
    Point(TaskId(1), Moment.END_ACHIEVING), Point(TaskId(2), Moment.START_ACHIEVING)
)
FLOODS: dict[str, tuple[list[tuple[headers.ToCentral, bytes]], int, str]] = {
    "items": ([(headers.GiveUp(0), b"")], Limit.ITEMS, "items, together"),
    "parts of one header": (
        [(headers.Constrain(0, [CONSTRAINT] * (Limit.LIST + 1)), b"")],
        0,
        "length <= 1000",
    ),
    "parts of several": ([(headers.Constrain(0, [CONSTRAINT] * 667), b"")], 2, "entries"),
    "bytes of several": ([(headers.Reply(1), bytes(Limit.TOGETHER - 100))], 1, "items, together"),
    "bytes of a header": ([(headers.Fail(1, "x" * Limit.HEADER), b"")], 0, "and headers of"),
}


@pytest.mark.parametrize("what", FLOODS)
def test_packet_beyond_limits_is_refused_as_a_whole(what: str) -> None:
    """A packet at the limit is accepted. With one more item, it is refused before any of its items
    is processed.
    """
    items, most, why = FLOODS[what]
    if most:
        assert len(codec.unpack_to_central(codec.pack(items * most))) == most
    with pytest.raises(ProtocolError, match=why):
        codec.unpack_to_central(codec.pack(items * (most + 1)))


@pytest.mark.parametrize("what", FLOODS)
def test_items_are_divided_into_acceptable_packets(what: str) -> None:
    items, most, _ = FLOODS[what]
    items = (
        items * (2 * most + 1)
        if most
        else [(headers.Constrain(0, [CONSTRAINT] * Limit.LIST), b"")] * 5
    )
    packets = list(codec.packets(items))
    assert len(packets) == 3
    assert [before for before, _ in packets] == list(range(0, len(items), most or 2))
    assert [item for _, packet in packets for item in codec.unpack_to_central(packet)] == items


def test_protocol_page_names_the_current_version() -> None:
    page = (Path(__file__).parents[2] / "docs/reference/protocol.md").read_text(encoding="utf-8")
    assert set(re.findall(r"version = (\d+)", page)) == {str(headers.PROTOCOL_VERSION)}
