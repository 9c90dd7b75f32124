"""Journal records that are cut, damaged, foreign or of another version never yield a wrong fact."""

import io
import os
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tca_wire.errors import JournalDamaged
from tca_wire.journal import frames
from tca_wire.journal.facts import (
    JOURNAL_VERSION,
    OLDEST_READ,
    Delivered,
    Dropped,
    Entry,
    Fact,
    Opened,
    Reached,
    Returned,
    kind_of,
)
from tca_wire.journal.frames import MAX_RECORD
from tca_wire.journal.records import JournalReader, record
from tca_wire.points import Moment, TaskId, describe_moments
from tca_wire.text.facts_in_words import fields_of
from tca_wire.vocabulary import Outcome

ENTRIES = [
    Entry(0, 0.0, [Opened(JOURNAL_VERSION, "epoch", 1, 1e9, "0.1")]),
    Entry(1, 0.5, [Reached(TaskId(3), 5), Dropped(4, "any", "why")]),
    Entry(2, 0.75, [Reached(TaskId(3), 58)]),
]
BYTES = b"".join(map(record, ENTRIES))
ENDS = [sum(len(record(entry)) for entry in ENTRIES[:count]) for count in range(4)]


def read(data: bytes) -> tuple[list[Entry], JournalReader]:
    reader = JournalReader(io.BytesIO(data), "walk")
    return list(reader), reader


def test_torn_tail_keeps_every_whole_entry() -> None:
    for cut in range(1, ENDS[1]):
        with pytest.raises(JournalDamaged, match="walk: not a journal"):
            read(BYTES[:cut])
    for cut in (0, *range(ENDS[1], len(BYTES) + 1)):
        whole = max(count for count, end in enumerate(ENDS) if end <= cut)
        entries, reader = read(BYTES[:cut])
        assert (entries, reader.offset, reader.torn) == (
            ENTRIES[:whole],
            ENDS[whole],
            cut - ENDS[whole],
        )


@pytest.mark.parametrize("bit", range(8))
def test_flipped_bit_is_detected(bit: int) -> None:
    for at in range(len(BYTES)):
        damaged = bytearray(BYTES)
        damaged[at] ^= 1 << bit
        with suppress(JournalDamaged):
            check_flipped(at, *read(bytes(damaged)))


def check_flipped(at: int, entries: list[Entry], reader: JournalReader) -> None:
    lost = next(number for number in range(3) if at < ENDS[number + 1])
    assert entries == [entry for entry in ENTRIES if entry.number != lost]
    assert (reader.holes == [ENDS[lost]]) if lost < 2 else reader.torn


def test_outdated_journal_is_refused_with_advice() -> None:
    older = b"".join(
        framed([number, 0.0, facts])
        for number, facts in enumerate([[["opened", 1, "e", 1, 1e9, "0"]], []])
    )
    message = f"walk: an earlier version of tca wrote it \\(format 1, this one reads {OLDEST_READ} to {JOURNAL_VERSION}\\): read it with that"
    with pytest.raises(JournalDamaged, match=message):
        read(older)


def test_journal_of_the_previous_version_is_read() -> None:
    facts = [
        ["opened", 4, "e", 1, 1e9, "0"],
        ["delivered", 1, 1, "legs", "legs", 1, False, 0],
        ["returned", 1, "done", b""],
    ]
    entries, reader = read(framed([0, 0.0, facts]))
    assert entries[0].facts[1:] == [
        Delivered(1, 1, "legs", "legs", 1),
        Returned(1, Outcome.DONE, b""),
    ]
    assert (reader.version, reader.unknown) == (4, 0)


def flipped(*places: int) -> bytes:
    damaged = bytearray(BYTES + record(Entry(3, 1.0, [])) + record(Entry(4, 2.0, [])))
    for place in places:
        damaged[place] ^= 1
    return bytes(damaged)


@pytest.mark.parametrize("numbers", [[1], [2], [1, 2], [1, 3], [1, 2, 3]])
def test_entries_damaged_inside_are_skipped(numbers: list[int]) -> None:
    starts = [*ENDS[:-1], len(BYTES)]
    entries, reader = read(flipped(*(starts[number] + 14 for number in numbers)))
    assert [entry.number for entry in entries] == [
        number for number in range(5) if number not in numbers
    ]
    assert reader.holes == [starts[number] for number in numbers]
    assert (reader.offset, reader.torn) == (len(flipped()), 0)


