"""Journal records to bytes and back, on any binary stream. Knows nothing of what the facts mean.

A segment is a plain MessagePack stream that any language's reader can walk: for each record an
integer (the payload's length), an integer (its CRC-32) and the payload, an Entry. The integers are
always written in five bytes (``ce`` and 32 bits, big endian), so a record's frame has a fixed size.
A record that the end of the file cuts short is a torn tail: what central was writing when the
machine went down. What is damaged is passed over, up to the next record that is sound; so are facts
and entries that this version does not know. Only what is no journal at all is an error, and damage
with nothing sound behind it.
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
"""A frame, and the beginning of an array: of what else is in a journal one byte in millions looks
so.
"""
_CHUNK = 1 << 20
_ZEROS = bytes(_CHUNK)
_SEEK_DATA: int | None = getattr(os, "SEEK_DATA", None)
_MOST_FRAMES = 100
"""Damaged records in a row that are told apart."""
_STEP = 1 << 10
"""A frame that leads nowhere counts as if so many bytes were read in vain: it takes as long."""
_SPARE = 8
"""So many times its own size may be read in vain while sound records are looked for: see
``_allowed``.
"""


class _Roughly(msgspec.Struct, array_like=True):
    """An entry whose facts and cause may be anything."""

    number: EntryNumber
    time: EntryTime
    facts: list[msgspec.Raw]
    cause: msgspec.Raw = msgspec.Raw(b"\xc0")


class _Numbered(msgspec.Struct, array_like=True):
    """An entry of which only the number is looked at, and the first fact."""

    number: int
    time: Any
    facts: Any


_UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(Entry).decode
_decode_roughly = msgspec.msgpack.Decoder(_Roughly).decode
_decode_number = msgspec.msgpack.Decoder(_Numbered).decode
_decode_fact = msgspec.msgpack.Decoder(Fact).decode
_decode_cause = msgspec.msgpack.Decoder(Cause | None).decode


def record(entry: Entry) -> bytes:
    """*entry* as one journal record, or as several of the same number where it is too big for one:
    a million tasks may be killed by one event.
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
    """Reads the entries of one segment; at its present end it stops, and goes on when iterated
    again.

    It may begin at the *offset* of a record that was read before. ``offset`` is the byte behind the
    last good record, ``torn`` the number of bytes behind it that are no whole record. ``holes`` are
    the places of the damaged records that were passed over; where not ``is_counted`` some of them
    stand for several that can't be told apart. ``unknown`` is the number of facts that this version
    does not know, and left out; ``version`` that of the segment.

    After damage, sound is a record whose checksum is right, and whose number is not below that of
    the last entry: what a message's data hold may look like a record, too.
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
        self._window, self._window_at = (
            b"",
            0,
        )  # some bytes of the stream, and where they stand in it
        self._longest = MAX_RECORD  # no longer record is looked at: see _allowed
        self._in_vain = 0
        self._size = 0  # of the stream, when its end was looked at: meanwhile central writes on
        self._searched = (-1, -1)  # from where, to what size of the stream: nothing sound is there

    def __iter__(self) -> Iterator[Entry]:
        """The entries from ``offset`` on. Raises JournalDamaged, naming the byte, where there are
        no more of them.
        """
        self._window = b""  # bytes that came since
        while True:
            payload = self._payload()
            if payload is None:
                if self._pass_over():
                    continue
                break
            try:
                entry: Entry | None = _decode(payload)
            except _UNREADABLE:
                entry = self._what_is_known(payload)
            if not self._opened:
                self._begin(payload, entry)
            if entry is None:
                self.holes.append(self.offset)
            else:
                self._last = entry.number
                yield entry
            self.offset += _HEAD + len(payload)
        self._end()

    # --- records ----------------------------------------------------------------------------------

    def _payload(self) -> bytes | None:
        """The payload of the record at ``offset``; None if no sound one is there."""
        window, at = self._window, self.offset - self._window_at
        if at < 0 or at + _HEAD > len(window):
            window, at = self._look_at(self.offset, _HEAD), 0
            if len(window) < _HEAD:
                return None
        mark, length, mark_too, checksum = _unpack_head(window, at)
        if mark != UINT32 or mark_too != UINT32 or length > self._longest:
            return None
        end = at + _HEAD + length
        if end > len(window):
            window, at, end = self._look_at(self.offset, _HEAD + length), 0, _HEAD + length
            if end > len(window):
                return None
        payload = window[at + _HEAD : end]
        return payload if crc32(payload) == checksum else None

    def _look_at(self, place: int, size: int) -> bytes:
        """Have these bytes in the window, as far as they are there."""
        self._stream.seek(place)
        self._window, self._window_at = self._stream.read(max(size, _CHUNK)), place
        return self._window

    def _bytes(self, place: int, size: int) -> bytes:
        at = place - self._window_at
        if at < 0 or at + size > len(self._window):
            self._look_at(place, size)
            at = 0
        return self._window[at : at + size]

    def _length(self, place: int) -> int | None:
        """The size of the payload, as its frame gives it; None if there is no frame."""
        frame = self._bytes(place, _HEAD)
        if len(frame) < _HEAD:
            return None
        mark, length, mark_too, _ = FRAME.unpack(frame)
        return (
            int(length) if (mark, mark_too) == (UINT32, UINT32) and length <= MAX_RECORD else None
        )

    def _is_sound(self, place: int, size: int) -> bool:
        """Whether a record is there, in a stream of that size."""
        length = self._length(place)
        if length is None or place + _HEAD + length > size or length > self._allowed(place):
            return False
        both = self._bytes(place, _HEAD + length)
        payload = memoryview(both)[_HEAD:]
        if len(payload) == length and crc32(payload) == _unpack_head(both)[3]:
            return True
        self._in_vain += _HEAD + length
        return False

    def _allowed(self, place: int) -> int:
        """The longest record to try after damage. Bytes read in vain add up to a few times of those
        behind: the time to read stays linear, even for a forged file of lengths that lead nowhere.
        """
        return MAX_RECORD + _SPARE * place - self._in_vain

    # --- damage -----------------------------------------------------------------------------------

    def _pass_over(self) -> bool:
        """Skip damage to the next sound record; whether there is one."""
        size = self._size = self._stream.seek(0, 2)
        if self.offset >= size or self._searched == (self.offset, size):
            return False
        place, passed = self._by_frames(size)
        if place is None:
            place, passed = self._by_looks(size), [self.offset]
            self.is_counted = self.is_counted and place is None
        if place is None:
            self._searched = (self.offset, size)
            return False
        self.holes += passed
        self.offset = place
        self._longest = max(min(self._allowed(place), MAX_RECORD), self._length(place) or 0)
        return True

    def _by_frames(self, size: int) -> tuple[int | None, list[int]]:
        """The next sound record that frames lead to, and those that are damaged before it."""
        place = self.offset
        passed: list[int] = []
        while not self._is_sound(place, size):
            length = self._length(place)
            if length is None or length > self._allowed(place) or len(passed) == _MOST_FRAMES:
                self._in_vain += _STEP * len(passed)
                return None, []
            passed.append(place)
            place += _HEAD + length
        return place, passed

    def _by_looks(self, size: int) -> int | None:
        """The next sound record whatever is before it."""
        place, end = (
            self.offset + 1,
            size if self._opened else min(size, MAX_RECORD),
        )  # the first record is a short one
        while place < end:
            if not self._window_at <= place < self._window_at + len(self._window) - _HEAD:
                self._look_at(place, _CHUNK)
            window, start = self._window, self._window_at
            found = _LIKE_A_RECORD.search(window, place - start)
            while found:
                here = start + found.start()
                if self._is_sound(here, size) and self._goes_on(here):
                    return here
                found = _LIKE_A_RECORD.search(window, found.start() + 1)
            place = max(start + len(window) - _HEAD, place + 1)
            place = max(self._data_from(place, end) - _HEAD, place)
        return None

    def _goes_on(self, place: int) -> bool:
        """Whether a sound record is an entry that may come after the last one."""
        length = self._length(place) or 0
        try:
            entry = _decode_number(self._bytes(place + _HEAD, length))
        except _UNREADABLE:
            return False
        if entry.number >= self._last or _version_in(entry.facts) is not None:
            return True
        self._in_vain += length
        return False

    def _end(self) -> None:
        """End without a further sound record. Raises JournalDamaged, unless nothing is left or a
        torn tail, which may have become whole since.
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
        """Whether nothing was there, or what some file systems leave after a power cut."""
        while (place := self._data_from(place, self._size)) < self._size:
            self._stream.seek(place)
            chunk = self._stream.read(min(_CHUNK, self._size - place))
            if chunk != _ZEROS[: len(chunk)]:
                return False
            place += max(len(chunk), 1)
        return True

    def _data_from(self, place: int, end: int) -> int:
        """Where from *place* on something is stored: what a power cut leaves may be gigabytes of
        nothing.
        """
        if _SEEK_DATA is not None and place < end:
            try:
                return min(self._stream.seek(place, _SEEK_DATA), end)
            except OSError as error:
                return end if error.errno == errno.ENXIO else place
            except ValueError:  # no file
                pass
        return place

    def _refuse(self, why: str) -> None:
        at = f", byte {self.offset}" if self.offset else ""
        raise JournalDamaged(f"{self._name}{at}: {why}")

    # --- facts of other versions ------------------------------------------------------------------

    def _what_is_known(self, payload: bytes) -> Entry | None:
        """An entry without the facts that can't be read; None if it is no entry, or has a time that
        is none.
        """
        try:
            entry = _decode_roughly(payload)
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

    def _begin(self, payload: bytes, entry: Entry | None) -> None:
        """The first sound record: it says the version, in a form that never changes. If it does
        not, others are missing before it.
        """
        try:
            version = _version_in(_decode_number(payload).facts)
        except _UNREADABLE:
            version = None
        if version is None and entry is None:
            self._refuse("not a journal of tca central")
        if version is not None and version < OLDEST_READ:
            written = f"an earlier version of tca wrote it (format {version}, this one reads {JOURNAL_VERSION})"
            self._refuse(f"{written}: read it with that version")
        if version is not None:
            self.version = version
        elif not self.holes:
            self.holes.append(self.offset)
            self.is_counted = False
        self._opened = True


def _version_in(facts: Any) -> int | None:
    """The version of a segment, from the facts of its first entry; None if they are of any other
    entry.
    """
    try:
        kind, version = facts[0][:2]
    except (ValueError, TypeError, IndexError, KeyError):
        return None
    return version if kind == Opened.__struct_config__.tag and isinstance(version, int) else None
