"""The folder of a journal on a disk that fails. Written bytes survive a kill; synced bytes survive
a power cut.

The files are real, and the daemon's own code writes, shortens and removes them. ``os.write`` and
``os.fsync`` are replaced. The replacements record the safe bytes, let the process crash before and
after each step, and limit the room.
"""

import contextlib
import errno
import os
import random
import shutil
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Self

from tca_central.shell import input_log, log_writer

_MEMORY = Path("/dev/shm")
_NEVER = 1e9


class Disk:
    """A folder on a failing disk, as a context manager."""

    def __init__(self, dice: random.Random, fault: Callable[[], None] = lambda: None) -> None:
        self.dice, self.fault = dice, fault
        self.room: int | None = None  #: bytes that can be written (None: any number)
        self.writes = self.boots = 0
        self._safe: dict[int, bytearray] = {}  #: content of each file at its last sync
        self._names: dict[str, int] = {}  #: files of the folder at its last sync

    def __enter__(self) -> Self:
        self._place = Path(mkdtemp(dir=_MEMORY if _MEMORY.is_dir() else None))
        self.folder = self._place / "journal"
        self._prefix = str(self.folder)
        self._boot = self._place / "boot"
        self._boot.write_text("0")
        self._own = os.write, os.fsync, os.fdatasync, input_log.BOOT, log_writer.SYNC_PERIOD
        os.write, os.fsync, os.fdatasync = self._write, self._sync, self._sync  # type: ignore[assignment]
        # With these values, no thread of the daemon syncs on its own.
        input_log.BOOT, log_writer.SYNC_PERIOD = self._boot, _NEVER
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        os.write, os.fsync, os.fdatasync, input_log.BOOT, log_writer.SYNC_PERIOD = self._own
        shutil.rmtree(self._place)

    # --- replaced functions -----------------------------------------------------------------------

    def _write(self, file: int, data: Any) -> int:
        if not self._has(file):
            return self._own[0](file, data)
        self.writes += 1
        try:
            self.fault()
        except BaseException:
            if self.dice.random() < 0.5:
                self._own[0](file, data[: self.dice.randint(0, len(data))])
            raise
        if self.room is not None:
            data = data[: self.room]
            self.room -= len(data)
            if not data:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self._own[0](file, data)
        self.fault()
        return written

    def _sync(self, file: int) -> None:
        if not self._has(file):
            self._own[1](file)
            return
        self.fault()
        self._record_safe_bytes(file)
        self.fault()

    def _has(self, file: int) -> bool:
        return os.readlink(f"/proc/self/fd/{file}").startswith(self._prefix)  # noqa: PTH115 - a path costs more than all

    def _record_safe_bytes(self, file: int) -> None:
        about = os.fstat(file)
        if stat.S_ISDIR(about.st_mode):
            self._names = self._there()
            return
        known = self._safe.setdefault(about.st_ino, bytearray())
        if len(known) < about.st_size:
            again = os.open(f"/proc/self/fd/{file}", os.O_RDONLY)
            known += os.pread(again, about.st_size - len(known), len(known))
            os.close(again)
        del known[about.st_size :]

    def _there(self) -> dict[str, int]:
        return {entry.name: entry.inode() for entry in os.scandir(self.folder)}

    # --- faults -----------------------------------------------------------------------------------

    def sync(self) -> None:
        """Sync all files and the folder."""
        for name in [*self._there(), "."]:
            file = os.open(f"{self._prefix}/{name}", os.O_RDONLY)
            self._record_safe_bytes(file)
            os.close(file)

    def kill(self) -> None:
        """End the process: close its files and end its threads."""
        for thread in threading.enumerate():
            target = getattr(thread, "_target", None)  # None after the thread's end
            if target is not None and thread.name.startswith("sync ."):
                target.__self__._stop_requested.set()
        for name in os.listdir("/proc/self/fd"):  # noqa: PTH208
            with contextlib.suppress(FileNotFoundError):  # the listing's own descriptor
                if self._has(int(name)):
                    os.close(int(name))

    def cut_power(self) -> None:
        """Lose a random part of the unsynced bytes, perhaps with zeros in their place. A new name
        may be lost. A shortened or removed file may return.
        """
        self.boots += 1
        self._boot.write_text(str(self.boots))
        there = self._there()
        for name in sorted(there.keys() | self._names.keys()):
            path, now, before = self.folder / name, there.get(name), self._names.get(name)
            after = now if now == before or self.dice.random() < 0.5 else before
            content = self._left_of(path, after, is_there=after == now)
            path.unlink(missing_ok=True)
            if after is not None:
                path.write_bytes(content)
        self._safe.clear()
        self.sync()

    def _left_of(self, path: Path, file: int | None, *, is_there: bool) -> bytes:
        safe = bytes(self._safe.get(file or 0, b""))
        now = path.read_bytes() if is_there and path.exists() else safe
        if not now.startswith(safe):
            return safe if self.dice.random() < 0.5 else now  # the file was shortened
        zeros = self.dice.choice((0, 0, 0, self.dice.randint(0, 40), self.dice.randint(0, 10_000)))
        return now[: self.dice.randint(len(safe), len(now))] + bytes(
            zeros if len(safe) < len(now) else 0
        )
