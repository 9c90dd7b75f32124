"""The journal on real files: segments, syncs, and failing disks."""

import errno
import os
import shutil
import threading
from pathlib import Path

import pytest
from processes import Central, central

from tca_central.core import Central as Core
from tca_central.errors import CentralError
from tca_central.events import Tick
from tca_central.shell import log_writer, run_log
from tca_central.shell.input_log import InputLog
from tca_central.shell.journal_writer import JournalWriter
from tca_central.shell.log_writer import Sync, lock_folder
from tca_central.shell.recovery import unfinished_segments
from tca_central.shell.run_log import RunLog
from tca_module import Client, Inform, TcaError, connect
from tca_tools.errors import UnusableLog
from tca_tools.journal.journals import newest_journal, open_log
from tca_wire.journal.facts import Closed, Dropped, Entry, Opened

NOTE = Inform("note", bytes)


def writer(folder: Path, sync: Sync = Sync.BATCH) -> JournalWriter:
    os.close(lock_folder(folder))
    return JournalWriter(folder, epoch="e", sync=sync)


@pytest.mark.parametrize("sync", list(Sync))
def test_journal_entries_can_be_read_back(tmp_path: Path, sync: Sync) -> None:
    journal = writer(tmp_path / "run", sync)
    for number in range(1, 100):
        journal.add(Entry(number, number / 10, [Dropped(number, "any", "why")]))
        journal.flush()
    journal.end(100, 10.0, "done")
    entries = list(open_log(tmp_path / "run"))
    assert [entry.number for entry in entries] == list(range(101))
    assert isinstance(entries[0].facts[0], Opened)
    assert entries[-1].facts == [Closed("done")]


def test_long_journal_is_split_into_consecutive_segments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(JournalWriter, "longest", 2000)
    journal = writer(tmp_path / "run")
    for number in range(1, 200):
        journal.add(Entry(number, number / 10, [Dropped(number, "any", "x" * 50)]))
        journal.flush()
    journal.end(200, 20.0, "done")
    segments = sorted(path.name for path in (tmp_path / "run").iterdir())
    assert segments[:3] == ["00000001.tcaj", "00000002.tcaj", "00000003.tcaj"]
    dropped = [
        fact.id
        for entry in open_log(tmp_path / "run")
        for fact in entry.facts
        if isinstance(fact, Dropped)
    ]
    assert dropped == list(range(1, 200))


