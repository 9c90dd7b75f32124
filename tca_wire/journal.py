"""Journal records to bytes and back, on any binary stream. Knows nothing of what the facts mean.

A segment is a plain MessagePack stream that any language's reader can walk: for each record an integer (the payload's
length), an integer (its CRC-32) and the payload, an Entry. The integers are always written in five bytes (``ce`` and
32 bits, big endian), so a record's frame has a fixed size. A record that the end of the file cuts short is a torn
tail: what central was writing when the machine went down. A record that is damaged inside of its frame is passed over
if a sound one follows. Damage anywhere else is an error.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO

import msgpack
import msgspec

from tca_wire.errors import JournalDamaged
from tca_wire.facts import JOURNAL_VERSION, Entry, Opened

_FRAME = struct.Struct(">BIBI")
_UINT32 = 0xCE
MAX_RECORD = 64 << 20
SEGMENT_SUFFIX = ".tcaj"

_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(Entry).decode


def record(entry: Entry) -> bytes:
    """*entry* as one journal record, or as several of the same number where it is too big for one: a million tasks
    may be killed by one event.
    """
    payload = _encode(entry)
    if len(payload) > MAX_RECORD and len(entry.facts) > 1:
        middle = len(entry.facts) // 2
        halves = entry.facts[:middle], entry.facts[middle:]
        return b"".join(record(Entry(entry.number, entry.time, half)) for half in halves)
    return _FRAME.pack(_UINT32, len(payload), _UINT32, zlib.crc32(payload)) + payload


class JournalReader:
    """Reads the entries of one segment; at the end of what is there it stops, and goes on when iterated again.

    It may begin at the *offset* of a record that was read before. ``offset`` is the byte behind the last good record,
    ``torn`` the number of bytes behind it that are no whole record; ``holes`` are the places of the damaged records
    that were passed over.
    """

    def __init__(self, stream: BinaryIO, name: str = "journal", offset: int = 0) -> None:
        self._stream = stream
        self._name = name
        self._opened = offset > 0
        self.offset = offset
        self.torn = 0
        self.holes: list[int] = []

    def __iter__(self) -> Iterator[Entry]:
        """The entries from ``offset`` on. Raises JournalDamaged, naming the byte, where reading can't go on."""
        unpacker = self._unpacker()
        while True:
            holes = len(self.holes)
            if (payload := self._payload(unpacker)) is not None:
                yield self._entry(payload)
                self.offset += _FRAME.size + len(payload)
            elif len(self.holes) > holes:
                unpacker = self._unpacker()
            else:
                break
        self._stream.seek(0, 2)
        self.torn = self._stream.tell() - self.offset
        if self.torn and not self._opened:
            self._refuse("not a journal of tca central")

    def _unpacker(self) -> msgpack.Unpacker:
        """Reads the records from ``offset`` on."""
        self._stream.seek(self.offset)
        return msgpack.Unpacker(self._stream, read_size=1 << 20, max_buffer_size=2 * MAX_RECORD)

    def _payload(self, unpacker: msgpack.Unpacker) -> bytes | None:
        """The next record's payload; None at the end, at a torn tail, and where damaged records were passed over."""
        frame = unpacker.read_bytes(_FRAME.size)
        if len(frame) < _FRAME.size:
            return None
        mark, length, mark_too, checksum = _FRAME.unpack(frame)
        if (mark, mark_too) != (_UINT32, _UINT32) or length > MAX_RECORD:
            self._refuse_or_stop_at_zeros(frame)
            return None
        payload: bytes = unpacker.read_bytes(length)
        if len(payload) < length:
            return None
        if zlib.crc32(payload) != checksum:
            if unpacker.read_bytes(1) and not self._pass_over():
                self._refuse("its checksum is wrong")
            return None
        return payload

    def _pass_over(self) -> bool:
        """Go to the next sound record after one that is damaged inside; False, and stay, if frames lead to none."""
        place, passed = self.offset, [self.offset]
        while self._opened:
            self._stream.seek(place)
            frame = self._stream.read(_FRAME.size)
            if len(frame) < _FRAME.size:
                return False
            mark, length, mark_too, checksum = _FRAME.unpack(frame)
            if (mark, mark_too) != (_UINT32, _UINT32) or length > MAX_RECORD:
                return False
            payload = self._stream.read(length)
            if len(payload) == length and zlib.crc32(payload) == checksum:
                self.holes += passed
                self.offset = place
                return True
            if place != self.offset:
                passed.append(place)
            place += _FRAME.size + length
        return False

    def _entry(self, payload: bytes) -> Entry:
        try:
            entry = _decode(payload)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            self._check_version(payload)
            self._refuse(f"it is no entry ({error})")
            raise
        if not self._opened:
            self._check_version(payload)
            self._opened = True
        return entry

    def _check_version(self, payload: bytes) -> None:
        """Refuse a segment of a later version; its first record says which it is, in a form that never changes."""
        if self._opened:
            return
        try:
            kind, version = msgpack.unpackb(payload)[2][0][:2]
        except (ValueError, TypeError, IndexError, KeyError, msgpack.UnpackException):
            kind, version = "", 0
        if kind != Opened.__struct_config__.tag or not isinstance(version, int):
            self._refuse("not a journal of tca central")
        if version > JOURNAL_VERSION:
            self._refuse(f"written by a later version ({version}; this one reads up to {JOURNAL_VERSION}): upgrade tca")

    def _refuse_or_stop_at_zeros(self, frame: bytes) -> None:
        """A tail of zeros is what some file systems leave after a power cut; anything else is damage."""
        self._stream.seek(self.offset)
        if any(frame) or any(any(chunk) for chunk in iter(lambda: self._stream.read(1 << 20), b"")):
            self._refuse("there is no record here" if self._opened else "not a journal of tca central")

    def _refuse(self, why: str) -> None:
        at = f", byte {self.offset}" if self.offset else ""
        msg = f"{self._name}{at}: {why}"
        raise JournalDamaged(msg)
