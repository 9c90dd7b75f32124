"""Records of a log: a payload with its length and checksum before it. Two integers of MessagePack,
always in five bytes (``ce`` and 32 bits, big endian), so that a record's frame has a fixed size.
"""

import struct
from collections.abc import Iterator
from typing import BinaryIO
from zlib import crc32

FRAME = struct.Struct(">BIBI")
UINT32 = 0xCE
MAX_RECORD = 64 << 20


def framed(payload: bytes) -> bytes:
    """A record."""
    return FRAME.pack(UINT32, len(payload), UINT32, crc32(payload)) + payload


def payloads(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """The payloads of sound records from the present place on, each with the place behind it; up to
    the first that is none.
    """
    place = stream.tell()
    while len(frame := stream.read(FRAME.size)) == FRAME.size:
        mark, length, mark_too, checksum = FRAME.unpack(frame)
        if (mark, mark_too) != (UINT32, UINT32) or length > MAX_RECORD:
            return
        payload = stream.read(length)
        if len(payload) < length or crc32(payload) != checksum:
            return
        place += FRAME.size + length
        yield place, payload


_SPARE = 8
"""So many times its own size may be read in vain while a record is looked for: what a client has
sent may look like a million of them.
"""


def has_record(data: bytes) -> bool:
    """Whether a sound record is anywhere behind the first byte, or may be: it is not looked for for
    ever.
    """
    left, view = _SPARE * len(data) + MAX_RECORD, memoryview(data)
    place = data.find(UINT32, 1)
    while 0 <= place <= len(data) - FRAME.size:
        _, length, mark, checksum = FRAME.unpack_from(data, place)
        end = place + FRAME.size + length
        if mark == UINT32 and length and end <= len(data):
            left -= length
            if left < 0 or crc32(view[end - length : end]) == checksum:
                return True
        place = data.find(UINT32, place + 1)
    return False