def test_journal_writer_does_not_wait_for_sync(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The writer even starts another segment during a sync."""
    monkeypatch.setattr(log_writer, "SYNC_PERIOD", 0.01)
    monkeypatch.setattr(JournalWriter, "longest", 100)
    sync_began, done, synced = threading.Event(), threading.Event(), []

    def slow(file: int) -> None:
        sync_began.set()
        synced.append((file, done.wait(10.0)))

    monkeypatch.setattr(os, "fdatasync", slow)
    journal = writer(tmp_path / "run")
    assert sync_began.wait(10.0)
    for number in range(1, 20):
        journal.add(Entry(number, number / 10, [Dropped(number, "any", "x" * 50)]))
        journal.flush()
    done.set()
    segments = journal.newest
    journal.end(20, 2.0, "done")
    assert segments > 3
    assert len({file for file, _ in synced}) >= segments
    assert all(was_done for _, was_done in synced), "it waited"


def test_journal_flush_fails_on_full_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_writer, "SYNC_PERIOD", 0.01)
    journal = writer(tmp_path / "run")
    os.close(journal._file)
    journal._file = os.open("/dev/full", os.O_WRONLY)
    journal.add(Entry(1, 0.5, [Dropped(1, "any", "why")]))
    with pytest.raises(CentralError, match="No space left on device: make room"):
        journal.flush()


FULL = """
import resource, sys
from tca_central.__main__ import central
sys.dont_write_bytecode = True  # the limit would truncate shared bytecode files
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))  # as if the disk were full
central()
"""


def test_full_disk_stops_central_and_keeps_journal_readable(
    tmp_path: Path,
) -> None:
    daemon = Central(tmp_path, command=("-c", FULL))
    with pytest.raises(TcaError), connect("user", daemon.address, patience=2) as user:
        flood(user)
    assert daemon.process.wait(timeout=10) == 1
    log_text = daemon.stop()
    assert "File too large: central stops, since it must not act without recording it" in log_text
    assert "Traceback" not in log_text
    assert len(list(open_log(daemon.journal))) > 5


def flood(user: Client) -> None:
    while True:
        user.inform(NOTE, bytes(1000))
        user.status("status")


def test_newest_journal_is_found_in_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with central(tmp_path / "old") as old:
        pass
    assert newest_journal().resolve() == old.journal.resolve()
    shutil.rmtree(old.journal)
    with central(tmp_path / "new") as new:
        assert newest_journal().resolve() == new.journal.resolve()
    assert (
        len(list((tmp_path / "state/tca/journals").iterdir())) == 1
    )  # links to removed journals are removed


def test_newest_journal_is_that_of_the_selected_central(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with central(tmp_path / "a") as one, central(tmp_path / "b", bind="tcp://127.0.0.1:*") as other:
        monkeypatch.setenv("TCA_CENTRAL", one.address)
        assert newest_journal() == one.journal.resolve()
        monkeypatch.setenv(
            "TCA_CENTRAL", other.first_line.split()[-1].replace("127.0.0.1", "localhost")
        )
        assert newest_journal() == other.journal.resolve()
    monkeypatch.setenv("TCA_CENTRAL", "tcp://robot:7000")
    with pytest.raises(
        UnusableLog, match=r"no journal of the central at tcp://robot:7000 \(\$TCA_CENTRAL\)"
    ):
        newest_journal()
    monkeypatch.delenv("TCA_CENTRAL")
    assert newest_journal().resolve() == other.journal.resolve()


def test_newest_journal_is_that_of_the_central_that_leads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with central(tmp_path / "a") as one:
        with central(tmp_path / "b") as other:
            monkeypatch.setenv("TCA_CENTRAL", f"tcp://robot:7000,{one.address}")
            with pytest.raises(UnusableLog, match=one.address):
                newest_journal()
            monkeypatch.setenv("TCA_CENTRAL", f"ipc:///none, {one.address}, {other.address}")
            assert newest_journal() == other.journal.resolve()
        assert newest_journal() == one.journal.resolve()
    assert newest_journal() == other.journal.resolve()


def test_failed_sync_raises_and_leaves_the_run_unfinished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir()
    inputs = InputLog(tmp_path / "run", epoch="e", sync=Sync.ALWAYS)
    log = RunLog(writer(tmp_path / "run"), inputs)
    core = Core("e")

    def fails(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    log.add_input(Tick(1.0))
    log.flush(core)
    monkeypatch.setattr(os, "fdatasync", fails)
    log.add_input(Tick(2.0))
    for _ in range(2):  # a second sync would wrongly succeed
        with pytest.raises(CentralError, match="Input/output error: central stops"):
            log.flush(core)
    monkeypatch.undo()
    log.end(core, "", is_over=False)
    assert not any(
        isinstance(fact, Closed) for entry in open_log(tmp_path / "run") for fact in entry.facts
    )
    assert unfinished_segments(tmp_path / "run")


def test_removed_journal_stops_central(tmp_path: Path) -> None:
    with central(tmp_path) as daemon, connect("user", daemon.address, patience=3) as user:
        user.status()
        shutil.rmtree(daemon.journal)
        assert daemon.process.wait(timeout=10) == 1
        assert "it was removed: central stops" in daemon.stop()


def test_central_continues_without_journal_when_allowed(tmp_path: Path) -> None:
    with (
        central(tmp_path, "--if-journal-fails", "go-on") as daemon,
        connect("user", daemon.address) as user,
    ):
        user.status()
        for path in daemon.journal.glob("*.tcaj"):
            path.unlink()
        while "continues without a journal" not in daemon.process.stderr.readline():
            pass
        user.status()
    assert not list(daemon.journal.glob("*.tcai"))  # the stale inputs must not be continued


def test_disk_is_nearly_full_when_free_bytes_and_share_are_low(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Central's reaction is tested in central/test_limits.py."""
    (tmp_path / "run").mkdir()
    log = RunLog(writer(tmp_path / "run"), None)
    for least, share, is_full in ((1 << 80, 1, True), (1 << 80, 1 << 80, False), (0, 1, False)):
        monkeypatch.setattr(run_log, "LEAST_FREE", least)
        monkeypatch.setattr(run_log, "LEAST_SHARE", share)
        assert log.is_nearly_full() is is_full
    log.end(Core("e"), "", is_over=True)


def test_journal_folder_lock_waits_for_a_late_release(tmp_path: Path) -> None:
    """If central is killed while it takes an image, a child is left. The child holds the locks
    until it closes them.
    """
    held = lock_folder(tmp_path)
    timer = threading.Timer(0.1, os.close, [held])
    timer.start()
    os.close(lock_folder(tmp_path))
    timer.join()
