"""``tca log prune`` removes old runs as a whole, and the ended tasks of a run that continues."""

import os
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import Result
from processes import central
from properties.life import Life
from tools.segments import segment
from tools.story import walking

from dev.fuzz.hostile_central import LINES, beginning
from dev.fuzz.hostile_inputs import Daemon
from tca_central.events import Arrived, ConnectionId, ConnectionLost
from tca_central.shell.input_log import InputLog
from tca_central.shell.log_writer import Sync, numbers
from tca_module import connect
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log
from tca_tools.log.shorten import EndedTasks
from tca_wire.journal import facts
from tca_wire.journal.facts import Closed, Entry, Fact, Shortened
from tca_wire.journal.frames import framed
from tca_wire.journal.records import JournalReader
from tca_wire.points import END_ACHIEVING, TaskId
from tca_wire.waits import WaitKind

Tca = Callable[..., Result]


def journal_of(folder: Path, seed: int, events: int = 600, parts: int = 6) -> list[Path]:
    """Return the segments of a random life. The last one is still being written."""
    life = Life()
    life.go_on(seed, events)
    nonempty = [entry for entry in life.player.entries if entry.facts]
    step = len(nonempty) // parts
    cuts = [*(step * part for part in range(parts)), len(nonempty)]
    folder.mkdir()
    return [
        segment(folder / f"{number:08d}.tcaj", nonempty[start:end], "life", number)
        for number, (start, end) in enumerate(pairwise(cuts), 1)
    ]


def entries(path: Path) -> list[Entry]:
    with path.open("rb") as stream:
        return list(JournalReader(stream))


def visible_tasks(history: History, until: float) -> dict[int, Any]:
    """Return the visible properties of the tasks that had not ended at *until*."""
    found = [one for one in history.tasks.values() if one.time_of(END_ACHIEVING) > until]
    return {
        one.id: (
            one.name,
            one.parent,
            one.failure,
            str(one.caught_by),
            [f"{time:.3f}" for time in one.times],
            [f"{state} {time:.3f}" for time, state in one.states],
            [f"{run.module} {run.start:.3f}" for run in one.handlings],
        )
        for one in found
    }


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (2, 3))]
)
def test_shortened_journal_keeps_tasks_that_have_not_ended(
    tca: Tca, tmp_path: Path, seed: int
) -> None:
    folder = tmp_path / "journal"
    files = journal_of(folder, seed)
    before = History.until(Log(folder))
    size = sum(path.stat().st_size for path in files)
    ended = EndedTasks(files)
    until = ended.until(None, size * 0.6)
    assert ended.remove(until) >= size * 0.4
    after = History.until(Log(folder))
    assert visible_tasks(after, until) == visible_tasks(before, until)
    assert len(after.tasks) < len(before.tasks)
    assert {task.parent for task in after.tasks.values()} <= {0, *after.tasks}
    assert EndedTasks(files).remove(until) == 0
    for tool in (("check",), ("tree",), ("gantt",), ("stats",), ("log", "show")):
        result = tca(*tool, folder)
        assert (result.exit_code, "was removed" in result.output) == (0, True), result.output


def test_age_limit_uses_the_clock_of_the_run(tmp_path: Path) -> None:
    files = journal_of(tmp_path / "journal", 1)
    last = History.until(Log(tmp_path / "journal")).time
    ended = EndedTasks(files)
    assert ended.until(last / 2, None) == pytest.approx(last / 2)
    assert ended.until(2 * last, None) < 0
    assert ended.remove(ended.until(2 * last, None)) == 0


