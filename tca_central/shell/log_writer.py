"""Append-only logs: segments NNNNNNNN of one suffix in the folder of a journal.

``Sync`` has three ways to keep records safe. The server's loop writes once per turn, before it
sends the messages that follow from the turn's records. With ``batch`` another thread syncs the disk
once a second.
"""

import contextlib
import errno
import fcntl
import os
import threading
import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path

from tca_central.errors import CentralError, disk_error
from tca_wire.journal.frames import has_record

SEGMENT_BYTES = 64 << 20
SYNC_PERIOD = 1.0  # seconds
LOCK_PATIENCE = 1.0  # seconds
ASIDE = "-aside"
WRITE_LATER = 256 << 10
"""With ``none``: bytes that may wait in memory."""


class Sync(StrEnum):
    """When records are safe, and from which failures."""

    # Records are on the disk before central sends the turn's messages, and survive a power cut.
    ALWAYS = "always"
    # Records are with the kernel by then, and on the disk within a second. They survive a crash of
    # central.
    BATCH = "batch"
    # Records are written when many wait: a crash loses the last ones.
    NONE = "none"


def lock(file: int, patience: float = LOCK_PATIENCE) -> None:
    """Lock a file until this process ends.

    If the file is locked, wait up to *patience* seconds: a killed central's child that writes an
    image has the lock a little longer. Raises BlockingIOError if another process keeps the lock,
    OSError where there are no locks.
    """
    until = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > until:
                raise
        else:
            return
        time.sleep(0.02)


def lock_folder(folder: Path) -> int:
    """Lock a journal's folder, created if missing. Return the lock's file. Raises CentralError.

    Two running centrals would mix their segments. The lock ends with this process.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        locked = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise disk_error(error, f"journal {folder}") from None
    try:
        lock(locked)
    except BlockingIOError:
        os.close(locked)
        msg = (
            f"{folder}: another central writes its journal there: "
            "name another folder with --journal"
        )
        raise CentralError(msg) from None
    except OSError:  # some file systems have no locks
        pass
    return locked


def sync_path(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk. Raises OSError."""
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def cut(path: Path, end: int) -> None:
    """Truncate a file durably. Raises OSError."""
    with path.open("r+b") as stream:
        stream.truncate(end)
        os.fsync(stream.fileno())


def append(path: Path, data: bytes) -> None:
    """Append to a file durably. Raises OSError."""
    with path.open("ab") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def move_aside(path: Path, begin: int, *later: Path) -> None:
    """Move a log's bytes from *begin* on, and *later* files, to files beside it. Raises OSError.

    The later files move before the log is cut. After a log with a sound end they would count as its
    continuation.
    """
    with path.open("rb") as stream:
        stream.seek(begin)
        if rest := stream.read():
            append(aside_path(path), rest)
    for file in later:
        move_file_aside(file)
    sync_path(path.parent)
    cut(path, begin)


def move_file_aside(path: Path) -> None:
    """Move a whole file to one beside it, after what was moved there before. Raises OSError."""
    if (aside := aside_path(path)).exists():
        append(aside, path.read_bytes())
        path.unlink()
    else:
        path.rename(aside)


def aside_path(path: Path) -> Path:
    """Return the file for bytes that were removed from a log. No program reads it."""
    return path.with_suffix(f"{path.suffix}{ASIDE}")


def has_no_record(path: Path) -> bool:
    """Whether a log has no record: central ended while creating it."""
    return not has_record(b"\0" + path.read_bytes())


def is_in_use(folder: Path) -> bool:
    """Whether a running central has the lock of a folder."""
    try:
        os.close(lock_folder(folder))
    except CentralError:
        return True
    return False


def files_of(folder: Path, suffix: str) -> list[Path]:
    """Return the files of one suffix, in order."""
    return [folder / f"{number:08d}{suffix}" for number in numbers(folder, suffix)]


def numbers(folder: Path, suffix: str) -> list[int]:
    """Return the numbers of the files of one suffix, in order."""
    return sorted(int(path.stem) for path in folder.glob(f"*{suffix}") if path.stem.isdecimal())


