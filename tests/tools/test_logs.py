import io
import signal
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import msgpack
import pytest
from integration.programs import central
from tools.story import Story, walking

from tca_tools.errors import DamagedLog, UnusableLog
from tca_tools.run.journals import Log, open_log
from tca_wire.endpoint import default_journals
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import JournalReader, record


def numbers(log: Log) -> list[int]:
    return [entry.number for entry in log if entry.number]


def test_a_directory_continues_from_segment_to_segment(tmp_path: Path) -> None:
    story = walking()
    assert numbers(open_log(story.write(tmp_path / "run", segments=3))) == [entry.number for entry in story.caused()]


def test_a_segment_is_a_log_of_its_own(tmp_path: Path) -> None:
    story = walking()
    folder = story.write(tmp_path / "run", segments=2)
    second = numbers(open_log(folder / "00000002.tcaj"))
    assert second == [entry.number for entry in story.caused()][-len(second) :]
    assert open_log(folder).name == "run"


def test_without_a_path_the_newest_run_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for name in ("20250101-120000", "20250102-080000"):
        walking().write(tmp_path / "tca" / "journals" / name)
    (tmp_path / "tca" / "journals" / "20250103-000000").mkdir()  # a run that wrote nothing
    assert open_log(None).name == "20250102-080000"


def test_no_journal_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with pytest.raises(UnusableLog, match="no journal below"):
        open_log(None)
    monkeypatch.delenv("XDG_STATE_HOME")
    assert default_journals().parts[-4:] == (".local", "state", "tca", "journals")


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(UnusableLog, match="there is no such file"):
        open_log(tmp_path / "nothing")
    with pytest.raises(UnusableLog, match="a directory without segments"):
        open_log(tmp_path / "empty")
    with pytest.raises(UnusableLog, match="neither a file nor a directory"):
        open_log(Path("/dev/null"))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "empty"),
        (b"#!/bin/sh\necho a foreign file\n", "not a journal"),
        (b"\0" * 50, "not a journal"),
        (walking().encoded()[:7], "not a journal"),
    ],
)
def test_what_is_no_journal_is_refused(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(content)
    with pytest.raises(UnusableLog, match=complaint):
        list(open_log(path))


def test_what_cant_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "00000001.tcaj").mkdir()
    with pytest.raises(UnusableLog, match="can't be read: Is a directory"):
        list(open_log(tmp_path))


def test_a_torn_tail_is_no_damage_but_it_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    story = walking()
    path = tmp_path / "00000001.tcaj"
    whole = b"".join(map(record, story.caused()[:-1]))
    path.write_bytes(story.encoded()[: len(whole) + 9])
    log = open_log(path)
    assert len(numbers(log)) == len(story.entries) - 1
    assert log.cut == f"{path}, byte {len(whole)}: cut off, the last 9 bytes are no whole entry"
    log.check()
    assert capsys.readouterr().err == f"tca: {log.cut}; what comes before it is shown\n"


def test_of_a_whole_journal_nothing_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = open_log(walking().write(tmp_path / "run", segments=2))
    assert numbers(log)
    log.check()
    assert (log.cut, capsys.readouterr().err) == ("", "")


@pytest.mark.slow
def test_an_entry_that_is_just_being_written_is_no_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with central(tmp_path) as daemon:
        daemon.signal(signal.SIGSTOP)
        newest = open_log(daemon.journal).segments()[-1]
        with newest.open("ab") as stream:
            stream.write(record(Entry(99, 1.0, []))[:-2])
        log = open_log(daemon.journal)
        list(log)
        log.check()
        assert log.is_being_written
        assert (log.cut, capsys.readouterr().err) == ("", "")
        daemon.signal(signal.SIGKILL)
        daemon.process.wait(timeout=10)
        log.check()
        assert not log.is_being_written
        assert "cut off, the last" in capsys.readouterr().err


@pytest.mark.parametrize("behind", [b"\xce and then garbage", b"\xce", bytes(100), None])
def test_where_the_rest_of_a_segment_cant_be_read_the_next_ones_are(tmp_path: Path, behind: bytes | None) -> None:
    folder = walking().write(tmp_path / "run", segments=3)
    second = folder / "00000002.tcaj"
    whole, cut = numbers(open_log(folder)), second.read_bytes()
    second.unlink()
    if behind is None:
        second.mkdir()
    else:
        second.write_bytes(cut + behind)
    lost = [entry.number for entry in JournalReader(io.BytesIO(cut))] if behind is None else []
    log = open_log(folder)
    assert numbers(log) == [number for number in whole if number not in lost]
    followed_log = open_log(folder)
    assert [number for number in followed(followed_log, lambda: None) if number] == numbers(open_log(folder))
    for one in (log, followed_log):
        with pytest.raises(DamagedLog, match=r"00000002.tcaj.*; what comes behind it in that file is left out$"):
            one.check()


