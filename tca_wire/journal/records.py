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
from tca_wire.journal.frames import FRAME, MAX_RECORD, UINT32, framed

_HEAD, _unpack_head = FRAME.size, FRAME.unpack_from
SEGMENT_SUFFIX = ".tcaj"

_LIKE_A_RECORD = re.compile(rb"\xce[\x00-\x04].{3}\xce.{4}[\x90-\x9f]", re.DOTALL)
"""A frame and the start of an array. Other bytes of a journal look like it once in millions."""
_CHUNK = 1 << 20
_ZEROS = bytes(_CHUNK)
_SEEK_DATA: int | None = getattr(os, "SEEK_DATA", None)
_MOST_FRAMES = 100
"""The number of damaged records in a row that are counted separately."""
_STEP = 1 << 10
"""The cost of a frame that leads nowhere, in bytes read in vain: it takes as long."""
_SPARE = 8
"""The limit for bytes read in vain in a search, as a multiple of the bytes before: see
``_allowed``.
"""


class _LooseEntry(msgspec.Struct, array_like=True):
    """An entry whose facts and cause may be anything."""

    number: EntryNumber
    time: EntryTime
    facts: list[msgspec.Raw]
    cause: msgspec.Raw = msgspec.Raw(b"\xc0")


class _EntryHead(msgspec.Struct, array_like=True):
    """An entry of which only the number and the first fact matter."""

    number: int
    time: Any
    facts: Any


_UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(Entry).decode
_decode_loosely = msgspec.msgpack.Decoder(_LooseEntry).decode
_decode_head = msgspec.msgpack.Decoder(_EntryHead).decode
_decode_fact = msgspec.msgpack.Decoder(Fact).decode
_decode_cause = msgspec.msgpack.Decoder(Cause | None).decode


