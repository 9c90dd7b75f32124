"""``tca log prune`` of a run that continues: ended tasks go, and the rest reads as before."""

import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from properties.life import Life
from tools.test_logs import segment

from dev.fuzz.hostile_central import LINES, beginning
from dev.fuzz.hostile_inputs import Daemon
from tca_central.events import Arrived, ConnectionId, ConnectionLost
from tca_central.shell.input_log import InputLog
from tca_central.shell.log_writer import Sync, numbers
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log
from tca_tools.log.shorten import EndedTasks
from tca_wire.journal import facts
from tca_wire.journal.facts import Entry, Fact, Shortened
from tca_wire.journal.records import JournalReader
from tca_wire.points import END_ACHIEVING, TaskId
from tca_wire.waits import WaitKind

Tca = Callable[..., Result]


def journal_of(folder: Path, seed: int, events: int = 600, parts: int = 6) -> list[Path]:
    """A random life in segments, the last of which is still written to."""
    life = Life()
    life.go_on(seed, events)
    told = [entry for entry in life.player.entries if entry.facts]
    step = len(told) // parts
    cuts = [*(step * part for part in range(parts)), len(told)]
    folder.mkdir()
    return [
        segment(folder / f"{number:08d}.tcaj", told[start:end], "life", number)
        for number, (start, end) in enumerate(pairwise(cuts), 1)
    ]


def entries(path: Path) -> list[Entry]:
    with path.open("rb") as stream:
        return list(JournalReader(stream))