def test_of_a_journal_of_a_later_version_what_is_known_is_shown_and_it_is_said(tmp_path: Path) -> None:
    later = [0, 0.0, [["opened", JOURNAL_VERSION + 1, "e", 1, 0.0, "9.9"]]]
    new = [[1, 1.0, [["walked", 3], ["leapt", 4]]], [2, 2.0, [["closed", "enough"], ["flew", 1]]]]
    payloads = [msgpack.packb(one) for one in (later, *new)]
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(b"".join(struct.pack(">BIBI", 206, len(one), 206, zlib.crc32(one)) + one for one in payloads))
    log = open_log(path)
    assert numbers(log) == [1, 2]
    assert log.losses.facts == 3
    said = r"later version \(3; this one reads up to 2\), .*: upgrade tca; .*, byte \d+, after 0.000 s: 3 facts are left out"
    with pytest.raises(DamagedLog, match=said):
        log.check()


def test_where_the_beginning_is_missing_the_rest_is_shown(tmp_path: Path) -> None:
    story = walking()
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(b"".join(map(record, story.caused()[2:])))
    log = open_log(path)
    assert numbers(log) == [entry.number for entry in story.caused()[2:]]
    with pytest.raises(DamagedLog, match=r"byte 0, after 0.000 s: at least one entry, damaged or missing, is left out"):
        log.check()


@pytest.mark.parametrize(
    ("damaged", "said"),
    [
        ([4], "byte {}, after 0.500 s: a damaged entry is left out: what seems to go on since then may have ended"),
        ([4, 5, 7], "byte {}, after 0.500 s: 3 damaged entries are left out, the first of them here: what seems"),
    ],
)
def test_entries_that_are_damaged_are_left_out_and_it_is_said(tmp_path: Path, damaged: list[int], said: str) -> None:
    story = walking()
    folder = story.write(tmp_path / "run")
    content = bytearray((folder / "00000001.tcaj").read_bytes())
    starts = [sum(len(record(entry)) for entry in story.caused()[:place]) for place in range(len(story.entries))]
    for place in damaged:
        content[starts[place] + 15] ^= 0xFF
    (folder / "00000001.tcaj").write_bytes(content)
    log, followed = open_log(folder), open_log(folder)
    kept = [entry.number for place, entry in enumerate(story.entries) if place not in damaged]
    assert numbers(log) == kept
    assert [entry.number for _, entry in zip(kept, followed.follow(), strict=False)] == kept
    for one in (log, followed):
        with pytest.raises(DamagedLog, match=said.format(starts[damaged[0]])):
            one.check()
        assert one.remarks == one.losses.lines


class Enough(Exception):
    pass


def followed(log: Log, *happenings: Callable[[], object]) -> list[int]:
    """The numbers of the entries that come while these things happen, one a wait."""
    left = list(happenings)

    def wait() -> None:
        if not left:
            raise Enough
        left.pop(0)()

    seen: list[int] = []
    with pytest.raises(Enough):  # noqa: PT012 - what came before the end counts
        for entry in log.follow(wait):
            seen.append(entry.number)  # noqa: PERF401
    return seen


def test_following_sees_what_is_added_and_new_segments(tmp_path: Path) -> None:
    story = Story()
    folder = story.write(tmp_path / "run")
    first, second = folder / "00000001.tcaj", folder / "00000002.tcaj"
    late = record(Entry(9, 9.0, []))

    def add(path: Path, content: bytes) -> None:
        with path.open("ab") as stream:
            stream.write(content)

    opening = record(Entry(10, 10.0, [facts.Opened(JOURNAL_VERSION, "epoch", 2, 0.0, "0.1.0")]))
    seen = followed(
        open_log(folder),
        lambda: add(first, record(Entry(8, 8.0, []))),
        lambda: add(first, late[:5]),
        lambda: add(first, late[5:]),
        lambda: add(second, opening),
        lambda: None,
        lambda: add(second, record(Entry(11, 11.0, []))),
    )
    assert seen == [1, 8, 9, 10, 11]


class Rolling(Log):
    """A log to which central adds an entry, and then a segment, just before it is asked for its segments again."""

    asked = 0

    def segments(self) -> list[Path]:
        self.asked += 1
        if self.asked == 2:
            with (self.path / "00000001.tcaj").open("ab") as stream:
                stream.write(record(Entry(2, 2.0, [])))
            opening = facts.Opened(JOURNAL_VERSION, "epoch", 2, 0.0, "0.1.0")
            (self.path / "00000002.tcaj").write_bytes(record(Entry(3, 3.0, [opening])))
        return super().segments()


def test_what_is_written_before_the_next_segment_begins_is_not_missed(tmp_path: Path) -> None:
    assert followed(Rolling(Story().write(tmp_path / "run"))) == [1, 2, 3]


def test_following_ends_at_damage_with_nothing_behind_it(tmp_path: Path) -> None:
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(walking().encoded() + b"\xce garbage, and much of it")
    log = open_log(path)
    assert list(log.follow(lambda: None))
    with pytest.raises(DamagedLog):
        log.check()
