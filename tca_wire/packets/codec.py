"""Packets: header and body pairs to bytes and back. One packet is one ZeroMQ frame.

A packet holds one or more *items*, each ``length of header (u32, big endian), length of body (u32), header, body``.
Items that wait for the same peer share a packet: with small messages, frames and calls are what costs.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import msgspec

from tca_wire.errors import ProtocolError
from tca_wire.packets.headers import ToCentral, ToModule
from tca_wire.vocabulary import Limit

_LENGTHS = struct.Struct(">II")
_LONGEST = int(Limit.PACKET)


def plain(value: Any) -> int:
    """A number of a type of its own, as programs have them, goes as a plain one: the one it has *on the wire*."""
    if isinstance(value, int):
        return getattr(value, "on_wire", None) or int(value)
    msg = f"Encoding objects of type {type(value).__name__} is unsupported"
    raise TypeError(msg)


_encode = msgspec.msgpack.Encoder(enc_hook=plain).encode

# The errors of msgspec on hostile bytes; the last two are no MsgspecError.
_BAD_BYTES = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)


def pack_item(header: msgspec.Struct, body: bytes = b"") -> bytes:
    """One item; packets are items joined."""
    encoded = _encode(header)
    return b"".join((_LENGTHS.pack(len(encoded), len(body)), encoded, body))


def pack(items: Iterable[tuple[msgspec.Struct, bytes]]) -> bytes:
    """A packet of several items."""
    return b"".join(pack_item(header, body) for header, body in items)


def packets(items: Sequence[tuple[msgspec.Struct, bytes]]) -> Iterable[tuple[int, bytes]]:
    """Items in as few packets as their size allows, each with the number of items in those before it."""
    if len(items) == 1:  # as most of the time
        return ((0, pack_item(*items[0])),)
    return _packets(items)


def _packets(items: Iterable[tuple[msgspec.Struct, bytes]]) -> Iterator[tuple[int, bytes]]:
    packed: list[bytes] = []
    before = size = 0
    for header, body in items:
        item = pack_item(header, body)
        if packed and size + len(item) > Limit.BODY:
            yield before, b"".join(packed)
            before += len(packed)
            packed, size = [], 0
        packed.append(item)
        size += len(item)
    yield before, b"".join(packed)


def unpacker(kinds: Any, what_it_is_not: str) -> Callable[[bytes], list[tuple[Any, bytes]]]:
    """A function that unpacks packets with headers of these *kinds*. It raises ProtocolError, whatever the bytes."""
    decode = msgspec.msgpack.Decoder(kinds).decode

    def unpack(packet: bytes) -> list[tuple[Any, bytes]]:
        at, size, items = 0, len(packet), []
        if not 0 < size <= _LONGEST:
            msg = f"a packet of {size} bytes; 8 to {_LONGEST} are allowed"
            raise ProtocolError(msg)
        while at < size:
            if at + 8 > size:
                msg = f"the packet ends inside the lengths of an item (byte {at} of {size})"
                raise ProtocolError(msg)
            header_length, body_length = _LENGTHS.unpack_from(packet, at)
            header_end = at + 8 + header_length
            header, at = packet[at + 8 : header_end], header_end + body_length
            if at > size:
                msg = f"an item claims {header_length} + {body_length} bytes, more than the packet's {size} hold"
                raise ProtocolError(msg)
            try:
                items.append((decode(header), packet[header_end:at]))
            except _BAD_BYTES as error:
                msg = f"a header is {what_it_is_not}: {error}"
                raise ProtocolError(msg) from None
        return items

    return unpack


unpack_to_central: Callable[[bytes], list[tuple[ToCentral, bytes]]] = unpacker(ToCentral, "no message to central")
"""The items of a packet that a module sent. Raises ProtocolError, whatever the bytes."""

unpack_to_module: Callable[[bytes], list[tuple[ToModule, bytes]]] = unpacker(ToModule, "no message to a module")
"""The items of a packet that central sent. Raises ProtocolError, whatever the bytes."""


_decode_header = msgspec.msgpack.Decoder(ToCentral).decode


def misfit(header: Any) -> str:
    """The error in the fields of a header, as central would see it; "" if there is none."""
    try:
        encoded = _encode(header)
        if len(encoded) > Limit.HEADER:
            return f"it takes {len(encoded):,} bytes beside its data; at most {Limit.HEADER:,} are allowed"
        _decode_header(encoded)
    except UnicodeEncodeError:
        raise
    except (*_BAD_BYTES, TypeError, OverflowError, ValueError) as error:
        place = re.search(r"`\$\[(\d+)\]", str(error))
        fields = header.__struct_fields__
        field = fields[int(place[1]) - 1] if place and 0 < int(place[1]) <= len(fields) else ""
        what = str(error).partition(" - at ")[0]
        return f"{field}: {what}" if field else what
    return ""
