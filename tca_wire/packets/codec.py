"""Packets: header and body pairs to bytes and back. One packet is one ZeroMQ frame.

A packet holds one or more *items*, each ``length of header (u32, big endian), length of body (u32),
header, body``. Items that wait for the same peer share a packet: with small messages the frames and
calls cost most.
"""

import re
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any, get_origin, get_type_hints

import msgspec

from tca_wire.errors import ProtocolError
from tca_wire.packets.headers import ToCentral, ToModule
from tca_wire.vocabulary import Limit

_LENGTHS = struct.Struct(">II")
_LONGEST, _LONGEST_HEADER = int(Limit.PACKET), int(Limit.HEADER)
_MOST_ITEMS, _MOST_ENTRIES, _TOGETHER = int(Limit.ITEMS), int(Limit.PARTS), int(Limit.TOGETHER)
_COPIED = 4096  # bytes: copying a smaller body is cheaper than a second piece
_SHORT = 96  # bytes: a shorter item or header can't have many entries


def plain(value: Any) -> float | bytes:
    """Return a number of a user-defined type as a plain number: its ``on_wire`` value, if any.

    Return a large body, whose class is derived from bytes, as plain bytes.
    """
    if isinstance(value, bytes):
        return bytes(value)
    if isinstance(value, int):
        return getattr(value, "on_wire", None) or int(value)
    if isinstance(value, float):
        return float(value)
    raise TypeError(f"Encoding objects of type {type(value).__name__} is unsupported")


encode = msgspec.msgpack.Encoder(enc_hook=plain).encode

# The errors of msgspec on hostile bytes; the last two are not subclasses of MsgspecError.
_BAD_BYTES = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)


def pack_item(header: msgspec.Struct, body: bytes = b"") -> bytes:
    """Return one item. Packets are concatenated items."""
    encoded = encode(header)
    return b"".join((_LENGTHS.pack(len(encoded), len(body)), encoded, body))


def pack_in_pieces(header: msgspec.Struct, body: bytes) -> list[bytes]:
    """Return the pieces of one item; a large body is not copied."""
    encoded = encode(header)
    start = _LENGTHS.pack(len(encoded), len(body)) + encoded
    return [start + body] if len(body) < _COPIED else [start, body]


def pack(items: Iterable[tuple[msgspec.Struct, bytes]]) -> bytes:
    """Return a packet of several items."""
    return b"".join(pack_item(header, body) for header, body in items)


def packets(items: Sequence[tuple[msgspec.Struct, bytes]]) -> Iterable[tuple[int, bytes]]:
    """Return items in as few packets as their sizes allow.

    Each packet is paired with the number of items in all packets before it.
    """
    if len(items) == 1:  # the usual case, fast
        return ((0, pack_item(*items[0])),)
    return _packets(items)


def _packets(items: Iterable[tuple[msgspec.Struct, bytes]]) -> Iterator[tuple[int, bytes]]:
    packed: list[bytes] = []
    before = size = entries = 0
    for header, body in items:
        item = pack_item(header, body)
        more = entries_in(header) if len(item) - len(body) > _SHORT else 0
        if packed and (
            size + len(item) > _TOGETHER
            or len(packed) == _MOST_ITEMS
            or entries + more > _MOST_ENTRIES
        ):
            yield before, b"".join(packed)
            before += len(packed)
            packed, size, entries = [], 0, 0
        packed.append(item)
        size += len(item)
        entries += more
    yield before, b"".join(packed)


@cache
def _list_fields(kind: type) -> tuple[str, ...]:
    """Return the fields of a header that are lists."""
    return tuple(name for name, hint in get_type_hints(kind).items() if get_origin(hint) is list)


def entries_in(header: msgspec.Struct) -> int:
    """Return the number of entries in a header's lists."""
    return sum(len(getattr(header, name)) for name in _list_fields(type(header)))


def unpacker(
    kinds: Any,
    expected: str,
    *,
    most_items: int = _LONGEST,
    most_entries: int = _LONGEST,
    most_bytes_together: int = _LONGEST,
) -> Callable[[bytes], list[tuple[Any, bytes]]]:
    """Return a function that unpacks packets with headers of the given *kinds*.

    The function raises ProtocolError for invalid bytes of any kind.

    Args:
        kinds: the union of header types.
        expected: the packet's purpose, for errors: "a message to central".
        most_items: the limit for items in a packet.
        most_entries: the limit for entries in the lists of a packet's headers.
        most_bytes_together: the limit for the bytes of a packet with several items.
    """
    decode, read_lengths = msgspec.msgpack.Decoder(kinds).decode, _LENGTHS.unpack_from

    def unpack(packet: bytes) -> list[tuple[Any, bytes]]:
        items: list[tuple[Any, bytes]] = []
        at, size, entries, number = 0, len(packet), 0, 0
        if not 0 < size <= _LONGEST:
            msg = f"a packet of {size} bytes: 8 to {_LONGEST} are allowed"
            raise ProtocolError(msg)
        most = most_items if size <= most_bytes_together else 1
        while at < size:
            begin = at + 8
            if begin > size:
                msg = f"the packet ends inside the lengths of an item (byte {at} of {size})"
                raise ProtocolError(msg)
            header_length, body_length = read_lengths(packet, at)
            header_end = begin + header_length
            at = header_end + body_length
            if at > size:
                raise ProtocolError(
                    f"an item claims {header_length} + {body_length} bytes,"
                    f" more than the packet's {size} bytes hold"
                )
            number += 1
            if header_length > _LONGEST_HEADER or number > most:
                raise ProtocolError(
                    f"a packet of {size} bytes with a header of {header_length}:"
                    f" the limits are {most_items} items, together {most_bytes_together} bytes,"
                    f" and headers of {_LONGEST_HEADER}"
                )
            try:
                header = decode(packet[begin:header_end])
            except _BAD_BYTES as error:
                raise ProtocolError(f"a header is not {expected}: {error}") from None
            if header_length > _SHORT and (entries := entries + entries_in(header)) > most_entries:
                raise ProtocolError(
                    f"the lists in the headers of a packet have more than {most_entries} entries:"
                    " send several packets"
                )
            items.append((header, packet[header_end:at]))
        return items

    return unpack


unpack_to_central: Callable[[bytes], list[tuple[ToCentral, bytes]]] = unpacker(
    ToCentral,
    "a message to central",
    most_items=_MOST_ITEMS,
    most_entries=_MOST_ENTRIES,
    most_bytes_together=_TOGETHER,
)
"""The items of a packet that a module sent. Raises ProtocolError for any invalid bytes."""

unpack_to_module: Callable[[bytes], list[tuple[ToModule, bytes]]] = unpacker(
    ToModule, "a message to a module"
)
"""The items of a packet that central sent. Raises ProtocolError for any invalid bytes."""


_decode_header = msgspec.msgpack.Decoder(ToCentral).decode


def misfit(header: Any) -> str:
    """Return the error that central would find in the fields of a header, or ""."""
    try:
        encoded = encode(header)
        if len(encoded) > Limit.HEADER:
            return f"it has {len(encoded):,} bytes beside its data: the limit is {Limit.HEADER:,}"
        _decode_header(encoded)
    except UnicodeEncodeError:
        raise
    except (*_BAD_BYTES, TypeError, OverflowError, ValueError) as error:
        place = re.search(r"`\$\[(\d+)\]", str(error))
        fields = header.__struct_fields__
        index = int(place[1]) - 1 if place else -1  # the first element is the kind
        field = fields[index] if 0 <= index < len(fields) else ""
        problem = str(error).partition(" - at ")[0]
        return f"{field}: {problem}" if field else problem
    return ""
