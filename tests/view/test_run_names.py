"""Names and addresses of runs. They stay the same when other runs come to their folder."""

import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from module.real_central import SOON, until
from tools.story import stumbling, walking

from tca_tools.errors import UnusableLog
from tca_tools.journal.journals import open_log
from tca_tools.view.runs import Runs
from tca_wire.endpoint import default_journals
from tca_wire.journal import facts
from tca_wire.journal.facts import JOURNAL_VERSION


@contextmanager
def runs_of(journal: Path | None) -> Iterator[Runs]:
    runs = Runs(open_log(journal), follows=journal is None)
    try:
        yield runs
    finally:
        runs.stop()


def test_server_end_does_not_wait_for_open_pages(journals: Path) -> None:
    """A page holds the reading and asks for the runs. stop() holds the runs and asks for the
    reading.

    The page and stop() must not wait for each other.
    """
    runs = Runs(open_log(walking().write(journals / "walk")), follows=False)
    shown = runs.show(None)
    assert shown is not None
    has_reading, may_ask = threading.Event(), threading.Event()
    names: list[str] = []

    def list_runs() -> None:
        with shown.reading:
            has_reading.set()
            may_ask.wait(SOON)
            names.extend(run.name for run in runs.names(shown))

    threads = [
        threading.Thread(target=list_runs, daemon=True),
        threading.Thread(target=runs.stop, daemon=True),
    ]
    threads[0].start()
    assert has_reading.wait(SOON)
    threads[1].start()
    until(lambda: runs._is_stopped, "the runs are to be stopped")
    may_ask.set()
    for thread in threads:
        thread.join(SOON)
    assert names == ["walk", "walk"]


def write_second_run(folder: Path) -> None:
    story = stumbling()
    story.entries[0].facts[0] = facts.Opened(JOURNAL_VERSION, "later", 1, 1_700_000_100.0, "0.1.0")
    (folder / "00000002.tcaj").write_bytes(story.encoded())


def link_to(folder: Path, name: str) -> None:
    for link in default_journals().iterdir():
        if link.resolve() == folder:
            link.unlink()
    (default_journals() / name).symlink_to(folder)


@pytest.fixture
def journals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("TCA_CENTRAL", raising=False)
    default_journals().mkdir(parents=True)
    return tmp_path


def test_run_address_holds_when_another_starts_in_its_folder(journals: Path) -> None:
    folder = walking().write(journals / "walk")
    link_to(folder, "2026-01-01")
    with runs_of(None) as runs:
        old = runs.newest
        shown = runs.show(None)
        assert old.name == "walk"
        write_second_run(folder)
        link_to(folder, "2026-01-02")  # as a restarted central does
        assert [run.name for run in runs.all()] == ["walk#1", "walk#2"]
        assert runs.show(old.address) is shown
        assert shown
        assert [one.name for one in runs.names(shown)] == ["walk#1", "walk#2"]
    with runs_of(None) as runs:
        again = runs.show(old.address)
        assert again
        assert runs.names(again)[0] == (old.address, "walk#1")
        assert open_log(Path(old.address)).name == "walk#1"  # the address is valid as LOG, too


def test_empty_run_address_holds_after_the_first_write(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    (folder / "00000001.tcaj").touch()
    with runs_of(folder) as runs:
        shown = runs.show(None)
        assert shown
        empty = shown.address
        (folder / "00000001.tcaj").write_bytes(walking().encoded())
        assert runs.all()[0].address != empty
        assert {one.address for one in runs.names(shown)} == {runs.all()[0].address}
        with shown.reading:
            shown.reading.wait_for_more(0, 60)
        assert shown.address == runs.all()[0].address
        assert runs.show(empty) is runs.show(shown.address) is shown


def test_folders_of_one_name_are_distinguished_by_parent(journals: Path) -> None:
    for number, where in enumerate(
        ("a/robot/journal", "b/robot/journal", "b/arm/journal", "walk", "a/walk")
    ):
        (journals / where).parent.mkdir(parents=True, exist_ok=True)
        link_to(walking().write(journals / where), f"2026-01-0{number}")
    with runs_of(None) as runs:
        names = [run.name for run in runs.all()]
    assert names == [
        "a/robot/journal",
        "b/robot/journal",
        "arm/journal",
        f"{journals.name}/walk",
        "a/walk",
    ]


def test_run_in_a_replaced_folder_is_gone(journals: Path) -> None:
    folder = walking().write(journals / "walk")
    with runs_of(folder) as runs:
        (before,) = runs.all()
        shutil.rmtree(folder)
        story = stumbling()
        story.entries[0].facts[0] = facts.Opened(
            JOURNAL_VERSION, "another", 1, 1_700_000_100.0, "0.1.0"
        )
        story.write(folder)
        (after,) = runs.all()
        assert runs.show(after.address) is not None
    assert after.epoch == "another"
    with pytest.raises(UnusableLog, match="no longer there"):
        open_log(folder, before.epoch)
