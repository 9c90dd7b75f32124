"""Journal records to bytes and back, on any binary stream. The meaning of facts is not known here.

A segment is a plain MessagePack stream that a reader in any language can walk. Each record is an
integer (the payload's length), an integer (its CRC-32) and the payload, an Entry. The integers
always take five bytes (``ce`` and 32 bits, big endian), so a record's frame has a fixed size.

A record that the end of the file cuts off is a torn tail: central was writing it when the machine
went down. The reader skips damage up to the next sound record, and facts and entries that this
version does not know. It raises an error only for a file that is not a journal, and for damage
without a sound record after it.
"""

import errno
import os
import re
from collections.abc import Iterator
from typing import Any, BinaryIO
from zlib import crc32

import msgspec

from tca_wire.errors import JournalDamaged
from tca_wire.journal.causes import Cause
from tca_wire.journal.facts import (
    JOURNAL_VERSION,
    OLDEST_READ,
    Entry,
    EntryNumber,
    EntryTime,
    Fact,
    Opened,
)
from tca_wire.journal.frames import FRAME, IN_VAIN_FACTOR, MAX_RECORD, UINT32, framed

_FRAME_SIZE, _unpack_frame = FRAME.size, FRAME.unpack_from
SEGMENT_SUFFIX = ".tcaj"

_RECORD_START = re.compile(rb"\xce[\x00-\x04].{3}\xce.{4}[\x90-\x9f]", re.DOTALL)
"""A frame and the start of an array. Other bytes of a journal match it once in millions."""
_CHUNK = 1 << 20
_ZEROS = bytes(_CHUNK)
_SEEK_DATA: int | None = getattr(os, "SEEK_DATA", None)
_MOST_SKIPPED = 100
"""The limit for damaged records in a row that are skipped one by one; then all bytes are searched.
"""
_FRAME_COST = 1 << 10
"""The time to follow one frame in vain, as the number of bytes that are read in that time."""


class _LooseEntry(msgspec.Struct, array_like=True):
    """An entry whose facts and cause may be anything."""

    number: EntryNumber
    time: EntryTime
    facts: list[msgspec.Raw]
    cause: msgspec.Raw = msgspec.Raw(b"\xc0")


class _EntryHead(msgspec.Struct, array_like=True):
    """An entry's fields of any type: enough for its number and the version of its segment."""

    number: int
    time: Any
    facts: Any


_UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)


def _plain_bytes(value: object) -> bytes:
    """Return a large body, whose class is derived from bytes, as plain bytes."""
    if isinstance(value, bytes):
        return bytes(value)
    raise TypeError(f"Encoding objects of type {type(value).__name__} is unsupported")


_encode = msgspec.msgpack.Encoder(enc_hook=_plain_bytes).encode
_decode = msgspec.msgpack.Decoder(Entry).decode
_decode_loosely = msgspec.msgpack.Decoder(_LooseEntry).decode
_decode_head = msgspec.msgpack.Decoder(_EntryHead).decode
_decode_fact = msgspec.msgpack.Decoder(Fact).decode
_decode_cause = msgspec.msgpack.Decoder(Cause | None).decode


def record(entry: Entry) -> bytes:
    """Return *entry* as one journal record.

    An entry that is too big for one record becomes several records with the entry's number. One
    event may kill a million tasks.
    """
    payload = _encode(entry)
    if len(payload) > MAX_RECORD and len(entry.facts) > 1:
        middle = len(entry.facts) // 2
        halves = entry.facts[:middle], entry.facts[middle:]
        return b"".join(
            record(Entry(entry.number, entry.time, half, entry.cause)) for half in halves
        )
    return framed(payload)