@pytest.mark.parametrize(
    "places", [(ENDS[1] + 14, ENDS[2] + 1), (ENDS[1], ENDS[2] + 14), (ENDS[1] + 2, ENDS[2] + 5)]
)
def test_entries_with_damaged_frames_are_skipped(
    places: tuple[int, ...],
) -> None:
    entries, reader = read(flipped(*places))
    assert [entry.number for entry in entries] == [0, 3, 4]
    assert (reader.holes, reader.is_counted, reader.torn) == ([ENDS[1]], False, 0)


def long_journal(entries: int = 3000) -> list[Entry]:
    return [
        ENTRIES[0],
        *(
            Entry(number, number / 8, [Dropped(number, "any", "x" * 90)])
            for number in range(1, entries)
        ),
    ]


@pytest.mark.parametrize(
    "filler", [b"", bytes(50_000), b"\xce" * 50_000, b"\xce\x00\x00\x00\x20" * 20_000]
)
def test_missing_or_overwritten_part_is_skipped(filler: bytes) -> None:
    whole = long_journal()
    data = b"".join(map(record, whole))
    at, behind = 100_123, 150_321
    entries, reader = read(data[:at] + filler + data[behind:])
    ends = [0]
    for entry in whole:
        ends.append(ends[-1] + len(record(entry)))
    assert entries == [
        one for one in whole if ends[one.number + 1] <= at or ends[one.number] >= behind
    ]
    assert (len(reader.holes), reader.torn) == (1, 0)


def test_journal_without_a_sound_first_entry_is_read() -> None:
    for data in (flipped(15), flipped(0), flipped()[ENDS[1] :], flipped()[ENDS[1] - 7 :]):
        entries, reader = read(data)
        assert [entry.number for entry in entries] == [1, 2, 3, 4]
        assert reader.holes == [0]


def test_damage_without_later_entries_is_named_by_its_byte() -> None:
    with pytest.raises(JournalDamaged, match=f"walk, byte {len(BYTES)}: no record starts here"):
        read(BYTES + b"\xce and then garbage")
    with pytest.raises(JournalDamaged, match=f"walk, byte {ENDS[2]}: its checksum is wrong"):
        read(BYTES[: ENDS[2] + 12] + b"x" * 100)


def test_journal_inside_a_message_is_not_read_as_entries() -> None:
    """A module sent a part of the journal as data. The frame of the entry with this data is
    damaged.
    """
    held = Entry(
        4, 1.5, [Returned(4, Outcome.DONE, b"".join(map(record, [ENTRIES[2], Entry(2, 9.0, [])])))]
    )
    data = bytearray(BYTES + record(Entry(3, 1.0, [])) + record(held) + record(Entry(5, 2.0, [])))
    data[len(BYTES) + len(record(Entry(3, 1.0, []))) + 1] ^= 1
    entries, _ = read(bytes(data))
    assert [(entry.number, entry.time) for entry in entries] == [
        (0, 0.0),
        (1, 0.5),
        (2, 0.75),
        (3, 1.0),
        (5, 2.0),
    ]


class CountingStream(io.BytesIO):
    """A stream that counts the bytes that are read from it."""

    taken = 0

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        self.taken += len(found)
        return found


COUNT = 10_000


def lies() -> bytes:
    """Return many frames, each with the length of the rest of the file."""
    frames = (
        struct.pack(">BIBIB", 0xCE, 11 * (COUNT - number) - 10, 0xCE, 7, 0x93)
        for number in range(COUNT)
    )
    return BYTES + b"\xce" + b"".join(frames) + record(Entry(3, 1.0, []))


def leaps() -> bytes:
    """Return good entries, with frames between them. All these frames end at the same worthless
    frames.
    """
    good = [record(Entry(3 + number, 1.0, [])) for number in range(COUNT)]
    size = sum(10 + len(one) for one in good)
    parts = [BYTES]
    for one in good:
        size -= 10 + len(one)
        parts.append(struct.pack(">BIBI", 0xCE, size + len(one), 0xCE, 7) + one)
    return (
        b"".join(parts)
        + struct.pack(">BIBI", 0xCE, 0, 0xCE, 7) * COUNT
        + b"no frame"
        + record(Entry(COUNT + 3, 2.0, []))
    )


