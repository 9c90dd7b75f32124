"""Folders and files with several runs, or with parts of one run."""

import gc
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from tools.runs import walk
from tools.segments import TODAY, followed, printed_remarks, segment
from tools.story import Story, walking

from tca_tools.journal.journals import open_log
from tca_tools.view.reading import Reading
from tca_wire.journal.facts import Entry
from tca_wire.journal.records import record

Tca = Callable[..., Result]
TOOLS = ["tree", "log show", "check"]
"""Tools that all read journals through `Log`."""


@pytest.fixture
def two_runs(tmp_path: Path) -> Path:
    """Return a folder with two segments: a walk of yesterday, and a short story of today."""
    segment(tmp_path / "two" / "00000001.tcaj", walk()[1:], "yesterday")
    segment(tmp_path / "two" / "00000002.tcaj", walking().entries[1:], "today", began=TODAY)
    return tmp_path / "two"


@pytest.mark.parametrize("tool", TOOLS)
def test_every_tool_shows_the_newest_of_two_runs_with_a_remark(
    tca: Tca, two_runs: Path, tool: str
) -> None:
    shown, alone = tca(*tool.split(), two_runs), tca(*tool.split(), two_runs / "00000002.tcaj")
    assert shown.exit_code == alone.exit_code
    assert shown.stdout.splitlines()[1:] == alone.stdout.splitlines()[1:]
    assert shown.stderr == (
        f"tca: {two_runs}: contains 2 runs; this is the one that started last (00000002.tcaj);"
        f" to see another, name it, as in '{two_runs}#1': 'tca log runs {two_runs}' lists them\n"
    )
    assert alone.stderr == ""


@pytest.mark.parametrize("tool", TOOLS)
@pytest.mark.parametrize("which", ["#1", "#yesterday", "/#1"])
def test_every_tool_accepts_the_name_of_one_of_two_runs(
    tca: Tca, two_runs: Path, tool: str, which: str
) -> None:
    named, alone = (
        tca(*tool.split(), f"{two_runs}{which}"),
        tca(*tool.split(), two_runs / "00000001.tcaj"),
    )
    assert (named.exit_code, named.stderr) == (alone.exit_code, alone.stderr)
    assert named.stdout.splitlines()[1:] == alone.stdout.splitlines()[1:]


def test_run_of_several_segments_can_be_named(tca: Tca, two_runs: Path) -> None:
    segment(two_runs / "00000003.tcaj", [Entry(99, 9.0, [])], "today", 2, began=TODAY)
    segment(two_runs / "00000004.tcaj", walk()[1:], "tonight", began=TODAY + 1)
    assert [path.name for path in open_log(Path(f"{two_runs}#2")).segments()] == [
        "00000002.tcaj",
        "00000003.tcaj",
    ]
    assert tca("tree", f"{two_runs}#2").stdout.startswith("two#2: ")


def test_unknown_run_number_is_refused(tca: Tca, two_runs: Path) -> None:
    result = tca("tree", f"{two_runs}#3")
    assert (result.exit_code, result.stdout) == (2, "")
    assert (
        result.stderr
        == f"Error: {two_runs}: no run '3' of the 2 there: 'tca log runs {two_runs}' lists them\n"
    )


def test_log_runs_lists_runs_by_their_names(tca: Tca, two_runs: Path) -> None:
    lines = tca("log", "runs", two_runs).stdout.splitlines()
    assert [line.split()[0] for line in lines] == [f"{two_runs}#1", f"{two_runs}#2"]
    assert all(line.endswith(", 1 segment") for line in lines)
    listed = tca("log", "runs", XDG_STATE_HOME=str(two_runs.parent / "nowhere"))
    assert (listed.exit_code, "no journal below" in listed.stderr) == (2, True)