class JournalReader:
    """Reads the entries of one segment. At its present end it stops; iterate again to continue.

    Args:
        stream: the segment.
        name: the journal's name, for errors.
        offset: the record to start at (0: the first). Another reader has read those before it.

    Attributes:
        offset: the byte after the last sound record.
        torn: the number of bytes after *offset*, which are not a whole record.
        holes: the offsets of damaged records that were skipped.
        is_counted: whether each of *holes* stands for one record; otherwise some stand for several.
        unknown: the number of facts that this version does not know and left out.
        version: the version of the segment.

    A message's data may look like a record, too. After damage, a record is therefore sound only if
    its checksum is right and its number is not below that of the last entry.
    """

    def __init__(self, stream: BinaryIO, name: str = "journal", offset: int = 0) -> None:
        self._stream = stream
        self._name = name
        self._has_first_record = offset > 0
        self.offset = offset
        self.torn = 0
        self.holes: list[int] = []
        self.is_counted = True
        self.unknown = 0
        self.version = JOURNAL_VERSION
        self._last_number = -1  # of the last entry
        self._window, self._window_at = b"", 0  # some bytes of the stream, and their position
        self._longest_tried = MAX_RECORD  # longer records are not tried: see _longest_allowed
        self._bytes_in_vain = 0  # read while no sound record was found
        self._stream_size = 0  # when its end was last checked: central may still write
        self._failed_search = (-1, -1)  # start and stream size of the last search without a result

    def __iter__(self) -> Iterator[Entry]:
        """Yield the entries from ``offset`` on.

        Raises JournalDamaged, naming the byte, at damage before the end.
        """
        self._window = b""  # the stream may have grown since the last iteration
        while True:
            payload = self._payload()
            if payload is None:
                if self._skip_damage():
                    continue
                break
            try:
                entry: Entry | None = _decode(payload)
            except _UNREADABLE:
                entry = self._known_part(payload)
            if not self._has_first_record:
                self._read_version(payload, entry)
            if entry is None:
                self.holes.append(self.offset)
            else:
                self._last_number = entry.number
                yield entry
            self.offset += _FRAME_SIZE + len(payload)
        self._check_end()

    # --- records ----------------------------------------------------------------------------------

    def _payload(self) -> bytes | None:
        """Return the payload of the record at ``offset``; None if there is no sound one."""
        window, at = self._window, self.offset - self._window_at
        if at < 0 or at + _FRAME_SIZE > len(window):
            window, at = self._load(self.offset, _FRAME_SIZE), 0
            if len(window) < _FRAME_SIZE:
                return None
        mark, length, second_mark, checksum = _unpack_frame(window, at)
        if mark != UINT32 or second_mark != UINT32 or length > self._longest_tried:
            return None
        end = at + _FRAME_SIZE + length
        if end > len(window):
            window, at, end = self._load(self.offset, _FRAME_SIZE + length), 0, _FRAME_SIZE + length
            if end > len(window):
                return None
        payload = window[at + _FRAME_SIZE : end]
        return payload if crc32(payload) == checksum else None

    def _load(self, place: int, size: int) -> bytes:
        """Load these bytes into the window, as far as they exist."""
        self._stream.seek(place)
        self._window, self._window_at = self._stream.read(max(size, _CHUNK)), place
        return self._window

    def _read(self, place: int, size: int) -> bytes:
        """Return these bytes, as far as they exist."""
        at = place - self._window_at
        if at < 0 or at + size > len(self._window):
            self._load(place, size)
            at = 0
        return self._window[at : at + size]

    def _length(self, place: int) -> int | None:
        """Return the size of the payload, as its frame says; None if there is no frame."""
        frame = self._read(place, _FRAME_SIZE)
        if len(frame) < _FRAME_SIZE:
            return None
        mark, length, second_mark, _ = FRAME.unpack(frame)
        is_frame = mark == second_mark == UINT32 and length <= MAX_RECORD
        return int(length) if is_frame else None

    def _is_sound(self, place: int, size: int) -> bool:
        """Return whether a sound record starts there, in a stream of that size."""
        length = self._length(place)
        longest = min(self._longest_allowed(place), size - place - _FRAME_SIZE)
        if length is None or length > longest:
            return False
        record_bytes = self._read(place, _FRAME_SIZE + length)
        payload = memoryview(record_bytes)[_FRAME_SIZE:]
        if len(payload) == length and crc32(payload) == _unpack_frame(record_bytes)[3]:
            return True
        self._bytes_in_vain += _FRAME_SIZE + length
        return False

    def _longest_allowed(self, place: int) -> int:
        """Return the longest record to try after damage.

        The bytes read in vain are limited by a multiple of the bytes before *place*. Reading
        therefore takes linear time, even for a file with forged lengths.
        """
        return MAX_RECORD + IN_VAIN_FACTOR * place - self._bytes_in_vain

    # --- damage -----------------------------------------------------------------------------------

    def _skip_damage(self) -> bool:
        """Skip damage to the next sound record; return whether there is one."""
        size = self._stream_size = self._stream.seek(0, 2)
        if self.offset >= size or self._failed_search == (self.offset, size):
            return False
        place, skipped = self._follow_frames(size)
        if place is None:
            place, skipped = self._search_bytes(size), [self.offset]
            self.is_counted = self.is_counted and place is None
        if place is None:
            self._failed_search = (self.offset, size)
            return False
        self.holes += skipped
        self.offset = place
        longest = min(self._longest_allowed(place), MAX_RECORD)
        self._longest_tried = max(longest, self._length(place) or 0)
        return True

    def _follow_frames(self, size: int) -> tuple[int | None, list[int]]:
        """Follow frames to the next sound record. Return its place, and those of damaged records.

        The first place is None if the frames do not lead to a sound record.
        """
        place = self.offset
        skipped: list[int] = []
        while not self._is_sound(place, size):
            length = self._length(place)
            is_too_long = length is not None and length > self._longest_allowed(place)
            if length is None or is_too_long or len(skipped) == _MOST_SKIPPED:
                self._bytes_in_vain += _FRAME_COST * len(skipped)
                return None, []
            skipped.append(place)
            place += _FRAME_SIZE + length
        return place, skipped

    def _search_bytes(self, size: int) -> int | None:
        """Return the place of the next sound record among all bytes; None if there is none."""
        place = self.offset + 1
        # The first record is short: a file without one in its first bytes is not a journal.
        end = size if self._has_first_record else min(size, MAX_RECORD)
        while place < end:
            if not self._window_at <= place < self._window_at + len(self._window) - _FRAME_SIZE:
                self._load(place, _CHUNK)
            window, start = self._window, self._window_at
            found = _RECORD_START.search(window, place - start)
            while found:
                found_place = start + found.start()
                if self._is_sound(found_place, size) and self._may_follow(found_place):
                    return found_place
                found = _RECORD_START.search(window, found.start() + 1)
            place = max(start + len(window) - _FRAME_SIZE, place + 1)
            place = max(self._data_from(place, end) - _FRAME_SIZE, place)
        return None

    def _may_follow(self, place: int) -> bool:
        """Return whether a sound record is an entry that may follow the last one."""
        length = self._length(place) or 0
        try:
            entry = _decode_head(self._read(place + _FRAME_SIZE, length))
        except _UNREADABLE:
            return False
        if entry.number >= self._last_number or _version_in(entry.facts) is not None:
            return True
        self._bytes_in_vain += length
        return False

    def _check_end(self) -> None:
        """Set ``torn``. Raises JournalDamaged if more than a torn tail is left."""
        self.torn = self._stream_size - self.offset
        if self.torn <= 0:
            return
        if not self._has_first_record:
            self._refuse("not a journal of tca central")
        length = self._length(self.offset)
        record_size = 0 if length is None else _FRAME_SIZE + length
        if self.torn >= _FRAME_SIZE and not self._is_zeros(self.offset + record_size):
            self._refuse("no record starts here" if length is None else "its checksum is wrong")

    def _is_zeros(self, place: int) -> bool:
        """Return whether the rest is empty, or zeros that a file system left after a power cut."""
        while (place := self._data_from(place, self._stream_size)) < self._stream_size:
            self._stream.seek(place)
            chunk = self._stream.read(min(_CHUNK, self._stream_size - place))
            if chunk != _ZEROS[: len(chunk)]:
                return False
            place += max(len(chunk), 1)
        return True

    def _data_from(self, place: int, end: int) -> int:
        """Return the first position from *place* on where the file system stores data.

        After a power cut, gigabytes may be without data.
        """
        if _SEEK_DATA is not None and place < end:
            try:
                return min(self._stream.seek(place, _SEEK_DATA), end)
            except OSError as error:
                return end if error.errno == errno.ENXIO else place
            except ValueError:  # not a real file
                pass
        return place

    def _refuse(self, why: str) -> None:
        at = f", byte {self.offset}" if self.offset else ""
        raise JournalDamaged(f"{self._name}{at}: {why}")

    # --- facts of other versions ------------------------------------------------------------------

    def _known_part(self, payload: bytes) -> Entry | None:
        """Return an entry without its unreadable facts; None if the payload is not an entry."""
        try:
            entry = _decode_loosely(payload)
        except _UNREADABLE:
            return None
        known: list[Fact] = []
        for raw in entry.facts:
            try:
                known.append(_decode_fact(raw))
            except _UNREADABLE:
                self.unknown += 1
        try:
            cause = _decode_cause(entry.cause)
        except _UNREADABLE:
            cause = None
            self.unknown += 1
        return Entry(entry.number, entry.time, known, cause)

    def _read_version(self, payload: bytes, entry: Entry | None) -> None:
        """Read the version from the first sound record.

        The form of a segment's first record never changes. If the first sound record has no
        version, it is a later record: those before it are missing.
        """
        try:
            version = _version_in(_decode_head(payload).facts)
        except _UNREADABLE:
            version = None
        if version is None and entry is None:
            self._refuse("not a journal of tca central")
        if version is None:
            if not self.holes:
                self.holes.append(self.offset)
                self.is_counted = False
        elif version < OLDEST_READ:
            formats = f"format {version}, this one reads {OLDEST_READ} to {JOURNAL_VERSION}"
            self._refuse(
                f"an earlier version of tca wrote it ({formats}): read it with that version"
            )
        else:
            self.version = version
        self._has_first_record = True


def _version_in(facts: Any) -> int | None:
    """Return the version of a segment from the facts of its first entry.

    None for the facts of any other entry.
    """
    try:
        kind, version = facts[0][:2]
    except (ValueError, TypeError, IndexError, KeyError):
        return None
    if kind != Opened.__struct_config__.tag or not isinstance(version, int):
        return None
    return version
