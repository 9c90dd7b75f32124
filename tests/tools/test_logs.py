import gc
import io
import signal
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import msgpack
import pytest
from click.testing import Result
from processes import central
from tools.runs import walk
from tools.story import Story, walking

from tca_tools.errors import DamagedLog, UnusableLog
from tca_tools.journal.journals import Log, open_log, run_folders
from tca_tools.view.reading import Reading
from tca_wire.endpoint import NoHome, default_journals, is_loopback, new_journal, run_number
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION, Entry
from tca_wire.journal.records import JournalReader, record


def numbers(log: Log) -> list[int]:
    return [entry.number for entry in log if entry.number]


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
    )  # its clock has no battery
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
    with pytest.raises(UnusableLog, match="there is no such file"):
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
    assert log.cut == f"{path}, byte {len(whole)}: cut off, the last 9 bytes are no whole entry"
    log.check()
    assert capsys.readouterr().err == f"tca: {log.cut}; what comes before it is shown\n"


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
        assert "cut off, the last" in capsys.readouterr().err


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
            DamagedLog, match=r"00000002.tcaj.*; what comes behind it in that file is left out$"
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
    said = (
        versions
        + r", .*: upgrade tca; .*, byte \d+, after 0.000 s: 3 facts that this version does not know are left out"
    )
    with pytest.raises(DamagedLog, match=said):
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
    ("damaged", "said"),
    [
        (
            [4],
            "byte {}, after 0.500 s: a damaged entry is left out: what seems to go on since then may have ended",
        ),
        (
            [4, 5, 7],
            "byte {}, after 0.500 s: 3 damaged entries are left out, the first of them here: what seems",
        ),
    ],
)
def test_damaged_entries_are_left_out_and_reported(
    tmp_path: Path, damaged: list[int], said: str
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
    """A log to which central adds an entry, and then a segment, just before it is asked for its
    segments again.
    """

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


# --- folders in which more lies than one run, or less ---------------------------------------------


Tca = Callable[..., Result]
TOOLS = ["tree", "log show", "check"]
"""They all read by way of `Log`."""
YESTERDAY, TODAY = 1_700_000_000.0, 1_700_086_400.0


def segment(
    path: Path, entries: list[Entry], epoch: str, number: int = 1, began: float = YESTERDAY
) -> Path:
    opening = Entry(
        0, entries[0].time, [facts.Opened(JOURNAL_VERSION, epoch, number, began, "0.1.0")]
    )
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(b"".join(map(record, [opening, *entries])))
    return path


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """A folder with the segment of a walk of yesterday and, after it, that of a short story of
    today.
    """
    segment(tmp_path / "two" / "00000001.tcaj", walk()[1:], "yesterday")
    segment(tmp_path / "two" / "00000002.tcaj", walking().entries[1:], "today", began=TODAY)
    return tmp_path / "two"


def said(log: Log, capsys: pytest.CaptureFixture[str]) -> list[str]:
    log.check()
    return capsys.readouterr().err.splitlines()


@pytest.mark.parametrize("tool", TOOLS)
def test_every_tool_shows_the_newest_of_two_runs_with_a_remark(
    tca: Tca, two: Path, tool: str
) -> None:
    shown, alone = tca(*tool.split(), two), tca(*tool.split(), two / "00000002.tcaj")
    assert shown.exit_code == alone.exit_code
    assert shown.stdout.splitlines()[1:] == alone.stdout.splitlines()[1:]
    assert shown.stderr == (
        f"tca: {two}: 2 runs lie there: this is the one that began last (00000002.tcaj);"
        f" to see another, name it, as in '{two}#1': 'tca log runs {two}' lists them\n"
    )
    assert alone.stderr == ""


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("which", ["#1", "#yesterday", "/#1"])
def test_every_tool_accepts_the_name_of_one_of_two_runs(
    tca: Tca, two: Path, tool: str, which: str
) -> None:
    named, alone = tca(*tool.split(), f"{two}{which}"), tca(*tool.split(), two / "00000001.tcaj")
    assert (named.exit_code, named.stderr) == (alone.exit_code, alone.stderr)
    assert named.stdout.splitlines()[1:] == alone.stdout.splitlines()[1:]


def test_run_of_several_segments_can_be_named(tca: Tca, two: Path) -> None:
    segment(two / "00000003.tcaj", [Entry(99, 9.0, [])], "today", 2, began=TODAY)
    segment(two / "00000004.tcaj", walk()[1:], "tonight", began=TODAY + 1)
    assert [path.name for path in open_log(Path(f"{two}#2")).segments()] == [
        "00000002.tcaj",
        "00000003.tcaj",
    ]
    assert tca("tree", f"{two}#2").stdout.startswith("two#2: ")


def test_unknown_run_number_is_refused(tca: Tca, two: Path) -> None:
    told = tca("tree", f"{two}#3")
    assert (told.exit_code, told.stdout) == (2, "")
    assert (
        told.stderr == f"Error: {two}: no run '3' of the 2 there: 'tca log runs {two}' lists them\n"
    )


def test_log_runs_lists_runs_by_their_names(tca: Tca, two: Path) -> None:
    lines = tca("log", "runs", two).stdout.splitlines()
    assert [line.split()[0] for line in lines] == [f"{two}#1", f"{two}#2"]
    assert all(line.endswith(", 1 segment") for line in lines)
    listed = tca("log", "runs", XDG_STATE_HOME=str(two.parent / "nowhere"))
    assert (listed.exit_code, "no journal below" in listed.stderr) == (2, True)


def test_newest_run_follows_segment_numbers_not_the_clock(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "robot"
    segment(folder / "00000001.tcaj", walking().entries[1:], "first", began=TODAY)
    segment(folder / "00000002.tcaj", [Entry(99, 9.0, [])], "first", 2, began=TODAY)
    segment(
        folder / "00000003.tcaj", walk()[1:], "second", began=1000.0
    )  # a robot without a clock of its own
    assert [path.name for path in open_log(folder).segments()] == ["00000003.tcaj"]


def test_follow_stays_with_its_run_when_another_begins(tmp_path: Path) -> None:
    folder = Story().write(tmp_path / "run")
    seen = followed(
        open_log(folder),
        lambda: segment(folder / "00000002.tcaj", walk()[1:], "another run", began=TODAY),
        lambda: segment(folder / "00000003.tcaj", [Entry(99, 9.0, [])], "epoch", 2),
        lambda: None,
    )
    assert seen == [1, 0, 99]


def test_segments_are_ordered_by_content_not_by_name(tmp_path: Path) -> None:
    entries = walking().entries[1:]
    segment(tmp_path / "b.tcaj", entries[:5], "epoch", 1)
    segment(tmp_path / "a.tcaj", entries[5:], "epoch", 2)
    assert [entry.number for entry in open_log(tmp_path) if entry.number] == [
        entry.number for entry in entries
    ]


def test_missing_segments_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = walking().write(tmp_path / "run", segments=5)
    (folder / "00000001.tcaj").unlink()
    (folder / "00000003.tcaj").unlink()
    (folder / "00000004.tcaj").unlink()
    assert said(open_log(folder), capsys) == [
        f"tca: {folder}: segment 1 is missing: what happened then is not known",
        f"tca: {folder}: segments 3 to 4 are missing: what happened then is not known",
    ]


def test_check_reports_missing_segments_on_stdout_only(tca: Tca, tmp_path: Path) -> None:
    folder = walking().write(tmp_path / "run", segments=3)
    (folder / "00000002.tcaj").unlink()
    told = tca("check", folder)
    assert "missing: 1 segment before segment 3" in told.stdout
    assert told.stderr == ""


def test_copied_segment_is_left_out_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = walking().write(tmp_path / "run", segments=2)
    (folder / "00000001 (copy).tcaj").write_bytes((folder / "00000001.tcaj").read_bytes())
    log = open_log(folder)
    assert [path.name for path in log.segments()] == ["00000001.tcaj", "00000002.tcaj"]
    assert said(log, capsys) == [
        f"tca: {folder}: 00000001 (copy).tcaj is a segment that the run has already, and left out"
    ]


def test_remarks_are_printed_once(two: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (two / "00000002.tcaj").open("ab") as stream:
        stream.write(record(Entry(99, 99.0, []))[:-2])
    log = open_log(two)
    list(log)
    assert len(said(log, capsys)) == 2
    assert said(log, capsys) == []


def test_report_remarks_on_a_cut_journal_once(tca: Tca, tmp_path: Path) -> None:
    cut = tmp_path / "cut.tcaj"
    cut.write_bytes(b"".join(map(record, walk()))[:-5])
    told = tca("report", cut, "-o", tmp_path / "out.html")
    assert (told.exit_code, told.stderr.count("cut off, the last")) == (0, 1)


@pytest.fixture
def joined(two: Path, tmp_path: Path) -> tuple[Path, int]:
    """A file in which one run follows another, and the byte at which the second begins."""
    first, second = ((two / f"0000000{number}.tcaj").read_bytes() for number in (2, 1))
    path = tmp_path / "joined.tcaj"
    path.write_bytes(first + second)
    return path, len(first)


@pytest.mark.parametrize("tool", [*TOOLS, "log show --classic", "log show --json"])
def test_every_tool_shows_the_first_run_of_a_joined_file(
    tca: Tca, two: Path, joined: tuple[Path, int], tool: str
) -> None:
    path, place = joined
    shown, alone = tca(*tool.split(), path), tca(*tool.split(), two / "00000002.tcaj")
    assert shown.exit_code == alone.exit_code
    assert shown.stdout.splitlines()[1:] == alone.stdout.splitlines()[1:]
    assert shown.stderr == (
        f"tca: {path}, byte {place}: another run begins here; only what comes before it is shown:"
        f" to see the rest, take it out of the file ('tail -c +{place + 1}')\n"
    )
    assert alone.stderr == ""


def test_second_run_of_a_joined_file_is_read_from_its_byte(
    joined: tuple[Path, int], tmp_path: Path
) -> None:
    path, place = joined
    rest = tmp_path / "rest.tcaj"
    rest.write_bytes(path.read_bytes()[place:])
    assert [entry.number for entry in open_log(rest)][1:] == [entry.number for entry in walk()[1:]]


def test_follow_of_a_joined_file_ends_at_the_second_run(
    joined: tuple[Path, int], capsys: pytest.CaptureFixture[str]
) -> None:
    log = open_log(joined[0])
    assert len(list(log.follow(lambda: pytest.fail("there is nothing to wait for")))) == len(
        walking().entries
    )
    assert "another run begins here" in said(log, capsys)[0]


def test_stopped_reading_ends_its_thread(two: Path) -> None:
    """The thread looked for news as fast as it could, for as long as the process lived."""
    reading = Reading(open_log(two))
    reading.start()
    with reading:
        assert reading._grown.wait_for(lambda: reading.caught_up, 30)
    reading.stop()
    reading._thread.join(30)
    assert not reading._thread.is_alive()
    assert gc.isenabled()


def test_segments_of_one_run_joined_in_a_file_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, path = walking().write(tmp_path / "run", segments=3), tmp_path / "whole.tcaj"
    path.write_bytes(b"".join(one.read_bytes() for one in sorted(folder.iterdir())))
    log = open_log(path)
    assert [entry.number for entry in log] == [entry.number for entry in open_log(folder)]
    assert said(log, capsys) == []


def test_repeated_segment_in_a_file_is_read_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, path = walking().encoded(), tmp_path / "twice.tcaj"
    path.write_bytes(whole + whole)
    log = open_log(path)
    assert [entry.number for entry in log] == [entry.number for entry in walking().entries]
    assert said(log, capsys)[0].startswith(
        f"tca: {path}, byte {len(whole)}: segment 1 of this run, once more, begins here; only what comes before"
    )


def test_run_after_a_crash_continues_the_segment_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A central that crashed is started anew with the same folder: what the crash left half written
    is not of the new run.
    """
    folder = tmp_path / "runs"
    segment(folder / "00000001.tcaj", walking().entries[1:], "crashed")
    (folder / "00000002.tcaj").write_bytes(b"\0" * 100)
    (folder / "00000003.tcaj").touch()
    entries = walk()[1:]
    segment(folder / "00000004.tcaj", entries[:20], "again", 1, TODAY)
    segment(folder / "00000005.tcaj", entries[20:], "again", 2, TODAY)
    (folder / "00000006.tcaj").touch()
    log = open_log(folder)
    assert [path.name for path in log.segments()] == [
        "00000004.tcaj",
        "00000005.tcaj",
        "00000006.tcaj",
    ]
    shown = [entry.number for entry in log]
    assert [number for number in shown if number] == [
        entry.number for entry in entries if entry.number
    ]
    (line,) = said(log, capsys)
    assert (
        "2 runs lie there: this is the one that began last (00000004.tcaj, 00000005.tcaj, " in line
    )
    (folder / "00000005.tcaj").unlink()
    assert "segment 2 is missing" in " ".join(open_log(folder).remarks)