def test_segments_compared_by_a_recovery_are_kept(tmp_path: Path) -> None:
    """The inputs begin in the fourth segment. A recovery compares their facts with the journal."""
    files = journal_of(tmp_path / "journal", 2)
    begun = entries(files[3])[0].time
    inputs = InputLog(tmp_path / "journal", epoch="life", sync=Sync.NONE, clock=begun)
    inputs.close()
    before = [path.read_bytes() for path in files]
    gone = inputs.folder / "00000009.tcai"  # just removed by central
    ended = EndedTasks([gone, inputs.folder / "00000001.tcai", *files])
    ended.remove(ended.until(None, 0.0))
    assert [path.read_bytes() == data for path, data in zip(files, before, strict=True)] == [
        False
    ] * 3 + [True] * 3


def short_life(folder: Path) -> Daemon:
    """Continue the run in a folder with tasks that end, take an image, and kill the daemon."""
    daemon = Daemon(folder)
    assert daemon.log is not None
    assert daemon.log.images is not None
    clock = daemon.central.clock
    for line, packet in beginning():
        daemon.handle_input(Arrived(clock.now + 1.0, ConnectionId(line), packet))
    for line in LINES:
        daemon.handle_input(ConnectionLost(clock.now + 1.0, ConnectionId(line), "it ended"))
    daemon.log.images.start(daemon.central)
    daemon.log.images.close()
    daemon.kill()
    return daemon


@pytest.mark.parametrize("is_torn", [False, True])
def test_run_of_short_lives_is_shortened_and_recovers(
    tca: Tca, tmp_path: Path, is_torn: bool
) -> None:
    """Each life takes one image. The newest image and the one before it are kept for a recovery."""
    for _ in range(5):
        short_life(tmp_path)
    before, newest = numbers(tmp_path, ".tcas")
    assert min(numbers(tmp_path, ".tcai")) == before
    result = tca("log", "prune", tmp_path, "--keep-bytes", "1")
    assert " of tasks and messages that had ended by" in result.stdout, result.output
    if is_torn:
        os.truncate(tmp_path / f"{newest:08d}.tcas", 100)
    daemon = short_life(tmp_path)
    assert daemon.run is not None
    assert not daemon.run.missing
    assert numbers(tmp_path, ".tcas")[0] == (before if is_torn else newest)
    assert tca("check", "--rerun", tmp_path).exit_code == 0


