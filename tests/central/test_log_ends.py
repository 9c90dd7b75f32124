"""What a kill, a power cut or a full disk leaves at the ends of central's logs: the next starts mend it (decision 102)."""

import errno
import os
from pathlib import Path

import msgspec
import pytest

from fuzz.hostile_central import beginning
from fuzz.hostile_inputs import Daemon
from tca_central.errors import CentralError, DiskFull
from tca_central.events import Arrived, ConnectionId
from tca_central.shell import images, input_log
from tca_central.shell.input_log import Head, InputSegment
from tca_central.shell.log_writer import Sync
from tca_central.shell.run_folder import RunFolder
from tca_tools.run.journals import open_log
from tca_wire.journal import facts
from tca_wire.journal.frames import framed


def live(folder: Path, number: int = 6, sync: Sync = Sync.ALWAYS, *, accept: bool = False) -> Daemon:
    """Start there, take some packets, be killed."""
    daemon = Daemon(folder, sync, accept=accept)
    for line, packet in beginning()[:number]:
        daemon.take(Arrived(daemon.central.clock.now, ConnectionId(line), packet))
    daemon.kill()
    return daemon


def head_of(path: Path) -> Head:
    head = InputSegment(path).head
    assert head is not None
    return head


def shorten(path: Path, size: int) -> None:
    os.truncate(path, path.stat().st_size - size)