class LogWriter:
    """Writes segments of one suffix. Subclasses define ``head``, a segment's first record."""

    longest: float = SEGMENT_BYTES  #: bytes after which another segment starts

    def __init__(self, folder: Path, suffix: str, sync: Sync) -> None:
        """Raises CentralError if the folder can't be written."""
        self.folder = folder
        self.sync = sync
        self._suffix = suffix
        self._pending: list[bytes] = []
        self._pending_bytes = 0
        self._file = -1
        self.size = 0  #: bytes of the newest segment
        #: Guards the files that both threads use; held only briefly.
        self._lock = threading.Lock()
        #: Lets one thread sync at a time; ``write`` never waits for it.
        self._sync_lock = threading.Lock()
        self._stop_requested = threading.Event()
        self._has_unsynced = False  #: whether bytes were written since the last sync
        self._is_named = False  #: whether the folder on the disk has the newest segment's name
        #: Files of earlier segments, to be synced and closed.
        self._full_files: list[int] = []
        self._error: OSError | None = None  #: the first failure; nothing is written after it
        self._thread = threading.Thread(
            target=self._sync_each_second, name=f"sync {suffix}", daemon=True
        )
        try:
            #: The number of the newest segment.
            self.newest = max(numbers(folder, suffix), default=0)
            self.first = self.newest + 1  #: the number of this run's first segment
            self.open_segment()
        except OSError as error:
            raise disk_error(error, f"journal {folder}") from None
        if sync is Sync.BATCH:
            self._thread.start()

    def check(self) -> None:
        """Raise CentralError if writes would be lost because the file was removed."""
        if self._error is None and not os.fstat(self._file).st_nlink:
            self._error = FileNotFoundError(errno.ENOENT, "it was removed")
            raise self._central_error(self._error)

    @property
    def is_broken(self) -> bool:
        """Whether nothing more can be written."""
        return self._error is not None

    def head(self) -> bytes:
        """Return the first record of the next segment."""
        raise NotImplementedError

    def add_record(self, record: bytes) -> None:
        """Append a record; ``flush`` writes it."""
        self._pending.append(record)
        self._pending_bytes += len(record)

    def flush(self) -> None:
        """End a turn: write its records, as safely as ``sync`` demands before messages may leave.

        Raises CentralError if that fails, or if an earlier write or sync has failed.
        """
        # A first error is final: the kernel discards data that it can't sync, and the next sync
        # would succeed without that data.
        if self._error is not None:
            raise self._central_error(self._error)
        if not self._pending or (self.sync is Sync.NONE and self._pending_bytes < WRITE_LATER):
            return
        self._run_steps(self.write)
        if self.sync is Sync.ALWAYS:
            self._run_steps(self._fsync)
        if self.size > self.longest:
            self._run_steps(self.open_segment)

    def discard(self) -> None:
        """Discard the records that wait to be written."""
        self._pending.clear()
        self._pending_bytes = 0

    def make_safe(self) -> None:
        """Bring everything to the disk, whatever ``sync`` says. Raises CentralError."""
        self._run_steps(self.write, self._fsync)

    def write_now(self) -> Path:
        """Pass all records to the kernel, whatever ``sync`` says. Return the newest segment's file.

        Raises CentralError.
        """
        self._run_steps(self.write)
        return self._path

    def start_segment(self) -> None:
        """Start another segment. Raises CentralError."""
        self._run_steps(self.write, self.open_segment)

    def _run_steps(self, *steps: Callable[[], None]) -> None:
        """Call these functions. Raises CentralError if one fails; nothing is written after that."""
        try:
            for step in steps:
                step()
        except OSError as error:
            self._error = error
            raise self._central_error(error) from None

    def close(self) -> None:
        """Write and sync all records, and close the file, unless it is closed.

        Raises CentralError.
        """
        if self._file < 0:
            return
        self._stop_requested.set()
        if self._thread.is_alive():
            self._thread.join()
        try:
            if self._error is None:
                self.write()
                self._fsync()
        except OSError as error:
            raise self._central_error(error) from None
        finally:
            self._close_full()
            os.close(self._file)
            self._file = -1

    def write(self) -> None:
        """Pass all waiting records to the kernel. Raises OSError."""
        data = memoryview(b"".join(self._pending))
        self._pending.clear()
        self._pending_bytes = 0
        while data:
            written = os.write(self._file, data)
            self.size += written
            data = data[written:]
        self._has_unsynced = True

    def open_segment(self) -> None:
        """Create the next segment's file. Raises OSError."""
        with self._lock:
            if self._file >= 0:
                self._full_files.append(self._file)
            self.newest += 1
            self.size = 0
            self._path = self.folder / f"{self.newest:08d}{self._suffix}"
            self._file = os.open(
                self._path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o600
            )
            self._is_named = False
            # The lock shows readers that central runs. Some file systems have no locks.
            with contextlib.suppress(OSError):
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if self.sync is not Sync.BATCH:
            self._close_full()
        self._pending.insert(0, self.head())
        self.write()
        if self.sync is Sync.ALWAYS:
            self._fsync()

    def _sync_each_second(self) -> None:
        while not self._stop_requested.wait(SYNC_PERIOD):
            if self._has_unsynced:
                self._has_unsynced = False
                try:
                    self._fsync()
                except OSError as error:
                    self._error = error
                    return

    def _central_error(self, error: OSError) -> CentralError:
        """Return the error with which central stops."""
        return disk_error(
            error,
            f"journal {self.folder}",
            "central stops, since it must not act without recording it",
        )

    def _fsync(self) -> None:
        """Sync all files of the log, and the names of new ones. Raises OSError."""
        with self._sync_lock:
            self._close_full()
            with self._lock:
                file, is_named = self._file, self._is_named
                self._is_named = True
            _sync_data(file)
            if not is_named:
                sync_path(self.folder)
                sync_path(self.folder.parent)  # the folder may be new

    def _close_full(self) -> None:
        """Sync and close the files of earlier segments. Raises OSError."""
        while self._full_files:
            with self._lock:
                file = self._full_files.pop(0)
            try:
                if self.sync is not Sync.NONE:
                    _sync_data(file)
            finally:
                os.close(file)


def _sync_data(file: int) -> None:
    os.fdatasync(file) if hasattr(os, "fdatasync") else os.fsync(file)
