"""Writes the journal: entries to segment files. Knows files and the disk; nothing of what the entries mean.

Three ways of keeping it safe (``Sync``). The routing loop writes once per turn, for all entries of the turn, before
anything that they justify is sent; under ``batch`` another thread asks the disk once a second.
"""

import contextlib
import fcntl
import os
import threading
import time
from enum import StrEnum
from pathlib import Path

from tca_central.errors import CentralError
from tca_wire.journal.facts import JOURNAL_VERSION, Closed, Entry, Opened
from tca_wire.journal.records import SEGMENT_SUFFIX, record

SEGMENT_BYTES = 64 << 20
SYNC_PERIOD = 1.0
WRITE_LATER = 256 << 10
"""Under ``none``: bytes that may wait in memory."""


class Sync(StrEnum):
    """The time at which entries are safe, and from which failures."""

    ALWAYS = "always"  # on the disk before anything they justify leaves: survives a power cut
    BATCH = "batch"  # with the kernel before, on the disk within a second: survives any death of central
    NONE = "none"  # when convenient


class JournalWriter:
    """One journal: a folder with segments 00000001.tcaj, 00000002.tcaj, ... Where earlier runs lie in the folder, as
    after a crash of central, its segments have the next numbers; nothing is written to theirs.
    """

    def __init__(self, folder: Path, *, epoch: str, version: str, sync: Sync = Sync.BATCH) -> None:
        self.folder = folder
        self.sync = sync
        self._epoch, self._version, self._began = epoch, version, time.time()
        self._pending: list[bytes] = []
        self._pending_bytes = 0
        self._segment = 0
        self.before = 0  #: the last number of an earlier run's segments
        self._size = 0
        self._file = -1
        self._folder = -1
        self._lock = threading.Lock()
        self._stopped = threading.Event()
        self._unsynced = False
        self._error: OSError | None = None  #: of the thread that syncs
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._lock_folder()
            numbers = [int(path.stem) for path in folder.glob(f"*{SEGMENT_SUFFIX}") if path.stem.isdecimal()]
            self.before = max(numbers, default=0)
            self._next_segment(Entry(0, 0.0, []))
        except OSError as error:
            msg = f"journal {folder}: {error.strerror}: name a folder that can be written with --journal"
            raise CentralError(msg) from None
        self._thread = threading.Thread(target=self._sync_each_second, name="journal", daemon=True)
        if sync is Sync.BATCH:
            self._thread.start()

    def _lock_folder(self) -> None:
        """Two centrals that run would mix their segments. A lock ends with its process, however that ends."""
        self._folder = os.open(self.folder, os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(self._folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            msg = f"{self.folder}: another central writes its journal there: name another folder with --journal"
            raise CentralError(msg) from None
        except OSError:  # some file systems have no locks
            pass

    def add(self, entry: Entry) -> None:
        """Take an entry; ``flush`` writes it."""
        encoded = record(entry)
        self._pending.append(encoded)
        self._pending_bytes += len(encoded)
        if self._size + self._pending_bytes > SEGMENT_BYTES:
            self._write()
            self._next_segment(entry)

    def flush(self) -> None:
        """End a turn: what must be safe before the turn's messages leave is safe when this returns.

        Raises CentralError if the journal can't be written, or if what was written may not be on the disk.
        """
        if self._error is not None:  # after a failed sync the data is gone, and a second sync would say all is well
            raise self._broken(self._error)
        if not self._pending or (self.sync is Sync.NONE and self._pending_bytes < WRITE_LATER):
            return
        self._write()
        if self.sync is Sync.ALWAYS:
            try:
                self._fsync()
            except OSError as error:
                raise self._broken(error) from None

    def close(self, entry_number: int, time_now: float, why: str) -> None:
        """Write the rest and the end."""
        self.add(Entry(entry_number, time_now, [Closed(why)]))
        self._write()
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        self._fsync()
        os.close(self._file)
        os.close(self._folder)

    def _write(self) -> None:
        data = memoryview(b"".join(self._pending))
        self._pending.clear()
        self._pending_bytes = 0
        try:
            while data:
                written = os.write(self._file, data)
                self._size += written
                data = data[written:]
        except OSError as error:
            raise self._broken(error) from None
        self._unsynced = True

    def _next_segment(self, entry: Entry) -> None:
        """Begin another segment file; each says which journal it belongs to."""
        with self._lock:
            if self._file >= 0:
                os.fsync(self._file)
                os.close(self._file)
            self._segment += 1
            self._size = 0
            path = self.folder / f"{self.before + self._segment:08d}{SEGMENT_SUFFIX}"
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o600)
            with contextlib.suppress(OSError):  # readers see by it that central lives; some file systems have no locks
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        opened = Opened(JOURNAL_VERSION, self._epoch, self._segment, self._began, self._version)
        self._pending.append(record(Entry(entry.number, entry.time, [opened])))
        self._write()

    def _sync_each_second(self) -> None:
        while not self._stopped.wait(SYNC_PERIOD):
            if self._unsynced:
                self._unsynced = False
                try:
                    self._fsync()
                except OSError as error:
                    self._error = error
                    return

    def _broken(self, error: OSError) -> CentralError:
        msg = f"journal {self.folder}: {error.strerror}: central stops, for what it can't record it must not do"
        return CentralError(msg)

    def _fsync(self) -> None:
        with self._lock:
            os.fdatasync(self._file) if hasattr(os, "fdatasync") else os.fsync(self._file)
