"""A kill, a power cut or a full disk leaves torn ends in central's logs. The next start repairs
these ends (decision 102).
"""

import errno
import os
from itertools import count
from pathlib import Path
from typing import Any

import msgspec
import pytest

from dev.fuzz.hostile_central import beginning
from dev.fuzz.hostile_inputs import Daemon
from tca_central.errors import CentralError, DiskFull
from tca_central.events import Arrived, ConnectionId
from tca_central.shell import images, input_log
from tca_central.shell.input_log import InputSegment
from tca_central.shell.log_writer import Sync, move_file_aside
from tca_central.shell.run_folder import RunFolder
from tca_tools.journal.journals import open_log
from tca_wire.journal import facts
from tca_wire.journal.frames import framed


def live(
    folder: Path, number: int = 6, sync: Sync = Sync.ALWAYS, *, accept: bool = False
) -> Daemon:
    """Start a daemon in *folder*, give it some packets, and kill it."""
    daemon = Daemon(folder, sync, accept=accept)
    for line, packet in beginning()[:number]:
        daemon.handle_input(Arrived(daemon.central.clock.now, ConnectionId(line), packet))
    daemon.kill()
    return daemon


def head(path: Path, **changes: Any) -> bytes:
    """Return the head of a segment, with changes."""
    found = InputSegment(path).head
    assert found is not None
    return framed(msgspec.msgpack.encode(msgspec.structs.replace(found, **changes)))


def shorten(path: Path, size: int) -> None:
    os.truncate(path, path.stat().st_size - size)


