"""Journal records: cut anywhere, flipped anywhere, foreign or from the future; never a wrong fact."""

import io

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tca_wire.errors import JournalDamaged
from tca_wire.facts import Dropped, Entry, Fact, Opened, Reached, kind_of
from tca_wire.journal import JournalReader, record
from tca_wire.points import Moment, TaskId, describe_moments
from tca_wire.wording import fields_of

ENTRIES = [
    Entry(0, 0.0, [Opened(1, "epoch", 1, 1e9, "0.1")]),
    Entry(1, 0.5, [Reached(TaskId(3), 5), Dropped(4, "why")]),
    Entry(2, 0.75, [Reached(TaskId(3), 58)]),
]
BYTES = b"".join(map(record, ENTRIES))
ENDS = [sum(len(record(entry)) for entry in ENTRIES[:count]) for count in range(4)]


def read(data: bytes) -> tuple[list[Entry], JournalReader]:
    reader = JournalReader(io.BytesIO(data), "walk")
    return list(reader), reader


@pytest.mark.parametrize("cut", range(len(BYTES) + 1))
def test_a_torn_tail_keeps_every_whole_entry(cut: int) -> None:
    whole = max(count for count, end in enumerate(ENDS) if end <= cut)
    if whole == 0 and cut:
        with pytest.raises(JournalDamaged, match="walk: not a journal"):
            read(BYTES[:cut])
        return
    entries, reader = read(BYTES[:cut])
    assert entries == ENTRIES[:whole]
    assert (reader.offset, reader.torn) == (ENDS[whole], cut - ENDS[whole])


@given(st.integers(0, len(BYTES) - 1), st.integers(0, 7))
def test_no_flipped_bit_goes_unnoticed(at: int, bit: int) -> None:
    damaged = bytearray(BYTES)
    damaged[at] ^= 1 << bit
    try:
        entries, reader = read(bytes(damaged))
    except JournalDamaged:
        return
    assert entries in (ENTRIES[: len(entries)], [ENTRIES[0], ENTRIES[2]])
    assert len(entries) < len(ENTRIES)
    assert reader.torn or reader.holes == [ENDS[1]]


def test_journals_from_before_it_was_noted_who_asked_are_read() -> None:
    older = [["suspended", 3, True], ["killed", 3, "why"], ["retried", 3, b""], ["removed", 3]]
    told = msgspec.convert(older, list[Fact])
    assert [getattr(fact, "by", None) for fact in told] == [""] * 4
    assert msgspec.to_builtins(msgspec.convert([[*fact, "panel"] for fact in older], list[Fact]))[0][-1] == "panel"


def flipped(*places: int) -> bytes:
    damaged = bytearray(BYTES + record(Entry(3, 1.0, [])) + record(Entry(4, 2.0, [])))
    for place in places:
        damaged[place] ^= 1
    return bytes(damaged)


@pytest.mark.parametrize("numbers", [[1], [2], [1, 2], [1, 3], [1, 2, 3]])
def test_entries_that_are_damaged_inside_are_passed_over(numbers: list[int]) -> None:
    starts = [*ENDS[:-1], len(BYTES)]
    entries, reader = read(flipped(*(starts[number] + 14 for number in numbers)))
    assert [entry.number for entry in entries] == [number for number in range(5) if number not in numbers]
    assert reader.holes == [starts[number] for number in numbers]
    assert (reader.offset, reader.torn) == (len(flipped()), 0)


@pytest.mark.parametrize(
    ("places", "why"),
    [
        ((ENDS[1] + 14, ENDS[2] + 1), "its checksum is wrong"),  # the way to what follows is not known
        ((ENDS[1], ENDS[2] + 14), "there is no record here"),
    ],
)
def test_damage_that_hides_what_follows_is_named_by_its_byte(places: tuple[int, ...], why: str) -> None:
    with pytest.raises(JournalDamaged, match=f"walk, byte {ENDS[1]}: {why}"):
        read(flipped(*places))


def test_a_journal_whose_first_entry_is_damaged_may_be_of_any_version() -> None:
    with pytest.raises(JournalDamaged, match="walk: its checksum is wrong"):
        read(flipped(15))


def test_a_tail_of_zeros_is_a_torn_tail() -> None:
    entries, reader = read(BYTES + bytes(4096))
    assert entries == ENTRIES
    assert reader.torn == 4096


@pytest.mark.parametrize(
    "data", [b"hello, I am a text file that is long enough", bytes(100), b"\xce" * 50, b"\x89PNG\r\n\x1a\n" * 4]
)
def test_foreign_files_are_refused(data: bytes) -> None:
    with pytest.raises(JournalDamaged, match="walk: not a journal of tca central"):
        read(data)


def test_a_journal_of_a_later_version_says_so() -> None:
    later = record(Entry(0, 0.0, [Opened(99, "epoch", 1, 1e9, "9.0")]))
    with pytest.raises(JournalDamaged, match="written by a later version"):
        read(later)


def test_reading_goes_on_where_it_stopped_when_the_journal_grows() -> None:
    stream = io.BytesIO(BYTES[: ENDS[1] + 7])
    reader = JournalReader(stream)
    assert list(reader) == ENTRIES[:1]
    stream.seek(0, 2)
    stream.write(BYTES[ENDS[1] + 7 :])
    assert list(reader) == ENTRIES[1:]
    assert list(reader) == []


def test_any_messagepack_reader_can_walk_a_segment() -> None:
    values = list(msgpack.Unpacker(io.BytesIO(BYTES)))
    assert [value[0] for value in values[2::3]] == [0, 1, 2]


def test_facts_have_text_forms() -> None:
    fact: Fact = Reached(TaskId(3), int(Moment.START_HANDLING | Moment.END_ACHIEVING))
    assert kind_of(fact) == "reached"
    assert fields_of(fact) == {"task": 3, "moments": ["start handling", "end achieving"]}
    assert describe_moments(0) == []


def test_an_entry_too_big_for_a_record_becomes_several_of_the_same_number() -> None:
    told: list[Fact] = [Dropped(number, "x" * (8 << 20)) for number in range(9)]
    entries, _ = read(BYTES + record(Entry(3, 1.0, told)))
    parts = entries[len(ENTRIES) :]
    assert len(parts) == 2
    assert [fact for part in parts for fact in part.facts] == told
    assert {(part.number, part.time) for part in parts} == {(3, 1.0)}