def every_other() -> bytes:
    """Return entries of which every other entry has lost its frame."""
    return BYTES + b"".join(
        bytes(30) + record(Entry(3 + number, 1.0, [])) for number in range(COUNT)
    )


@pytest.mark.parametrize(
    ("make", "entries"), [(lies, 4), (leaps, COUNT + 4), (every_other, COUNT + 3)]
)
def test_search_after_damage_reads_bounded_bytes(make: Callable[[], bytes], entries: int) -> None:
    stream = CountingStream(make())
    size = len(stream.getbuffer())
    reader = JournalReader(stream)
    # Some entries are given up because their search would cost too much.
    assert entries * 0.99 < sum(1 for _ in reader) <= entries
    assert reader._bytes_in_vain <= MAX_RECORD + 9 * size  # bytes with a wrong checksum
    assert stream.taken <= 2 * reader._bytes_in_vain + 4 * size


# --- unknown facts and other versions -------------------------------------------------------------


def framed(*values: object) -> bytes:
    """Return framed entries that no central of this version writes."""
    payloads = [msgpack.packb(value) for value in values]
    return b"".join(
        struct.pack(">BIBI", 0xCE, len(one), 0xCE, zlib.crc32(one)) + one for one in payloads
    )


def test_unknown_facts_and_causes_are_skipped() -> None:
    entries, reader = read(
        BYTES + framed([3, 1.0, [["brand new", 1, {"a": 2}], ["reached", 3, 1]], "more"])
    )
    assert entries == [*ENTRIES, Entry(3, 1.0, [Reached(TaskId(3), 1)])]
    # One fact and one cause are unknown.
    assert (reader.unknown, reader.holes, reader.version) == (2, [], JOURNAL_VERSION)


@pytest.mark.parametrize("time", [float("nan"), float("inf"), -1.0, 1e300, "noon"])
def test_entry_with_invalid_time_is_skipped(time: object) -> None:
    entries, reader = read(BYTES + framed([3, time, []]) + record(Entry(4, 2.0, [])))
    assert [entry.number for entry in entries] == [0, 1, 2, 4]
    assert (reader.holes, reader.is_counted) == ([len(BYTES)], True)


@pytest.mark.parametrize(
    "opened", [["opened", 99, "epoch", 1, 1e9, "9.0"], ["opened", 99, {"all": "new"}]]
)
def test_known_facts_of_a_later_version_are_read(opened: list[object]) -> None:
    entries, reader = read(framed([0, 0.0, [opened]], [1, 1.0, [["walked", 3], ["reached", 3, 1]]]))
    assert [len(entry.facts) for entry in entries] == [len(opened) == 6, 1]
    assert (reader.version, reader.unknown, reader.holes) == (99, 2 - (len(opened) == 6), [])


@pytest.mark.parametrize("number", [-1, 1 << 63, (1 << 64) - 1])
def test_entry_with_invalid_number_is_skipped(number: int) -> None:
    entries, reader = read(
        BYTES + framed([number, 1.0, [["reached", 3, 1]]], [3, 1.0, [["reached", 3, 1]]])
    )
    assert entries == [*ENTRIES, Entry(3, 1.0, [Reached(TaskId(3), 1)])]
    assert reader.holes == [len(BYTES)]


def test_zeros_at_the_end_are_a_torn_tail() -> None:
    entries, reader = read(BYTES + bytes(4096))
    assert entries == ENTRIES
    assert reader.torn == 4096
    entries, reader = read(BYTES[:-5] + bytes(4096))  # the last entry is only partly on the disk
    assert (entries, reader.torn) == (ENTRIES[:2], ENDS[3] - ENDS[2] - 5 + 4096)


class CountingFile(io.FileIO):
    """A file that counts the bytes that are read from it."""

    taken = 0

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size) or b""
        self.taken += len(found)
        return found


