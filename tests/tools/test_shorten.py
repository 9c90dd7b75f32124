"""``tca log prune`` of a run that continues: ended tasks go, and the rest reads as before."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from properties.life import Life
from tools.test_logs import segment

from tca_central.shell.input_log import InputLog
from tca_central.shell.log_writer import Sync
from tca_tools.log.shorten import EndedTasks
from tca_tools.run.fold import History
from tca_tools.run.journals import Log
from tca_wire.journal.records import JournalReader
from tca_wire.points import END_ACHIEVING

Tca = Callable[..., Result]


def journal_of(folder: Path, seed: int, events: int = 600, parts: int = 6) -> list[Path]:
    """A random life in segments, the last of which is still written to."""
    life = Life()
    life.go_on(seed, events)
    entries = [entry for entry in life.player.entries if entry.facts]
    step = len(entries) // parts
    cuts = [*(step * part for part in range(parts)), len(entries)]
    folder.mkdir()
    return [
        segment(folder / f"{number:08d}.tcaj", entries[start:end], "life", number)
        for number, (start, end) in enumerate(pairwise(cuts), 1)
    ]


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
    with files[3].open("rb") as stream:
        begun = next(iter(JournalReader(stream))).time
    inputs = InputLog(tmp_path / "journal", epoch="life", version="0", sync=Sync.NONE, clock=begun)
    inputs.close()
    before = [path.read_bytes() for path in files]
    ended = EndedTasks([inputs.folder / "00000001.tcai", *files])
    ended.remove(ended.until(None, 0.0))
    assert [path.read_bytes() == data for path, data in zip(files, before, strict=True)] == [False] * 3 + [True] * 3


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
    size = sum(path.stat().st_size for path in files)
    tried = tca("log", "prune", folder, "--keep-bytes", str(size // 2), "--dry-run")
    assert (tried.exit_code, sum(path.stat().st_size for path in files)) == (0, size)
    told = tca("log", "prune", folder, "--keep-bytes", str(size // 2))
    assert told.stdout == tried.stdout.replace("would be removed", "removed")
    assert sum(path.stat().st_size for path in files) <= size // 2
