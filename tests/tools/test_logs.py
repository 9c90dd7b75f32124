"""Logs: the segments of one run, torn or damaged segments, and how a log is followed."""

import io
import signal
import struct
import zlib
from pathlib import Path

import msgpack
import pytest
from processes import central
from tools.segments import followed, numbers
from tools.story import Story, walking

from tca_tools.errors import DamagedLog, UnusableLog
from tca_tools.journal.journals import Log, open_log, run_folders
from tca_wire.endpoint import NoHome, default_journals, is_loopback, new_journal, run_number
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import JournalReader, record


def test_directory_is_read_across_segments(tmp_path: Path) -> None:
    story = walking()
    assert numbers(open_log(story.write(tmp_path / "run", segments=3))) == [
        entry.number for entry in story.caused()
    ]


def test_single_segment_can_be_opened(tmp_path: Path) -> None:
    story = walking()
    folder = story.write(tmp_path / "run", segments=2)
    second = numbers(open_log(folder / "00000002.tcaj"))
    assert second == [entry.number for entry in story.caused()][-len(second) :]
    assert open_log(folder).name == "run"


def test_newest_run_has_the_highest_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    first = new_journal()
    walking().write(first)
    second = new_journal()
    second = walking().write(
        second.with_name(f"{second.name[:7]}1970-01-01T00-00-09-1")
    )  # a robot whose clock has no battery
    third = new_journal()
    third.mkdir()  # a run that wrote nothing
    assert run_number(third) == 3
    assert open_log(None).path == second
    assert list(run_folders()) == [second, first]


def test_missing_home_names_xdg_state_home(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("HOME", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("os.getuid", lambda: 999_999)
    with pytest.raises(NoHome, match="XDG_STATE_HOME"):
        default_journals()


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("tcp://127.0.0.1:5", True),
        ("tcp://127.9.9.9:*", True),
        ("tcp://localhost:5", True),
        ("tcp://[::1]:5", True),
        ("tcp://127.0.0.1.evil.com:5", False),
        ("tcp://localhost.evil.com:5", False),
        ("tcp://0.0.0.0:5", False),
    ],
)
def test_is_loopback_compares_the_whole_host(address: str, *, expected: bool) -> None:
    assert is_loopback(address) is expected


def test_open_log_fails_without_any_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    with pytest.raises(UnusableLog, match="no journal below"):
        open_log(None)
    monkeypatch.delenv("XDG_STATE_HOME")
    assert default_journals().parts[-4:] == (".local", "state", "tca", "journals")


