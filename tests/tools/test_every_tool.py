"""Rules that all tools keep, for invalid times, output that cannot be written, and damaged
journals.
"""

import os
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from typing import Any

import msgpack
import pytest
from click import unstyle
from click.testing import CliRunner, Result
from sampling import every
from tools.runs import encoded, walk
from tools.story import Story

from tca_tools.command_line import main
from tca_tools.terminal import columns_of
from tca_wire.journal import facts
from tca_wire.journal.records import record
from tca_wire.points import Moment

Tca = Callable[..., Result]

PRINTING_TOOLS = ["log show", "gantt", "replay --text"]
"""Tools with different ways to print."""
TIMES = [
    *(("gantt", option) for option in ("--from", "--to", "--at")),
    *(("tree", option) for option in ("--from", "--to", "--at")),
    *(("stats", option) for option in ("--from", "--to")),
    ("replay", "--at"),
]
TO_STDOUT = [
    "log show",
    "log show --json",
    "log show --classic",
    "tree",
    "tree --story 3",
    "gantt",
    "stats",
    "stats --json",
    "check",
    "replay --text",
]
TO_FILES = [
    ("tree", "out.txt"),
    ("tree", "out.svg"),
    ("gantt", "out.svg"),
    ("gantt", "out.png"),
    ("report", "out.html"),
    ("export", "out.jsonl"),
    ("export", "out.mcap"),
    ("export", "out.pftrace"),
    ("export --to csv", "out"),
    ("export --to parquet", "out"),
]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(encoded(walk()))
    return path


def process(*arguments: object, **options: Any) -> "subprocess.CompletedProcess[str]":
    """Run ``tca`` as a process of its own."""
    command = [
        sys.executable,
        "-c",
        "from tca_tools.command_line import main; main()",
        *map(str, arguments),
    ]
    return subprocess.run(
        command, text=True, timeout=60, check=False, stderr=subprocess.PIPE, **options
    )


@contextmanager
def file_size_limit() -> Iterator[None]:
    """Limit the files of this process to 100 bytes. Write no bytecode, or it would be cut."""
    before, sys.dont_write_bytecode = resource.getrlimit(resource.RLIMIT_FSIZE), True
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = False


@pytest.mark.parametrize(("command", "option"), TIMES)
@pytest.mark.parametrize("time", ["nan", "-1e308", "soon"])
def test_invalid_time_is_refused(tca: Tca, run: Path, command: str, option: str, time: str) -> None:
    result = tca(command, run, option, time)
    assert (result.exit_code, result.stdout) == (2, "")
    assert f"'{option}': '{time}' is not a time: give seconds, such as 12.5\n" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", every(3, PRINTING_TOOLS))
def test_full_disk_is_reported_in_one_line(run: Path, command: str) -> None:
    with Path("/dev/full").open("w") as full:
        done = process(*command.split(), run, stdout=full)
    assert (done.returncode, done.stderr) == (
        1,
        "Error: the output can't be written: No space left on device: make room\n",
    )


@pytest.mark.slow
@pytest.mark.parametrize("command", every(3, PRINTING_TOOLS[1:] + PRINTING_TOOLS[:1]))
def test_closed_pipe_ends_a_tool_quietly(run: Path, command: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = process(*command.split(), run, stdout=writer)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.slow
@pytest.mark.parametrize("command", every(3, PRINTING_TOOLS[2:] + PRINTING_TOOLS[:2]))
def test_closed_stdout_is_no_error(run: Path, command: str) -> None:
    done = process(*command.split(), run, preexec_fn=lambda: os.close(1))
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize(("command", "code"), [("log show", 0), ("central --bind", 2)])
def test_closed_stderr_keeps_the_exit_code(run: Path, command: str, code: int) -> None:
    done = process(*command.split(), run, stdout=subprocess.PIPE, preexec_fn=lambda: os.close(2))
    assert (done.returncode, done.stderr) == (code, "")
    assert "Traceback" not in done.stdout


@pytest.mark.parametrize(("command", "name"), TO_FILES[2:])
def test_old_output_is_kept_when_the_new_one_does_not_fit(
    tca: Tca, run: Path, tmp_path: Path, command: str, name: str
) -> None:
    output = tmp_path / name
    if "csv" not in command and "parquet" not in command:
        output.write_text("precious")
    with file_size_limit():
        done = tca(*command.split(), run, "-o", output, "--force")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"Error: {output}")
    assert done.stderr.endswith("can't be written: File too large\n")
    assert output.is_dir() or output.read_text() == "precious"
    assert not list(tmp_path.rglob("*.part"))


def with_holes(entries: list[facts.Entry], holes: list[int]) -> bytes:
    """Return the entries as a journal, with the entries at *holes* damaged."""
    data = [record(entry) for entry in entries]
    for place in holes:
        data[place] = data[place][:-1] + bytes([data[place][-1] ^ 1])
    return b"".join(data)


def assert_every_tool_reads(path: Path, folder: Path) -> None:
    """Check that each command shows the readable part, and reports the rest in one line."""
    to_files = [
        f"{command} -o {folder}/{place}{name}" for place, (command, name) in enumerate(TO_FILES)
    ]
    for command in [*TO_STDOUT, *to_files]:
        result = CliRunner().invoke(main, [*command.split(), str(path)], prog_name="tca")
        assert result.exception is None or isinstance(result.exception, SystemExit), (
            command,
            result.exception,
        )
        if "--story" not in command:  # that task may be lost
            assert (result.exit_code, result.stderr.count("left out")) == (1, 1), (
                command,
                result.stderr,
            )
            assert result.stdout or "-o" in command
            assert "BROKEN" not in result.stdout


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.soak)])
def test_every_tool_reads_past_damaged_entries(tmp_path: Path, seed: int) -> None:
    entries, chance = (
        walk(),
        Random(seed),
    )  # not Hypothesis: shrinking would take minutes
    holes = sorted(chance.sample(range(1, len(entries) - 1), chance.choice([1, 3, 12])))
    path = tmp_path / "walk.tcaj"
    path.write_bytes(with_holes(entries, holes))
    assert_every_tool_reads(path, tmp_path)