def test_shortened_fact_keeps_the_latest_time(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    files = journal_of(folder, 5)
    last = History.until(Log(folder)).time
    for segments, part in ((4, 0.4), (4, 0.66), (6, 0.6)):
        assert EndedTasks(files[:segments]).remove(last * part)
    assert entries(files[0])[0].facts[1:] == [Shortened(last * 0.66)]
    assert tca("check", folder).exit_code == 0


def test_ended_waits_for_any_task_are_removed(tmp_path: Path) -> None:
    """A program that observes all tasks waits again after each change. The journal then has many
    ended waits.
    """
    wait = ("page", 0, TaskId(0), 0, WaitKind.CHANGE, "any task")
    waits: list[Fact] = [facts.WaitBegan(*wait), facts.WaitEnded(*wait)] * 3
    entries_of_waits = [
        Entry(place, float((place + 1) // 2), [one]) for place, one in enumerate([*waits, waits[0]])
    ]
    path, newest = tmp_path / "1.tcaj", tmp_path / "2.tcaj"
    EndedTasks(
        [segment(path, entries_of_waits, "life"), segment(newest, entries_of_waits[-1:], "life", 2)]
    ).remove(2.5)
    assert [entry.number for entry in entries(path)] == [0, 4, 5, 6]


def test_damaged_segment_is_not_shortened(tmp_path: Path) -> None:
    files = journal_of(tmp_path / "journal", 3)
    data = bytearray(files[1].read_bytes())
    data[len(data) // 2] ^= 255
    files[1].write_bytes(data)
    ended = EndedTasks(files)
    ended.remove(ended.until(None, 0.0))
    assert files[1].read_bytes() == data


def test_prune_shortens_a_continuing_run(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    files = journal_of(folder, 4)
    files[0].chmod(0o640)
    size = sum(path.stat().st_size for path in files)
    tried = tca("log", "prune", folder, "--keep-bytes", str(size // 2), "--dry-run")
    assert (tried.exit_code, sum(path.stat().st_size for path in files)) == (0, size)
    result = tca("log", "prune", folder, "--keep-bytes", str(size // 2))
    assert result.stdout == tried.stdout.replace("would be removed", "removed")
    assert sum(path.stat().st_size for path in files) <= size // 2
    assert files[0].stat().st_mode & 0o777 == 0o640


# --- removal of whole runs ------------------------------------------------------------------------


DAY = 86400.0
GOODBYE = Entry(99, 99.0, [Closed("stopped")])


def run(folder: Path, epoch: str, number: int, *, ended: float, closed: bool = True) -> list[Path]:
    """Return the two segments of a run that ended *ended* days ago."""
    entries = walking().entries[1:]
    paths = [
        segment(folder / f"{number:08d}.tcaj", entries[:3], epoch),
        segment(folder / f"{number + 1:08d}.tcaj", [*entries[3:], *[GOODBYE] * closed], epoch, 2),
    ]
    return aged(paths, ended)


def aged(paths: list[Path], days: float) -> list[Path]:
    for path in paths:
        os.utime(path, (time.time() - days * DAY,) * 2)
    return paths


def write_inputs_and_image(folder: Path, number: int, epoch: str, days: float) -> list[Path]:
    """Write inputs and an image beside the segments, as central does. They have numbers of their
    own.
    """
    made = [folder / f"{number:08d}{suffix}" for suffix in (".tcai", ".tcas", ".draft")]
    made[0].write_bytes(framed(msgspec.msgpack.encode(["inputs", 1, epoch, "0.1.0"])))
    for path in made[1:]:
        path.write_bytes(b"any")
    return aged(made, days)


def remaining_files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_prune_removes_old_runs_with_their_inputs_and_images(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    old = [*run(folder, "old", 1, ended=40), *write_inputs_and_image(folder, 7, "old", 40)]
    new = [*run(folder, "new", 3, ended=2), *write_inputs_and_image(folder, 9, "new", 2)]
    foreign = folder / "notes.draft"
    foreign.write_text("mine")
    tried = tca("log", "prune", folder, "--keep", "30d", "--dry-run")
    assert tried.exit_code == 0
    assert f"{folder}#1" in tried.stdout
    assert f"{folder}#2" not in tried.stdout
    assert remaining_files(folder) == sorted(path.name for path in (*old, *new, foreign))
    result = tca("log", "prune", folder, "--keep", "30d")
    assert result.stdout == tried.stdout.replace("would be removed", "removed")
    assert remaining_files(folder) == sorted(path.name for path in (*new, foreign))
    assert "1 run left" in result.stdout


def test_prune_removes_the_large_data_of_old_runs(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    for number, (epoch, ended) in enumerate((("old", 40), ("new", 2))):
        run(folder, epoch, 2 * number + 1, ended=ended)
        for kind in ("data", "held"):
            path = folder / kind / epoch / "a1" / "7"
            path.parent.mkdir(parents=True)
            path.write_bytes(bytes(3 << 20))
    result = tca("log", "prune", folder, "--keep", "30d")
    assert "1 run removed (6 MiB)" in result.stdout
    left = [name for name in remaining_files(folder) if "/" in name]
    assert left == ["data/new/a1/7", "held/new/a1/7"]
    assert tca("log", "prune", folder, "--keep", "1h").exit_code == 0
    assert not folder.exists() or remaining_files(folder) == []


def test_prune_removes_oldest_runs_down_to_the_size(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    runs = [run(folder, f"run{number}", 2 * number + 1, ended=9.0 - number) for number in range(4)]
    size = sum(path.stat().st_size for path in runs[0])
    assert tca("log", "prune", folder, "--keep-bytes", str(2 * size + 1)).exit_code == 0
    assert remaining_files(folder) == sorted(path.name for some in runs[2:] for path in some)


@pytest.mark.parametrize("options", [("--keep", "1h"), ("--keep-bytes", "0")])
def test_prune_keeps_the_newest_unclosed_run(
    tca: Tca, tmp_path: Path, options: tuple[str, str]
) -> None:
    folder = tmp_path / "robot"
    run(folder, "first", 1, ended=30, closed=False)
    crashed = run(folder, "second", 3, ended=20, closed=False)
    run(folder, "third", 5, ended=10)
    result = tca("log", "prune", folder, *options)
    assert result.exit_code == 0
    assert remaining_files(folder) == [path.name for path in crashed]
    assert "unfinished: it may continue" in result.stdout


def test_prune_keeps_the_last_run_despite_a_wrong_clock(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    run(folder, "first", 1, ended=1)
    run(folder, "second", 3, ended=20000)  # days: its clock was at 1970
    tca("log", "prune", folder, "--keep", "7d")
    assert len(remaining_files(folder)) == 4


def test_prune_keeps_later_numbers_despite_their_clock(tca: Tca, tmp_path: Path) -> None:
    for name, ended in (("000001-2026", 40), ("000002-2026", 2), ("000003-1970", 20000)):
        run(tmp_path / name, name, 1, ended=ended)
    tca("log", "prune", tmp_path, "--keep", "7d")
    assert sorted({Path(name).parts[0] for name in remaining_files(tmp_path)}) == [
        "000002-2026",
        "000003-1970",
    ]


def test_prune_removes_emptied_run_folders_only(
    tca: Tca, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journals, elsewhere = tmp_path / "tca" / "journals", tmp_path / "elsewhere"
    for place in (journals / "2025-01-01", journals / "2025-01-02", elsewhere):
        run(place, place.name, 1, ended=50)
    (journals / "2025-01-03").symlink_to(elsewhere)
    (journals / "2025-01-01" / "notes").write_text("mine")
    (journals / "empty").mkdir()
    result = tca("log", "prune", "--keep", "2w", XDG_STATE_HOME=str(tmp_path))
    assert (result.exit_code, result.stdout.count("ended")) == (0, 2)
    assert remaining_files(journals) == ["2025-01-01/notes"]
    assert sorted(path.name for path in journals.iterdir()) == ["2025-01-01", "2025-01-03", "empty"]
    assert len(remaining_files(elsewhere)) == 2


def test_prune_keeps_the_run_of_a_live_central(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    run(folder, "old", 1, ended=40)
    with central(tmp_path) as running:
        assert running.journal == folder
        connect("reader", running.address).close()  # central answers after it has begun its journal
        result = tca("log", "prune", folder, "--keep-bytes", "0")
        assert "a central writes it" in result.stdout
        assert "00000003.tcaj" in remaining_files(folder)
        assert "00000001.tcaj" not in remaining_files(folder)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "give the age or size to keep"),
        (("--keep", "30"), "with one of min, h, d, w"),
        (("--keep", "30m"), "with one of min, h, d, w"),
        (("--keep-bytes", "-1G"), "with one of K, M, G, T"),
        (("--keep", "1d"), "no runs are stored there"),
    ],
)
def test_prune_explains_wrong_limits(
    tca: Tca, tmp_path: Path, arguments: tuple[str, ...], complaint: str
) -> None:
    result = tca("log", "prune", tmp_path, *arguments)
    assert (result.exit_code, complaint in result.stderr) == (2, True)


def test_foreign_files_beside_segments_are_ignored(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    run(folder, "one", 1, ended=1)
    before = tca("tree", folder)
    write_inputs_and_image(folder, 1, "one", 1)
    (folder / "00000003.txt").write_text("mine")
    (folder / "permissions.toml").write_text("")
    (folder / "video").mkdir()
    after = tca("tree", folder)
    assert (after.exit_code, after.stdout, after.stderr) == (
        before.exit_code,
        before.stdout,
        before.stderr,
    )