def test_open_log_refuses_paths_without_a_journal(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(UnusableLog, match="no such file"):
        open_log(tmp_path / "nothing")
    with pytest.raises(UnusableLog, match="a directory without segments"):
        open_log(tmp_path / "empty")
    walking().write(tmp_path / "best" / "journal")
    with pytest.raises(
        UnusableLog, match=f"name the journal of one run, such as {tmp_path / 'best' / 'journal'}$"
    ):
        open_log(tmp_path / "best")
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
def test_file_that_is_not_a_journal_is_refused(
    tmp_path: Path, content: bytes, complaint: str
) -> None:
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(content)
    with pytest.raises(UnusableLog, match=complaint):
        list(open_log(path))


def test_unreadable_segment_is_refused(tmp_path: Path) -> None:
    (tmp_path / "00000001.tcaj").mkdir()
    with pytest.raises(UnusableLog, match="can't be read: Is a directory"):
        list(open_log(tmp_path))


def test_torn_tail_is_reported_but_is_not_damage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    story = walking()
    path = tmp_path / "00000001.tcaj"
    whole = b"".join(map(record, story.caused()[:-1]))
    path.write_bytes(story.encoded()[: len(whole) + 9])
    log = open_log(path)
    assert len(numbers(log)) == len(story.entries) - 1
    assert (
        log.cut == f"{path}, byte {len(whole)}: cut off: the last 9 bytes are not a complete entry"
    )
    log.check()
    assert capsys.readouterr().err == f"tca: {log.cut}; the entries before it are shown\n"


def test_whole_journal_gives_no_remark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = open_log(walking().write(tmp_path / "run", segments=2))
    assert numbers(log)
    log.check()
    assert (log.cut, capsys.readouterr().err) == ("", "")


@pytest.mark.slow
def test_entry_being_written_is_not_a_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
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
        assert "cut off: the last" in capsys.readouterr().err


@pytest.mark.parametrize("behind", [b"\xce and then garbage", b"\xce", bytes(100), None])
def test_segments_after_a_damaged_one_are_read(tmp_path: Path, behind: bytes | None) -> None:
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
    assert [number for number in followed(followed_log, lambda: None) if number] == numbers(
        open_log(folder)
    )
    for one in (log, followed_log):
        with pytest.raises(
            DamagedLog, match=r"00000002.tcaj.*; the rest of that file is left out$"
        ):
            one.check()


def test_later_version_is_read_as_far_as_known_with_a_remark(
    tmp_path: Path,
) -> None:
    later = [0, 0.0, [["opened", JOURNAL_VERSION + 1, "e", 1, 0.0, "9.9"]]]
    new = [[1, 1.0, [["walked", 3], ["leapt", 4]]], [2, 2.0, [["closed", "enough"], ["flew", 1]]]]
    payloads = [msgpack.packb(one) for one in (later, *new)]
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(
        b"".join(
            struct.pack(">BIBI", 206, len(one), 206, zlib.crc32(one)) + one for one in payloads
        )
    )
    log = open_log(path)
    assert numbers(log) == [1, 2]
    assert log.losses.facts == 3
    versions = rf"later version \({JOURNAL_VERSION + 1}; this one reads up to {JOURNAL_VERSION}\)"
    remark = (
        versions
        + r", .*: upgrade tca; .*, byte \d+, after 0.000 s: 3 facts that this version does not know are left out"
    )
    with pytest.raises(DamagedLog, match=remark):
        log.check()


def test_journal_without_its_beginning_shows_the_rest(tmp_path: Path) -> None:
    story = walking()
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(b"".join(map(record, story.caused()[2:])))
    log = open_log(path)
    assert numbers(log) == [entry.number for entry in story.caused()[2:]]
    with pytest.raises(
        DamagedLog,
        match=r"byte 0, after 0.000 s: at least one entry, damaged or missing, is left out",
    ):
        log.check()


@pytest.mark.parametrize(
    ("damaged", "remark"),
    [
        (
            [4],
            "byte {}, after 0.500 s: a damaged entry is left out: tasks that seem to be running since then may have ended",
        ),
        (
            [4, 5, 7],
            "byte {}, after 0.500 s: 3 damaged entries are left out, the first one here: tasks that seem",
        ),
    ],
)
def test_damaged_entries_are_left_out_and_reported(
    tmp_path: Path, damaged: list[int], remark: str
) -> None:
    story = walking()
    folder = story.write(tmp_path / "run")
    content = bytearray((folder / "00000001.tcaj").read_bytes())
    starts = [
        sum(len(record(entry)) for entry in story.caused()[:place])
        for place in range(len(story.entries))
    ]
    for place in damaged:
        content[starts[place] + 15] ^= 0xFF
    (folder / "00000001.tcaj").write_bytes(content)
    log, followed = open_log(folder), open_log(folder)
    kept = [entry.number for place, entry in enumerate(story.entries) if place not in damaged]
    assert numbers(log) == kept
    assert [entry.number for _, entry in zip(kept, followed.follow(), strict=False)] == kept
    for one in (log, followed):
        with pytest.raises(DamagedLog, match=remark.format(starts[damaged[0]])):
            one.check()
        assert one.remarks == one.losses.lines


def test_follow_sees_added_entries_and_new_segments(tmp_path: Path) -> None:
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
    """A log that gets an entry and a new segment just before its second list of segments."""

    asked = 0

    def segments(self) -> list[Path]:
        self.asked += 1
        if self.asked == 2:
            with (self.path / "00000001.tcaj").open("ab") as stream:
                stream.write(record(Entry(2, 2.0, [])))
            opening = facts.Opened(JOURNAL_VERSION, "epoch", 2, 0.0, "0.1.0")
            (self.path / "00000002.tcaj").write_bytes(record(Entry(3, 3.0, [opening])))
        return super().segments()


def test_follow_sees_entries_written_just_before_a_new_segment(tmp_path: Path) -> None:
    assert followed(Rolling(Story().write(tmp_path / "run"))) == [1, 2, 3]


def test_follow_ends_at_damage_with_nothing_behind_it(tmp_path: Path) -> None:
    path = tmp_path / "00000001.tcaj"
    path.write_bytes(walking().encoded() + b"\xce garbage, and much of it")
    log = open_log(path)
    assert list(log.follow(lambda: None))
    with pytest.raises(DamagedLog):
        log.check()
