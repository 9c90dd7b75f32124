"""Copies of large data on the disk: made in time, restored, and saved from dead centrals."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from central.shared_store import DATA, MODULE, Shared, handle
from waiting import wait_until

from tca_central.errors import CentralError
from tca_central.shell import kept_data, store
from tca_central.shell.kept_data import KeptData
from tca_central.shell.log_writer import Sync
from tca_central.shell.store import Store
from tca_wire.packets.large import Keep


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[KeptData]:
    monkeypatch.setattr(store, "DELAY", 0.0)
    (tmp_path / "journal").mkdir()
    copies = KeptData(tmp_path / "journal", "run", Sync.BATCH)
    yield copies
    copies.close(is_over=True)


def copied(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_kept_segments_are_copied(tmp_path: Path, kept: KeptData) -> None:
    shared, journal = Shared(tmp_path, kept=kept), tmp_path / "journal"
    keeps = (Keep.NOTHING, Keep.TASK, Keep.JOURNAL, Keep.TASK | Keep.JOURNAL)
    bodies = [
        shared.store.adopt(shared.write(f"a1/{number}", keep=keep))
        for number, keep in enumerate(keeps)
    ]
    shared.sweep()
    expected = ["data/run/a1/2", "data/run/a1/3", "held/run/a1/1"]
    wait_until(lambda: copied(journal) == expected)
    assert {(journal / name).read_bytes() for name in expected} == {DATA}
    bodies.clear()
    wait_until(lambda: shared.files() == [f"a1/{number}.free" for number in range(4)])
    assert copied(journal) == expected[:2]
    shared.close()


def test_segment_of_a_short_task_is_free_at_once(tmp_path: Path) -> None:
    shared = Shared(tmp_path, kept=KeptData(tmp_path / "journal", "run", Sync.BATCH))
    body = shared.store.adopt(shared.write("a1/1", keep=Keep.TASK))
    del body
    assert shared.files() == ["a1/1.free"]
    shared.close()
    assert copied(tmp_path / "journal") == []


def test_stop_copies_the_data_of_tasks_first(tmp_path: Path) -> None:
    shared = Shared(tmp_path, kept=KeptData(tmp_path / "journal", "run", Sync.BATCH))
    body = shared.store.adopt(shared.write("a1/1", keep=Keep.TASK))
    shared.close()
    assert copied(tmp_path / "journal") == ["held/run/a1/1"]
    del body


def test_segments_of_tasks_are_restored(tmp_path: Path, kept: KeptData) -> None:
    first, journal = Shared(tmp_path, kept=kept), tmp_path / "journal"
    bodies = [first.store.adopt(first.write(f"a1/{one}", keep=Keep.TASK)) for one in (1, 2)]
    first.sweep()
    wait_until(lambda: copied(journal) == ["held/run/a1/1", "held/run/a1/2"])
    first.close()
    for name in ("a1/1", "a1/2"):
        (first.folder / name).unlink()
    (first.folder / "a1").rmdir()
    again = Store(tmp_path)
    body = again.adopt(handle("a1/1", keep=Keep.TASK))
    again.open("run", KeptData(journal, "run", Sync.BATCH))
    assert (first.folder / "a1/1").read_bytes() == DATA
    assert not (first.folder / "a1/2").exists()
    assert copied(journal) == ["held/run/a1/1"]
    again.close(is_over=True)
    assert copied(journal) == []
    del bodies, body


def test_tasks_are_on_the_disk_at_once_when_always(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    journal.mkdir()
    shared = Shared(tmp_path, kept=KeptData(journal, "run", Sync.ALWAYS))
    body = shared.store.adopt(shared.write("a1/1", keep=Keep.TASK))
    shared.store.flush()
    assert copied(journal) == ["held/run/a1/1"]
    del body
    shared.close()


@pytest.mark.parametrize("sync", [Sync.ALWAYS, Sync.BATCH])
def test_failed_copy_stops_central_only_when_always(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, sync: Sync
) -> None:
    monkeypatch.setattr(store, "DELAY", 0.0)
    (tmp_path / "held").write_text("no folder")
    shared = Shared(tmp_path, kept=KeptData(tmp_path, "run", sync))
    body = shared.store.adopt(shared.write("a1/1", keep=Keep.TASK))
    if sync is Sync.ALWAYS:
        with pytest.raises(CentralError, match="central stops"):
            shared.store.flush()
    else:
        shared.sweep()
        wait_until(lambda: "can't be copied" in caplog.text)
    assert shared.files() == ["a1/1"]
    del body
    wait_until(lambda: shared.files() == ["a1/1.free"])
    shared.close()


def test_failed_copy_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "DELAY", 0.0)
    monkeypatch.setattr(store, "TRIED_AGAIN", 0.0)
    (tmp_path / "journal").write_text("no folder")
    kept = KeptData(tmp_path / "journal", "run", Sync.BATCH)
    shared = Shared(tmp_path, kept=kept)
    body = shared.store.adopt(shared.write("a1/1", keep=Keep.TASK))
    shared.sweep()
    wait_until(lambda: kept.failed == ["a1/1"])
    (tmp_path / "journal").unlink()
    shared.sweep()
    wait_until(lambda: copied(tmp_path / "journal") == ["held/run/a1/1"])
    del body
    shared.close()


def test_data_of_a_killed_central_survive_its_folder(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    journal.mkdir()
    killed = Shared(tmp_path, "killed", KeptData(journal, "killed", Sync.BATCH))
    bodies = [
        killed.store.adopt(killed.write("a1/1", keep=Keep.TASK)),
        killed.store.adopt(killed.write("a1/2")),
    ]
    killed.write("a1/3")
    killed.kill()
    other = Shared(tmp_path)
    other.sweep()
    other.close()
    assert not killed.folder.exists()
    assert copied(journal) == ["held/killed/a1/1", "held/killed/a1/2"]
    again = Store(tmp_path)
    restored = [again.adopt(handle("a1/1", keep=Keep.TASK)), again.adopt(handle("a1/2"))]
    again.open("killed", KeptData(journal, "killed", Sync.BATCH))
    for name in ("a1/1", "a1/2"):
        assert (killed.folder / name).read_bytes() == DATA
    del restored
    again.settle({MODULE})
    assert copied(journal) == []
    again.close(is_over=True)
    del bodies


def test_data_stay_in_memory_when_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    killed = Shared(tmp_path, "killed", KeptData(tmp_path, "killed", Sync.BATCH))
    body = killed.store.adopt(killed.write("a1/1"))
    killed.kill()
    other = Shared(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=len(DATA)))
    other.sweep()
    other.sweep()
    assert (killed.folder / "a1/1").exists()
    assert caplog.text.count("can't be saved") == 1
    monkeypatch.undo()
    other.sweep()
    assert not killed.folder.exists()
    other.close()
    del body


def test_journal_lacks_data_when_the_disk_is_too_slow(
    tmp_path: Path,
    kept: KeptData,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(kept_data, "MOST_PENDING", len(DATA) - 1)
    shared = Shared(tmp_path, kept=kept)
    bodies = [
        shared.store.adopt(shared.write(f"a1/{int(keep)}", keep=keep))
        for keep in (Keep.JOURNAL, Keep.TASK)
    ]
    assert "the journal lacks large data" in caplog.text
    shared.sweep()
    wait_until(lambda: copied(tmp_path / "journal") == ["held/run/a1/1"])
    bodies.clear()
    wait_until(lambda: shared.files() == ["a1/1.free", "a1/2.free"])
    shared.close()
