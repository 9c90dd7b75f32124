"""``tca log prune``: whole runs go, with what lies beside them; never what a central writes, or may go on."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from click.testing import Result
from integration.programs import central
from tools.story import walking
from tools.test_logs import segment

from tca_module import connect
from tca_wire.journal.facts import Closed, Entry
from tca_wire.journal.frames import framed

Tca = Callable[..., Result]
DAY = 86400.0
GOODBYE = Entry(99, 99.0, [Closed("stopped")])


def run(folder: Path, epoch: str, number: int, *, ended: float, closed: bool = True) -> list[Path]:
    """A run of two segments that ended so many days ago; its files."""
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


def beside(folder: Path, number: int, epoch: str, days: float) -> list[Path]:
    """Inputs and an image, as central writes them beside the segments, with numbers of their own."""
    made = [folder / f"{number:08d}{suffix}" for suffix in (".tcai", ".tcas", ".draft")]
    made[0].write_bytes(framed(msgspec.msgpack.encode(["inputs", 1, epoch, "0.1.0"])))
    for path in made[1:]:
        path.write_bytes(b"any")
    return aged(made, days)


def left(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_whole_runs_that_ended_longer_ago_go_with_what_lies_beside_them(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    old = [*run(folder, "old", 1, ended=40), *beside(folder, 7, "old", 40)]
    new = [*run(folder, "new", 3, ended=2), *beside(folder, 9, "new", 2)]
    foreign = folder / "notes.draft"
    foreign.write_text("mine")
    tried = tca("log", "prune", folder, "--keep", "30d", "--dry-run")
    assert tried.exit_code == 0
    assert f"{folder}#1" in tried.stdout
    assert f"{folder}#2" not in tried.stdout
    assert left(folder) == sorted(path.name for path in (*old, *new, foreign))
    told = tca("log", "prune", folder, "--keep", "30d")
    assert told.stdout == tried.stdout.replace("would be removed", "removed")
    assert left(folder) == sorted(path.name for path in (*new, foreign))
    assert "1 run left" in told.stdout


def test_the_oldest_go_until_the_others_have_the_size(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    runs = [run(folder, f"run{number}", 2 * number + 1, ended=9.0 - number) for number in range(4)]
    size = sum(path.stat().st_size for path in runs[0])
    assert tca("log", "prune", folder, "--keep-bytes", str(2 * size + 1)).exit_code == 0
    assert left(folder) == sorted(path.name for some in runs[2:] for path in some)


@pytest.mark.parametrize("options", [("--keep", "1h"), ("--keep-bytes", "0")])
def test_the_newest_run_without_a_goodbye_stays(tca: Tca, tmp_path: Path, options: tuple[str, str]) -> None:
    folder = tmp_path / "robot"
    run(folder, "first", 1, ended=30, closed=False)
    crashed = run(folder, "second", 3, ended=20, closed=False)
    run(folder, "third", 5, ended=10)
    told = tca("log", "prune", folder, *options)
    assert told.exit_code == 0
    assert left(folder) == [path.name for path in crashed]
    assert "it may go on" in told.stdout


def test_a_robot_that_learns_the_time_late_keeps_what_came_last(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    run(folder, "first", 1, ended=1)
    run(folder, "second", 3, ended=20000)  # days: its clock stood at 1970
    tca("log", "prune", folder, "--keep", "7d")
    assert len(left(folder)) == 4


def test_a_later_number_is_kept_whatever_its_clock_said(tca: Tca, tmp_path: Path) -> None:
    for name, ended in (("000001-2026", 40), ("000002-2026", 2), ("000003-1970", 20000)):
        run(tmp_path / name, name, 1, ended=ended)
    tca("log", "prune", tmp_path, "--keep", "7d")
    assert sorted({Path(name).parts[0] for name in left(tmp_path)}) == ["000002-2026", "000003-1970"]


def test_folders_of_runs_go_and_the_folder_that_was_named_stays(
    tca: Tca, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journals, elsewhere = tmp_path / "tca" / "journals", tmp_path / "elsewhere"
    for place in (journals / "2025-01-01", journals / "2025-01-02", elsewhere):
        run(place, place.name, 1, ended=50)
    (journals / "2025-01-03").symlink_to(elsewhere)
    (journals / "2025-01-01" / "notes").write_text("mine")
    (journals / "empty").mkdir()
    told = tca("log", "prune", "--keep", "2w", XDG_STATE_HOME=str(tmp_path))
    assert (told.exit_code, told.stdout.count("ended")) == (0, 2)
    assert left(journals) == ["2025-01-01/notes"]
    assert sorted(path.name for path in journals.iterdir()) == ["2025-01-01", "2025-01-03", "empty"]
    assert len(left(elsewhere)) == 2


def test_what_a_living_central_writes_stays(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "journal"
    run(folder, "old", 1, ended=40)
    with central(tmp_path) as running:
        assert running.journal == folder
        connect("reader", running.address).close()  # central answers when its journal is begun
        told = tca("log", "prune", folder, "--keep-bytes", "0")
        assert "a central writes it" in told.stdout
        assert "00000003.tcaj" in left(folder)
        assert "00000001.tcaj" not in left(folder)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "say what to keep"),
        (("--keep", "30"), "with one of min, h, d, w"),
        (("--keep", "30m"), "with one of min, h, d, w"),
        (("--keep-bytes", "-1G"), "with one of K, M, G, T"),
        (("--keep", "1d"), "no runs lie there"),
    ],
)
def test_wrong_usage(tca: Tca, tmp_path: Path, arguments: tuple[str, ...], complaint: str) -> None:
    told = tca("log", "prune", tmp_path, *arguments)
    assert (told.exit_code, complaint in told.stderr) == (2, True)


def test_files_that_are_none_of_a_journal_are_ignored(tca: Tca, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    run(folder, "one", 1, ended=1)
    before = tca("tree", folder)
    beside(folder, 1, "one", 1)
    (folder / "00000003.txt").write_text("mine")
    (folder / "permissions.toml").write_text("")
    (folder / "video").mkdir()
    after = tca("tree", folder)
    assert (after.exit_code, after.stdout, after.stderr) == (before.exit_code, before.stdout, before.stderr)