def known(history: History, until: float) -> dict[int, Any]:
    """The tasks that had not ended by then, as people see them."""
    found = [one for one in history.tasks.values() if one.time_of(END_ACHIEVING) > until]
    return {
        one.id: (
            one.name, one.parent, one.failure, str(one.caught_by), [f"{time:.3f}" for time in one.times],
            [f"{state} {time:.3f}" for time, state in one.states], [f"{run.module} {run.start:.3f}" for run in one.handlings],
        )
        for one in found
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_a_shortened_journal_keeps_what_lives(tca: Tca, tmp_path: Path, seed: int) -> None:
    folder = tmp_path / "journal"
    files = journal_of(folder, seed)
    before = History.until(Log(folder))
    size = sum(path.stat().st_size for path in files)
    ended = EndedTasks(files)
    until = ended.until(None, size * 0.6)
    assert ended.remove(until) >= size * 0.4
    after = History.until(Log(folder))
    assert known(after, until) == known(before, until)
    assert len(after.tasks) < len(before.tasks)
    assert {task.parent for task in after.tasks.values()} <= {0, *after.tasks}
    assert EndedTasks(files).remove(until) == 0
    for tool in (("check",), ("tree",), ("gantt",), ("stats",), ("log", "show")):
        told = tca(*tool, folder)
        assert (told.exit_code, "was removed" in told.output) == (0, True), told.output


def test_tasks_go_by_age_on_the_clock_of_the_run(tmp_path: Path) -> None:
    files = journal_of(tmp_path / "journal", 1)
    last = History.until(Log(tmp_path / "journal")).time
    ended = EndedTasks(files)
    assert ended.until(last / 2, None) == pytest.approx(last / 2)
    assert ended.until(2 * last, None) < 0
    assert ended.remove(ended.until(2 * last, None)) == 0


def test_segments_stay_that_a_recovery_compares(tmp_path: Path) -> None:
    """The inputs begin in the fourth segment: what is from then on is compared with what they lead to."""
    files = journal_of(tmp_path / "journal", 2)
    begun = entries(files[3])[0].time
    inputs = InputLog(tmp_path / "journal", epoch="life", version="0", sync=Sync.NONE, clock=begun)
    inputs.close()
    before = [path.read_bytes() for path in files]
    gone = inputs.folder / "00000009.tcai"  # central has just removed it
    ended = EndedTasks([gone, inputs.folder / "00000001.tcai", *files])
    ended.remove(ended.until(None, 0.0))
    assert [path.read_bytes() == data for path, data in zip(files, before, strict=True)] == [False] * 3 + [True] * 3


def short_life(folder: Path) -> Daemon:
    """Go on there, with tasks that end, until an image is taken; then be killed."""
    daemon = Daemon(folder)
    assert daemon.log is not None
    assert daemon.log.images is not None
    clock = daemon.central.clock
    for line, packet in beginning():
        daemon.take(Arrived(clock.now + 1.0, ConnectionId(line), packet))
    for line in LINES:
        daemon.take(ConnectionLost(clock.now + 1.0, ConnectionId(line), "it ended"))
    daemon.log.images.take(daemon.central)
    daemon.log.images.close()
    daemon.kill()
    return daemon


@pytest.mark.parametrize("is_torn", [False, True])
def test_a_run_is_shortened_though_each_life_is_short(tca: Tca, tmp_path: Path, is_torn: bool) -> None:
    """Each life takes one image. Those stay that a recovery may use: the newest, and the one before it that was used."""
    for _ in range(5):
        short_life(tmp_path)
    before, newest = numbers(tmp_path, ".tcas")
    assert min(numbers(tmp_path, ".tcai")) == before
    told = tca("log", "prune", tmp_path, "--keep-bytes", "1")
    assert "of what had ended by" in told.stdout, told.output
    if is_torn:
        os.truncate(tmp_path / f"{newest:08d}.tcas", 100)
    daemon = short_life(tmp_path)
    assert daemon.run is not None
    assert not daemon.run.missing
    assert numbers(tmp_path, ".tcas")[0] == (before if is_torn else newest)
    assert tca("check", "--rerun", tmp_path).exit_code == 0


def test_the_last_moment_is_said_when_more_goes(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    files = journal_of(folder, 5)
    last = History.until(Log(folder)).time
    for segments, part in ((4, 0.4), (4, 0.66), (6, 0.6)):
        assert EndedTasks(files[:segments]).remove(last * part)
    assert entries(files[0])[0].facts[1:] == [Shortened(last * 0.66)]
    assert tca("check", folder).exit_code == 0


def test_waits_for_no_certain_task_go_when_they_are_over(tmp_path: Path) -> None:
    """A program that observes all tasks waits again after each change."""
    wait = ("page", 0, TaskId(0), 0, WaitKind.CHANGE, "any task")
    waits: list[Fact] = [facts.WaitBegan(*wait), facts.WaitEnded(*wait)] * 3
    said = [Entry(place, float((place + 1) // 2), [one]) for place, one in enumerate([*waits, waits[0]])]
    path, newest = tmp_path / "1.tcaj", tmp_path / "2.tcaj"
    EndedTasks([segment(path, said, "life"), segment(newest, said[-1:], "life", 2)]).remove(2.5)
    assert [entry.number for entry in entries(path)] == [0, 4, 5, 6]


def test_a_damaged_segment_is_left_as_it_is(tmp_path: Path) -> None:
    files = journal_of(tmp_path / "journal", 3)
    data = bytearray(files[1].read_bytes())
    data[len(data) // 2] ^= 255
    files[1].write_bytes(data)
    ended = EndedTasks(files)
    ended.remove(ended.until(None, 0.0))
    assert files[1].read_bytes() == data


def test_prune_shortens_the_run_that_continues(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    files = journal_of(folder, 4)
    files[0].chmod(0o640)
    size = sum(path.stat().st_size for path in files)
    tried = tca("log", "prune", folder, "--keep-bytes", str(size // 2), "--dry-run")
    assert (tried.exit_code, sum(path.stat().st_size for path in files)) == (0, size)
    told = tca("log", "prune", folder, "--keep-bytes", str(size // 2))
    assert told.stdout == tried.stdout.replace("would be removed", "removed")
    assert sum(path.stat().st_size for path in files) <= size // 2
    assert files[0].stat().st_mode & 0o777 == 0o640