def test_report_accepts_a_task_whose_first_entry_is_lost(tca: Tca, tmp_path: Path) -> None:
    story = Story().module("planner", "step").module("legs", "move").at(1.0)
    step = story.goal("step", "user")
    lost = len(story.entries) - 1
    story.at(2.0).delivered(step, "planner").at(3.0).reached(step, Moment.START_HANDLING)
    for number in range(2):
        move = story.at(4.0 + 2 * number).command("move", "planner", step)
        story.acted(move, "legs", 1.0)
    path, out = tmp_path / "run.tcaj", tmp_path / "run.html"
    path.write_bytes(with_holes(story.entries, [lost]))
    assert tca("report", path, "-o", out).stderr.count("a damaged entry is left out") == 1
    assert "A part of the journal can't be read: " in out.read_text()


WIDTHS = [
    *(
        (tool, columns)
        for tool in ("tree", "gantt", "stats", "log show", "replay --text")
        for columns in (80, 250)
    ),
    ("gantt", 60),
    ("check", 80),
    ("tree --story 1", 80),
    ("log show", 40),
]


@pytest.mark.parametrize(("command", "columns"), WIDTHS)
@pytest.mark.parametrize("name", ["move", "机器人" * 60, "a b " * 2500])
def test_no_line_is_wider_than_the_terminal_for_any_name(
    tca: Tca, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, columns: int, name: str
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    story = Story().module(name, name).module("eye", "look").at(1.0)
    goal = story.goal(name, "user")
    story.delivered(goal, name).reached(goal, Moment.START_ACHIEVING)
    for number in range(5):
        look = story.at(100.0 + 250.0 * number).command("look", name, goal)
        story.queued(look, "eye").at(200.0 + 250.0 * number).acted(look, "eye", 75.5)
    story.queued(story.command(name, name, goal), name)
    story.at(5000.0).say(facts.Failed(look, name, name, is_beside=True), facts.Granted(3))
    path = tmp_path / "run.tcaj"
    path.write_bytes(story.encoded())
    result = tca(*command.split(), path)
    assert [
        line for line in result.stdout.splitlines() if columns_of(unstyle(line)) > columns
    ] == []
    assert result.exit_code in (0, 1)


@pytest.mark.parametrize("time", [float("nan"), float("inf"), -1.0, 1e300])
def test_entry_with_an_invalid_time_is_left_out(tca: Tca, tmp_path: Path, time: float) -> None:
    path = tmp_path / "run.tcaj"
    path.write_bytes(encoded(walk()) + encoded([facts.Entry(10**6, time, [])]))
    result = tca("stats", path)
    assert result.exit_code == 1
    assert result.stderr.startswith(
        f"Error: {path}, byte {len(encoded(walk()))}, after 79.000 s: a damaged entry is left out"
    )


def damaged(entries: list[facts.Entry], how: str) -> bytes:
    """The entries as a journal with one kind of damage."""
    data = [record(entry) for entry in entries]
    third = len(data) // 3
    whole = b"".join(data)
    if how == "hole":
        return b"".join(data[:third]) + data[third][:20] + b"".join(data[2 * third :])
    if how == "zeros":
        place = len(b"".join(data[:third])) + 5
        return whole[:place] + bytes(1000) + whole[place + 1000 :]
    if how == "first":
        return whole[:8] + bytes([whole[8] ^ 1]) + whole[9:]
    unknown = msgpack.packb([entries[third].number, entries[third].time, [["brand new", {"a": 2}]]])
    data[third] = struct.pack(">BIBI", 206, len(unknown), 206, zlib.crc32(unknown)) + unknown
    if how == "later version":
        opened = msgpack.packb(
            [0, 0.0, [["opened", facts.JOURNAL_VERSION + 1, "epoch", 1, 0.0, "9.9"]]]
        )
        data[0] = struct.pack(">BIBI", 206, len(opened), 206, zlib.crc32(opened)) + opened
    return b"".join(data)


@pytest.mark.parametrize("how", every(2, ["hole", "zeros", "later version", "first"]))
def test_every_tool_reads_a_damaged_or_later_journal(tmp_path: Path, how: str) -> None:
    path = tmp_path / "walk.tcaj"
    path.write_bytes(damaged(walk(), how))
    assert_every_tool_reads(path, tmp_path)


@pytest.mark.parametrize("command", ["tree", "gantt"])
@pytest.mark.parametrize("task", ["", "0", "-1", "nobody's"])
def test_unknown_task_is_refused_by_tree_and_gantt(
    tca: Tca, run: Path, command: str, task: str
) -> None:
    result = tca(command, run, "--task", task)
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.startswith(f"Error: no task '{task}' in this journal")


@pytest.mark.parametrize("command", ["tree", "gantt"])
@pytest.mark.parametrize("length", [252, 300])
def test_too_long_picture_name_is_reported_in_one_line(
    tca: Tca, run: Path, tmp_path: Path, command: str, length: int
) -> None:
    output = tmp_path / ("a" * length + ".svg")
    result = tca(command, run, "-o", output)
    assert (result.exit_code, result.stderr) == (
        1,
        f"Error: {output}: can't be written: File name too long\n",
    )