def test_newest_run_follows_segment_numbers_not_the_clock(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "robot"
    segment(folder / "00000001.tcaj", walking().entries[1:], "first", began=TODAY)
    segment(folder / "00000002.tcaj", [Entry(99, 9.0, [])], "first", 2, began=TODAY)
    segment(folder / "00000003.tcaj", walk()[1:], "second", began=1000.0)  # a robot without a clock
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
    assert printed_remarks(open_log(folder), capsys) == [
        f"tca: {folder}: segment 1 is missing: the events of that time are unknown",
        f"tca: {folder}: segments 3 to 4 are missing: the events of that time are unknown",
    ]


def test_check_reports_missing_segments_on_stdout_only(tca: Tca, tmp_path: Path) -> None:
    folder = walking().write(tmp_path / "run", segments=3)
    (folder / "00000002.tcaj").unlink()
    result = tca("check", folder)
    assert "missing: 1 segment before segment 3" in result.stdout
    assert result.stderr == ""


def test_copied_segment_is_left_out_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = walking().write(tmp_path / "run", segments=2)
    (folder / "00000001 (copy).tcaj").write_bytes((folder / "00000001.tcaj").read_bytes())
    log = open_log(folder)
    assert [path.name for path in log.segments()] == ["00000001.tcaj", "00000002.tcaj"]
    assert printed_remarks(log, capsys) == [
        f"tca: {folder}: 00000001 (copy).tcaj is a copy of a segment of the run: left out"
    ]


def test_remarks_are_printed_once(two_runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (two_runs / "00000002.tcaj").open("ab") as stream:
        stream.write(record(Entry(99, 99.0, []))[:-2])
    log = open_log(two_runs)
    list(log)
    assert len(printed_remarks(log, capsys)) == 2
    assert printed_remarks(log, capsys) == []


def test_report_remarks_on_a_cut_journal_once(tca: Tca, tmp_path: Path) -> None:
    cut = tmp_path / "cut.tcaj"
    cut.write_bytes(b"".join(map(record, walk()))[:-5])
    result = tca("report", cut, "-o", tmp_path / "out.html")
    assert (result.exit_code, result.stderr.count("cut off: the last")) == (0, 1)


@pytest.fixture
def joined(two_runs: Path, tmp_path: Path) -> tuple[Path, int]:
    """Return a file with two runs, and the byte at which the second run begins."""
    first, second = ((two_runs / f"0000000{number}.tcaj").read_bytes() for number in (2, 1))
    path = tmp_path / "joined.tcaj"
    path.write_bytes(first + second)
    return path, len(first)


@pytest.mark.parametrize("tool", [*TOOLS, "log show --classic", "log show --json"])
def test_every_tool_shows_the_first_run_of_a_joined_file(
    tca: Tca, two_runs: Path, joined: tuple[Path, int], tool: str
) -> None:
    path, place = joined
    shown, alone = tca(*tool.split(), path), tca(*tool.split(), two_runs / "00000002.tcaj")
    assert shown.exit_code == alone.exit_code
    assert shown.stdout.splitlines()[1:] == alone.stdout.splitlines()[1:]
    assert shown.stderr == (
        f"tca: {path}, byte {place}: another run starts here; only the entries before it are shown:"
        f" to see the rest, extract it with 'tail -c +{place + 1}'\n"
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
    assert "another run starts here" in printed_remarks(log, capsys)[0]


def test_stopped_reading_ends_its_thread(two_runs: Path) -> None:
    """The test guards against a thread that polls without a pause until the process ends."""
    reading = Reading(open_log(two_runs))
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
    assert printed_remarks(log, capsys) == []


def test_repeated_segment_in_a_file_is_read_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, path = walking().encoded(), tmp_path / "twice.tcaj"
    path.write_bytes(whole + whole)
    log = open_log(path)
    assert [entry.number for entry in log] == [entry.number for entry in walking().entries]
    assert printed_remarks(log, capsys)[0].startswith(
        f"tca: {path}, byte {len(whole)}: segment 1 of this run, again, starts here; only the entries before"
    )


def test_run_after_a_crash_continues_the_segment_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A crashed central is restarted in its folder. The torn segments belong to the old run."""
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
    (line,) = printed_remarks(log, capsys)
    assert (
        "contains 2 runs; this is the one that started last (00000004.tcaj, 00000005.tcaj, " in line
    )
    (folder / "00000005.tcaj").unlink()
    assert "segment 2 is missing" in " ".join(open_log(folder).remarks)