@pytest.fixture
def boots(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The file that says how often the machine has started."""
    path = tmp_path / "boot"
    path.write_text("1")
    monkeypatch.setattr(input_log, "BOOT", path)
    return path


TORN = framed(b"\x01" * 50)[:-1]


@pytest.mark.parametrize("suffix", [".tcai", ".tcaj"])
@pytest.mark.parametrize(
    "end", [TORN, TORN[:5], bytes(9000), b"\xce\x00\xff" * 9], ids=["torn", "short", "zeros", "any"]
)
def test_torn_end_stops_no_later_start(tmp_path: Path, suffix: str, end: bytes) -> None:
    events = live(tmp_path).central.events
    for number in (1, 2, 3):
        newest = tmp_path / f"{number:08d}{suffix}"
        whole = newest.read_bytes()
        newest.write_bytes(whole + end)
        before, events = events, live(tmp_path).central.events
        assert events > before
        assert newest.read_bytes() == whole
    assert not list(tmp_path.glob("*-aside"))


@pytest.mark.parametrize("suffix", [".tcai", ".tcaj"])
@pytest.mark.parametrize("content", [b"", bytes(4096), TORN], ids=["empty", "zeros", "torn"])
def test_segment_without_head_stops_no_later_start(tmp_path: Path, suffix: str, content: bytes) -> None:
    events = live(tmp_path).central.events
    for number in (2, 3, 4):
        (tmp_path / f"{number:08d}{suffix}").write_bytes(content)
        (tmp_path / f"{number + 1:08d}{suffix}").write_bytes(content)
        before, events = events, live(tmp_path).central.events
        assert events > before


@pytest.mark.parametrize("heads", [0, 1])
def test_start_on_a_full_disk_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, heads: int
) -> None:
    """It has room for so many heads of the two logs."""
    live(tmp_path)
    write, written = os.write, list[int]()

    def has_little_room(file: int, data: bytes) -> int:
        if len(written) == heads:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append(file)
        return write(file, data)

    monkeypatch.setattr(os, "write", has_little_room)
    with pytest.raises(DiskFull):
        live(tmp_path)
    monkeypatch.undo()
    live(tmp_path)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["00000001.tcai", "00000001.tcaj", "00000002.tcai", "00000002.tcaj"]


def test_damage_before_sound_inputs_is_refused_until_accepted(tmp_path: Path) -> None:
    live(tmp_path)
    inputs = tmp_path / "00000001.tcai"
    whole = bytearray(inputs.read_bytes())
    whole[len(whole) // 2] ^= 1
    inputs.write_bytes(whole)
    with pytest.raises(CentralError, match="an input is damaged, and others follow it"):
        live(tmp_path)
    assert inputs.read_bytes() == whole
    live(tmp_path, accept=True)
    kept = inputs.read_bytes()
    assert kept + (tmp_path / "00000001.tcai-aside").read_bytes() == whole
    live(tmp_path)


def test_segments_behind_accepted_damage_are_put_aside(tmp_path: Path) -> None:
    live(tmp_path)
    live(tmp_path)
    shorten(tmp_path / "00000001.tcai", 1)
    with pytest.raises(CentralError, match=r"00000001.tcai, byte \d+: an input is damaged"):
        live(tmp_path)
    live(tmp_path, accept=True)
    assert (tmp_path / "00000002.tcai-aside").exists()
    live(tmp_path)


def test_journal_ahead_of_the_inputs_is_accepted_after_a_boot(
    tmp_path: Path, boots: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "run"
    live(folder, sync=Sync.BATCH)
    shorten(folder / "00000001.tcai", 100)
    with pytest.raises(CentralError, match="to which the inputs do not lead"):
        live(folder)
    boots.write_text("2")
    daemon = live(folder, sync=Sync.BATCH)
    assert daemon.run is not None
    restarted = [fact for entry in open_log(folder) for fact in entry.facts if isinstance(fact, facts.CentralRestarted)]
    assert [(fact.may_lack, fact.aside) for fact in restarted] == [(True, daemon.run.aside)]
    assert daemon.run.aside
    assert "up to the last second before power was lost may be missing" in caplog.text
    live(folder)


def test_numbers_are_skipped_after_a_start_that_failed(tmp_path: Path, boots: Path) -> None:
    """It has written its head, with the new boot, and nothing else."""
    folder = tmp_path / "run"
    live(folder, sync=Sync.BATCH)
    head = head_of(folder / "00000001.tcai")
    boots.write_text("2")
    failed = msgspec.structs.replace(head, boot="2", is_first=False)
    (folder / "00000002.tcai").write_bytes(framed(msgspec.msgpack.encode(failed)))
    daemon = live(folder)
    assert daemon.central.tree.newest >= 1_000_000


def test_power_cut_between_two_segments_is_mended(tmp_path: Path, boots: Path) -> None:
    """The second one has reached the disk, and the end of the first has not."""
    folder = tmp_path / "run"
    daemon = Daemon(folder, Sync.BATCH)
    assert daemon.log is not None
    packets = beginning()[:8]
    for number, (line, packet) in enumerate(packets):
        daemon.take(Arrived(0.0, ConnectionId(line), packet))
        if number == 5:
            daemon.log._inputs.next_segment(0.0)  # type: ignore[union-attr]
    daemon.kill()
    shorten(folder / "00000001.tcai", 1)
    with pytest.raises(CentralError, match="others follow it"):
        live(folder)
    boots.write_text("2")
    live(folder, 0)
    assert (folder / "00000002.tcai-aside").exists()
    live(folder)


@pytest.mark.parametrize("change", [{"protocol": 5}, {"version": 1}])
def test_inputs_of_another_version_are_refused_with_advice(tmp_path: Path, change: dict[str, int]) -> None:
    live(tmp_path)
    inputs = tmp_path / "00000001.tcai"
    old = framed(msgspec.msgpack.encode(head_of(inputs)))
    new = framed(msgspec.msgpack.encode(msgspec.structs.replace(head_of(inputs), central="0.4", **change)))
    inputs.write_bytes(inputs.read_bytes().replace(old, new))
    for accept in (False, True):
        with pytest.raises(CentralError, match=r"finish the run with tca 0\.4; --fresh begins a new run"):
            live(tmp_path, accept=accept)


@pytest.mark.parametrize("is_empty", [True, False])
def test_tasks_without_their_inputs_are_lost_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, is_empty: bool
) -> None:
    live(tmp_path, len(beginning()))
    os.truncate(tmp_path / "00000001.tcai", 0)
    if not is_empty:
        (tmp_path / "00000001.tcai").unlink()
    folder = RunFolder(tmp_path)
    folder.close()
    assert folder.run is None
    assert "a new run begins, and the tasks of the last one" in caplog.text


def test_half_an_image_takes_no_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    live(tmp_path)
    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(OSError, match="No space"):
        images.write_image(b"image", tmp_path / "00000009.tcas")
    monkeypatch.undo()
    assert not list(tmp_path.glob("*.draft"))
    (tmp_path / "00000002.draft").touch()
    live(tmp_path)
    assert not list(tmp_path.glob("*.draft"))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_only_a_full_disk_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def fails(*_: object) -> int:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "write", fails)
    with pytest.raises(CentralError) as raised:
        Daemon(tmp_path)
    assert isinstance(raised.value, DiskFull) is (number != errno.EIO)