def record(entry: Entry) -> bytes:
    """Return *entry* as one journal record, or as several with its number if it is too big for one.

    One event may kill a million tasks.
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
        offset: start at this record, which was read before (0: at the start).

    ``offset`` is the byte after the last good record, ``torn`` the number of bytes after it that
    are not a whole record. ``holes`` are the offsets of damaged records that were skipped. If not
    ``is_counted``, some of them stand for several records. ``unknown`` counts the facts that this
    version does not know and left out; ``version`` is that of the segment.

    A message's data may look like a record, too. After damage, a record is therefore sound only if
    its checksum is right and its number is not below that of the last entry.
    """

    def __init__(self, stream: BinaryIO, name: str = "journal", offset: int = 0) -> None:
        self._stream = stream
        self._name = name
        self._opened = offset > 0
        self.offset = offset
        self.torn = 0
        self.holes: list[int] = []
        self.is_counted = True
        self.unknown = 0
        self.version = JOURNAL_VERSION
        self._last = -1  # number of the last entry
        self._window, self._window_at = b"", 0  # some bytes of the stream, and their position
        self._longest = MAX_RECORD  # longer records are not tried: see _allowed
        self._in_vain = 0
        self._size = 0  # of the stream when its end was last checked: central may write on
        self._searched = (-1, -1)  # start and stream size of the last search without a result

    def __iter__(self) -> Iterator[Entry]:
        """Yield the entries from ``offset`` on. Raises JournalDamaged, naming the byte, at damage
        before the end.
        """
        self._window = b""  # the stream may have grown since
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
            if not self._opened:
                self._read_version(payload, entry)
            if entry is None:
                self.holes.append(self.offset)
            else:
                self._last = entry.number
                yield entry
            self.offset += _HEAD + len(payload)
        self._check_end()

    # --- records ----------------------------------------------------------------------------------

    def _payload(self) -> bytes | None:
        """Return the payload of the record at ``offset``; None if there is no sound one."""
        window, at = self._window, self.offset - self._window_at
        if at < 0 or at + _HEAD > len(window):
            window, at = self._load(self.offset, _HEAD), 0
            if len(window) < _HEAD:
                return None
        mark, length, second_mark, checksum = _unpack_head(window, at)
        if mark != UINT32 or second_mark != UINT32 or length > self._longest:
            return None
        end = at + _HEAD + length
        if end > len(window):
            window, at, end = self._load(self.offset, _HEAD + length), 0, _HEAD + length
            if end > len(window):
                return None
        payload = window[at + _HEAD : end]
        return payload if crc32(payload) == checksum else None

    def _load(self, place: int, size: int) -> bytes:
        """Load these bytes into the window, as far as they exist."""
        self._stream.seek(place)
        self._window, self._window_at = self._stream.read(max(size, _CHUNK)), place
        return self._window

    def _bytes(self, place: int, size: int) -> bytes:
        at = place - self._window_at
        if at < 0 or at + size > len(self._window):
            self._load(place, size)
            at = 0
        return self._window[at : at + size]

    def _length(self, place: int) -> int | None:
        """Return the size of the payload, as its frame says; None if there is no frame."""
        frame = self._bytes(place, _HEAD)
        if len(frame) < _HEAD:
            return None
        mark, length, second_mark, _ = FRAME.unpack(frame)
        return (
            int(length)
            if (mark, second_mark) == (UINT32, UINT32) and length <= MAX_RECORD
            else None
        )

    def _is_sound(self, place: int, size: int) -> bool:
        """Return whether a sound record starts there, in a stream of that size."""
        length = self._length(place)
        if length is None or place + _HEAD + length > size or length > self._allowed(place):
            return False
        record_bytes = self._bytes(place, _HEAD + length)
        payload = memoryview(record_bytes)[_HEAD:]
        if len(payload) == length and crc32(payload) == _unpack_head(record_bytes)[3]:
            return True
        self._in_vain += _HEAD + length
        return False

    def _allowed(self, place: int) -> int:
        """Return the longest record to try after damage.

        It bounds the bytes read in vain by a multiple of the bytes before. Reading takes linear
        time, even for a forged file whose lengths lead nowhere.
        """
        return MAX_RECORD + _SPARE * place - self._in_vain

    # --- damage -----------------------------------------------------------------------------------

    def _skip_damage(self) -> bool:
        """Skip damage to the next sound record; return whether there is one."""
        size = self._size = self._stream.seek(0, 2)
        if self.offset >= size or self._searched == (self.offset, size):
            return False
        place, skipped = self._by_frames(size)
        if place is None:
            place, skipped = self._by_search(size), [self.offset]
            self.is_counted = self.is_counted and place is None
        if place is None:
            self._searched = (self.offset, size)
            return False
        self.holes += skipped
        self.offset = place
        self._longest = max(min(self._allowed(place), MAX_RECORD), self._length(place) or 0)
        return True

    def _by_frames(self, size: int) -> tuple[int | None, list[int]]:
        """Follow frames to the next sound record; return it and the damaged ones before it."""
        place = self.offset
        skipped: list[int] = []
        while not self._is_sound(place, size):
            length = self._length(place)
            if length is None or length > self._allowed(place) or len(skipped) == _MOST_FRAMES:
                self._in_vain += _STEP * len(skipped)
                return None, []
            skipped.append(place)
            place += _HEAD + length
        return place, skipped

    def _by_search(self, size: int) -> int | None:
        """Search all bytes for the next sound record."""
        place = self.offset + 1
        end = size if self._opened else min(size, MAX_RECORD)  # the first record is a short one
        while place < end:
            if not self._window_at <= place < self._window_at + len(self._window) - _HEAD:
                self._load(place, _CHUNK)
            window, start = self._window, self._window_at
            found = _LIKE_A_RECORD.search(window, place - start)
            while found:
                position = start + found.start()
                if self._is_sound(position, size) and self._may_follow(position):
                    return position
                found = _LIKE_A_RECORD.search(window, found.start() + 1)
            place = max(start + len(window) - _HEAD, place + 1)
            place = max(self._data_from(place, end) - _HEAD, place)
        return None

    def _may_follow(self, place: int) -> bool:
        """Return whether a sound record is an entry that may follow the last one."""
        length = self._length(place) or 0
        try:
            entry = _decode_head(self._bytes(place + _HEAD, length))
        except _UNREADABLE:
            return False
        if entry.number >= self._last or _version_in(entry.facts) is not None:
            return True
        self._in_vain += length
        return False

    def _check_end(self) -> None:
        """End without a further sound record.

        Raises JournalDamaged, unless nothing is left or a torn tail, which may have become whole
        since.
        """
        self.torn = self._size - self.offset
        if self.torn <= 0:
            return
        if not self._opened:
            self._refuse("not a journal of tca central")
        length = self._length(self.offset)
        record = 0 if length is None else _HEAD + length
        if self.torn >= _HEAD and not self._is_zeros(self.offset + record):
            self._refuse("no record starts here" if length is None else "its checksum is wrong")

    def _is_zeros(self, place: int) -> bool:
        """Return whether the rest is empty, or zeros that a file system left after a power cut."""
        while (place := self._data_from(place, self._size)) < self._size:
            self._stream.seek(place)
            chunk = self._stream.read(min(_CHUNK, self._size - place))
            if chunk != _ZEROS[: len(chunk)]:
                return False
            place += max(len(chunk), 1)
        return True

    def _data_from(self, place: int, end: int) -> int:
        """Return the position from *place* on where data is stored.

        A power cut may leave gigabytes of holes.
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
        """Return an entry without its unreadable facts; None if it is not an entry with a valid
        time.
        """
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
        """Read the version from the first sound record, whose form never changes.

        If it has no version, records before it are missing.
        """
        try:
            version = _version_in(_decode_head(payload).facts)
        except _UNREADABLE:
            version = None
        if version is None and entry is None:
            self._refuse("not a journal of tca central")
        if version is not None and version < OLDEST_READ:
            formats = f"format {version}, this one reads {JOURNAL_VERSION}"
            self._refuse(
                f"an earlier version of tca wrote it ({formats}): read it with that version"
            )
        if version is not None:
            self.version = version
        elif not self.holes:
            self.holes.append(self.offset)
            self.is_counted = False
        self._opened = True


def _version_in(facts: Any) -> int | None:
    """Return a segment's version, from its first entry's facts; None for the facts of any other
    entry.
    """
    try:
        kind, version = facts[0][:2]
    except (ValueError, TypeError, IndexError, KeyError):
        return None
    return version if kind == Opened.__struct_config__.tag and isinstance(version, int) else None
