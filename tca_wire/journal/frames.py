"""Records of a log: a payload after its length and checksum.

Both are MessagePack integers that always take five bytes (``ce`` and 32 bits, big endian): so a
record's frame has a fixed size.
"""

import struct
from collections.abc import Iterator
from typing import BinaryIO
from zlib import crc32

FRAME = struct.Struct(">BIBI")
UINT32 = 0xCE
MAX_RECORD = 64 << 20


def framed(payload: bytes) -> bytes:
    """Return the record of a payload."""
    return FRAME.pack(UINT32, len(payload), UINT32, crc32(payload)) + payload


def payloads(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield the end and the payload of each record, from the stream's position on.

    Stop at the first unsound record.
    """
    place = stream.tell()
    while len(frame := stream.read(FRAME.size)) == FRAME.size:
        mark, length, second_mark, checksum = FRAME.unpack(frame)
        if mark != UINT32 or second_mark != UINT32 or length > MAX_RECORD:
            return
        payload = stream.read(length)
        if len(payload) < length or crc32(payload) != checksum:
            return
        place += FRAME.size + length
        yield place, payload


IN_VAIN_FACTOR = 8
"""The limit for bytes that a search for a record reads in vain, as a multiple of the data.

The limit is needed because a client's data may look like a million records.
"""


def has_record(data: bytes) -> bool:
    """Return whether a sound record is, or may be, anywhere after the first byte.

    The search is bounded: after too many bytes read in vain it returns True.
    """
    bytes_left, view = IN_VAIN_FACTOR * len(data) + MAX_RECORD, memoryview(data)
    place = data.find(UINT32, 1)
    while 0 <= place <= len(data) - FRAME.size:
        _, length, mark, checksum = FRAME.unpack_from(data, place)
        end = place + FRAME.size + length
        if mark == UINT32 and length and end <= len(data):
            bytes_left -= length
            if bytes_left < 0 or crc32(view[end - length : end]) == checksum:
                return True
        place = data.find(UINT32, place + 1)
    return False