@pytest.mark.parametrize("cut", [0, 5])
def test_sparse_end_of_file_is_not_read(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(BYTES[: len(BYTES) - cut])
    os.truncate(path, 1 << 30)
    if path.stat().st_blocks * 512 > 1 << 20:
        pytest.skip("this file system has no holes")
    with CountingFile(path) as stream:
        reader = JournalReader(stream, "walk")
        assert list(reader) == ENTRIES[: 3 - bool(cut)]
        assert reader.torn == (1 << 30) - reader.offset
        assert stream.taken < 16 << 20


@pytest.mark.parametrize(
    "data",
    [
        b"hello, I am a text file that is long enough",
        bytes(100),
        b"\xce" * 50,
        b"\x89PNG\r\n\x1a\n" * 4,
    ],
)
def test_foreign_file_is_not_a_journal(data: bytes) -> None:
    with pytest.raises(JournalDamaged, match="walk: not a journal of tca central"):
        read(data)


def test_reading_continues_after_the_journal_grows() -> None:
    stream = io.BytesIO(BYTES[: ENDS[1] + 7])
    reader = JournalReader(stream)
    assert list(reader) == ENTRIES[:1]
    stream.seek(0, 2)
    stream.write(BYTES[ENDS[1] + 7 :])
    assert list(reader) == ENTRIES[1:]
    assert list(reader) == []


class GrowingStream(io.BytesIO):
    """A stream that grows by a few bytes whenever it is read."""

    def __init__(self, data: bytes, begun: int, more: list[int]) -> None:
        super().__init__(data[:begun])
        self._rest, self._more = data[begun:], more

    def _grow(self) -> None:
        here, number = self.tell(), self._more.pop() if self._more else len(self._rest)
        super().seek(0, 2)
        self.write(self._rest[:number])
        super().seek(here)
        self._rest = self._rest[number:]

    def seek(self, place: int, whence: int = 0, /) -> int:
        self._grow()
        return super().seek(place, whence)

    def read(self, size: int | None = -1, /) -> bytes:
        found = super().read(size)
        self._grow()
        return found


@given(st.integers(ENDS[1], len(BYTES)), st.lists(st.integers(0, 40), max_size=30))
def test_reading_during_writes_reports_no_damage(begun: int, more: list[int]) -> None:
    """A torn record may be whole at the next read, with another record behind it."""
    data = BYTES + b"".join(
        record(Entry(number, float(number), ENTRIES[2].facts)) for number in range(3, 12)
    )
    reader = JournalReader(GrowingStream(data, begun, list(more)), "walk")
    found = [entry for _ in range(len(more) + 2) for entry in reader]
    assert [entry.number for entry in found] == list(range(12))
    assert (reader.torn, reader.holes) == (0, [])


def test_segment_is_readable_by_any_messagepack_reader() -> None:
    values = list(msgpack.Unpacker(io.BytesIO(BYTES)))
    assert [value[0] for value in values[2::3]] == [0, 1, 2]


def test_fact_has_a_kind_and_described_fields() -> None:
    fact: Fact = Reached(TaskId(3), int(Moment.START_HANDLING | Moment.END_ACHIEVING))
    assert kind_of(fact) == "reached"
    assert fields_of(fact) == {"task": 3, "moments": ["start handling", "end achieving"]}
    assert describe_moments(0) == []


def test_oversized_entry_is_split_under_one_number() -> None:
    facts: list[Fact] = [Dropped(number, "any", "x" * (8 << 20)) for number in range(9)]
    entries, _ = read(BYTES + record(Entry(3, 1.0, facts)))
    parts = entries[len(ENTRIES) :]
    assert len(parts) == 2
    assert [fact for part in parts for fact in part.facts] == facts
    assert {(part.number, part.time) for part in parts} == {(3, 1.0)}


def test_search_for_a_record_among_fakes_is_bounded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A client may fill a packet with fake frames. A log that is torn inside such a packet must not
    take hours to read.
    """
    fake = struct.pack(">BIBI", 0xCE, 4000, 0xCE, 7) * 1000
    looked_at = 0

    def counted(data: memoryview) -> int:
        nonlocal looked_at
        looked_at += len(data)
        return zlib.crc32(data)

    monkeypatch.setattr(frames, "crc32", counted)
    monkeypatch.setattr(frames, "MAX_RECORD", 0)
    assert frames.has_record(fake)  # the result is not certain, so the operator decides
    assert looked_at <= 9 * len(fake)
    assert not frames.has_record(fake[:2000])
    assert frames.has_record(fake[:2000] + frames.framed(b"an input"))