@pytest.fixture
def boots(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Return the file with the boot id of the machine."""
    path = tmp_path / "boot"
    path.write_text("1")
    monkeypatch.setattr(input_log, "BOOT", path)
    return path


def fail(
    monkeypatch: pytest.MonkeyPatch, name: str, after: int = 0, number: int = errno.ENOSPC
) -> None:
    """Let a function of ``os`` fail after some calls, by default as on a full disk."""
    real, calls = getattr(os, name), count()

    def failing(*arguments: Any) -> Any:
        if next(calls) < after:
            return real(*arguments)
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, name, failing)


TORN = framed(b"\x01" * 50)[:-1]


@pytest.mark.parametrize("suffix", [".tcai", ".tcaj"])
@pytest.mark.parametrize("left", [TORN, TORN[:5], bytes(9000), b"\xce\x00\xff" * 9, b""])
@pytest.mark.parametrize("is_segment", [False, True])
def test_leftovers_of_a_kill_do_not_stop_later_starts(
    tmp_path: Path, suffix: str, left: bytes, *, is_segment: bool
) -> None:
    events = live(tmp_path).central.event_count
    for number in (1, 2, 3):
        newest, *following = (tmp_path / f"{number + later:08d}{suffix}" for later in range(3))
        whole = newest.read_bytes()
        for path in following if is_segment else [newest]:
            path.write_bytes((b"" if is_segment else whole) + left)
        before, events = events, live(tmp_path).central.event_count
        assert events > before
        assert newest.read_bytes() == whole
    assert not list(tmp_path.glob("*-aside"))


@pytest.mark.parametrize("heads", [0, 1])
def test_start_on_full_disk_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, heads: int
) -> None:
    """The disk has room for the heads of none or one of the two logs."""
    live(tmp_path)
    fail(monkeypatch, "write", heads)
    with pytest.raises(DiskFull):
        live(tmp_path)
    monkeypatch.undo()
    live(tmp_path)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["00000001.tcai", "00000001.tcaj", "00000002.tcai", "00000002.tcaj"]


def test_damage_before_sound_inputs_is_refused_until_accepted(tmp_path: Path) -> None:
    live(tmp_path)
    live(tmp_path)
    inputs = tmp_path / "00000001.tcai"
    whole = bytearray(inputs.read_bytes())
    whole[len(whole) // 2] ^= 1
    inputs.write_bytes(whole)
    with pytest.raises(
        CentralError, match=r"00000001.tcai, byte \d+: an input is damaged, and others follow it"
    ):
        live(tmp_path)
    assert inputs.read_bytes() == whole
    live(tmp_path, accept=True)
    assert inputs.read_bytes() + (tmp_path / "00000001.tcai-aside").read_bytes() == whole
    assert (tmp_path / "00000002.tcai-aside").exists()
    live(tmp_path)


def test_journal_ahead_of_inputs_is_accepted_after_reboot(
    tmp_path: Path, boots: Path, caplog: pytest.LogCaptureFixture
) -> None:
    live(tmp_path, sync=Sync.BATCH)
    shorten(tmp_path / "00000001.tcai", 100)
    with pytest.raises(CentralError, match="to which no input leads"):
        live(tmp_path)
    boots.write_text("2")
    daemon = live(tmp_path, sync=Sync.BATCH)
    assert daemon.run is not None
    restarted = [
        fact
        for entry in open_log(tmp_path)
        for fact in entry.facts
        if isinstance(fact, facts.CentralRestarted)
    ]
    assert [(fact.may_lack, fact.aside) for fact in restarted] == [(True, daemon.run.aside)]
    assert daemon.run.aside
    assert "up to the last second before power was lost may be missing" in caplog.text
    live(tmp_path)


def test_task_ids_are_skipped_after_a_failed_start(tmp_path: Path, boots: Path) -> None:
    """The failed start has written only the head of its segment, with the new boot id."""
    live(tmp_path, sync=Sync.BATCH)
    boots.write_text("2")
    (tmp_path / "00000002.tcai").write_bytes(
        head(tmp_path / "00000001.tcai", boot="2", is_first=False)
    )
    assert live(tmp_path).central.tree.newest >= 1_000_000


def test_power_cut_between_two_segments_is_repaired(tmp_path: Path, boots: Path) -> None:
    """The second segment has reached the disk, but the end of the first segment has not."""
    live(tmp_path, sync=Sync.BATCH)
    live(tmp_path, sync=Sync.BATCH)
    shorten(tmp_path / "00000001.tcai", 1)
    with pytest.raises(CentralError, match="others follow it"):
        live(tmp_path)
    boots.write_text("2")
    live(tmp_path, 0)
    assert (tmp_path / "00000002.tcai-aside").exists()
    live(tmp_path)


@pytest.mark.parametrize("change", [{"protocol": 5}, {"version": 1}])
def test_inputs_of_another_version_are_refused_with_advice(
    tmp_path: Path, change: dict[str, int]
) -> None:
    live(tmp_path)
    inputs = tmp_path / "00000001.tcai"
    new = head(inputs, central="0.4", **change)
    inputs.write_bytes(inputs.read_bytes().replace(head(inputs), new))
    with pytest.raises(
        CentralError, match=r"finish the run with tca 0\.4; --fresh starts a new run"
    ):
        live(tmp_path, accept=True)


@pytest.mark.parametrize("is_empty", [True, False])
def test_tasks_without_inputs_are_lost_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, is_empty: bool
) -> None:
    live(tmp_path, len(beginning()))
    os.truncate(tmp_path / "00000001.tcai", 0)
    if not is_empty:
        (tmp_path / "00000001.tcai").unlink()
    folder = RunFolder(tmp_path)
    folder.close()
    assert folder.run is None
    assert "a new run starts, and the tasks of the last run" in caplog.text


def test_failed_image_write_leaves_no_draft(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live(tmp_path)
    fail(monkeypatch, "fsync")
    with pytest.raises(OSError, match="No space"):
        images.write_image(b"image", tmp_path / "00000009.tcas")
    monkeypatch.undo()
    assert not list(tmp_path.glob("*.draft"))
    (tmp_path / "00000002.draft").touch()
    live(tmp_path)
    assert not list(tmp_path.glob("*.draft"))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_only_full_disk_errors_raise_disk_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    fail(monkeypatch, "write", number=number)
    with pytest.raises(CentralError) as raised:
        Daemon(tmp_path)
    assert isinstance(raised.value, DiskFull) is (number != errno.EIO)


def test_file_moved_aside_again_overwrites_nothing(tmp_path: Path) -> None:
    segment, aside = tmp_path / "00000001.tcaj", tmp_path / "00000001.tcaj-aside"
    for data in (b"first", b"second"):
        segment.write_bytes(data)
        move_file_aside(segment)
    assert aside.read_bytes() == b"firstsecond"
    assert not segment.exists()
