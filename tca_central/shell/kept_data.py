"""Copies segments of shared memory to the disk, in a thread of its own.

Beside the journal, ``data/EPOCH`` has the segments of messages with ``journal=True``, as long as
the journal. ``held/EPOCH`` has those of goals, commands and variables, until central releases them:
they are restored from there if they are missing in the memory.
"""

import contextlib
import logging
import os
import shutil
import threading
from collections import deque
from collections.abc import Container
from pathlib import Path
from typing import NamedTuple

from tca_central.errors import disk_error
from tca_central.shell.log_limit import LogLimit
from tca_central.shell.log_writer import Sync, sync_path
from tca_wire.packets.large import DATA_FOLDER, HELD_FOLDER, Keep

log = logging.getLogger("tca.central")

MOST_PENDING = 256 << 20
"""Bytes that may wait for the disk. Beyond them, messages with ``journal=True`` lose their data."""


class Copy(NamedTuple):
    """A copy to make."""

    name: str
    path: Path  #: the segment
    size: int
    keep: Keep


class KeptData:
    """The copies of one run.

    Args:
        folder: The folder of the journal.
        epoch: The run.
        sync: When copies must be on the disk: with ``always``, those of tasks are there before the
            messages of the same turn leave.
        keeps_tasks: Whether the run can continue, so that segments of tasks are copied, too.
    """

    def __init__(self, folder: Path, epoch: str, sync: Sync, *, keeps_tasks: bool = True) -> None:
        self.folder, self.keeps_tasks = folder.absolute(), keeps_tasks
        #: Whether the segments of tasks must be on the disk at once.
        self.is_prompt = sync is Sync.ALWAYS
        self._data, self._tasks = folder / DATA_FOLDER / epoch, folder / HELD_FOLDER / epoch
        self._sync = sync
        self.ended: list[str] = []  #: names of segments that were copied, or need no copy
        #: Names of segments whose copies failed, and may be tried again.
        self.failed: list[str] = []
        self.held: set[str] = set()  #: names of the copies of tasks' segments
        self._changed = threading.Condition()
        self._copies: deque[Copy] = deque()  #: to make, oldest first
        self._busy: Copy | None = None
        self._pending = 0  #: bytes of copies to make
        self._is_closing = False
        self._error: OSError | None = None  #: the last failure to copy a task's segment
        self._warnings = LogLimit(log)
        self._thread: threading.Thread | None = None

    def add(self, name: str, path: Path, size: int, keep: Keep) -> bool:
        """Copy a segment soon. Return False if no copy is made, or too much waits for the disk.

        The segment must stay until its name is in ``ended``.
        """
        if not self.keeps_tasks:
            keep &= ~Keep.TASK
        if not keep or self.has_copy(name, keep):
            return False
        if self._pending + size > MOST_PENDING and not keep & Keep.TASK:
            self._warnings.warning(
                "full",
                "the journal lacks large data: %d bytes wait for the disk",
                self._pending,
            )
            return False
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="kept data", daemon=True)
            self._thread.start()
        with self._changed:
            self._pending += size
            self._copies.append(Copy(name, path, size, keep))
            self._changed.notify_all()
        return True

    def has_copy(self, name: str, keep: Keep) -> bool:
        """Whether a segment needs no other copy."""
        return (self._folder_of(keep) / name).exists()

    def _folder_of(self, keep: Keep) -> Path:
        return self._data if keep & Keep.JOURNAL else self._tasks

    def flush(self) -> None:
        """With ``always``, wait until tasks' segments are on the disk. Raises CentralError."""
        if not self.is_prompt or not self._pending:
            return
        with self._changed:
            self._changed.wait_for(lambda: not self._has_task)
        if (error := self._error) is not None:
            self._error = None
            raise disk_error(
                error, f"{self._tasks}", "central stops, since it must not lose the data of tasks"
            )

    @property
    def _has_task(self) -> bool:
        copies = (*self._copies, *([self._busy] if self._busy is not None else []))
        return any(one.keep & Keep.TASK for one in copies)

    def release(self, name: str) -> None:
        """Remove the copy of a task's segment, if there is one."""
        if name in self.held:
            self.held.discard(name)
            self.remove_copy(name)

    def remove_copy(self, name: str) -> None:
        """Remove the copy of a task's segment."""
        path = self._tasks / name
        with contextlib.suppress(OSError):
            path.unlink()
            path.parent.rmdir()

    def remove_all_but(self, held: Container[str]) -> None:
        """Remove the copies of tasks' segments whose names are not *held*."""
        found = {f"{path.parent.name}/{path.name}" for path in self._tasks.glob("*/*")}
        self.held |= found
        for name in found:
            if name not in held:
                self.release(name)

    def restore(self, name: str, path: Path) -> None:
        """Restore a segment that is missing in the memory, if there is a copy."""
        for folder in (self._tasks, self._data):
            if (source := folder / name).exists():
                try:
                    path.parent.mkdir(exist_ok=True, mode=0o700)
                    copy(source, path, source.stat().st_size)
                except OSError as error:
                    log.warning("%s: the data of a task can't be restored: %s", source, error)
                return

    def close(self, *, is_over: bool) -> None:
        """Make all copies, and end the thread. If the run *is_over*, no task needs a copy."""
        if self._thread is not None:
            with self._changed:
                self._is_closing = True
                if is_over:
                    self._copies = deque(one for one in self._copies if one.keep & Keep.JOURNAL)
                self._changed.notify_all()
            self._thread.join()
        if is_over:
            shutil.rmtree(self._tasks, ignore_errors=True)
            with contextlib.suppress(OSError):
                self._tasks.parent.rmdir()

    # --- the thread -------------------------------------------------------------------------------

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._copies or self._is_closing)
                if not self._copies:
                    return
                self._busy = one = self._copies.popleft()
            self._try(one)
            with self._changed:
                self._busy = None
                self._pending -= one.size
                self.ended.append(one.name)
                self._changed.notify_all()

    def _try(self, one: Copy) -> None:
        """Make a copy, or report that it failed."""
        try:
            self.make(one)
        except OSError as error:
            if one.keep & Keep.TASK and self.is_prompt:
                self._error = error
                return
            self.failed.append(one.name)
            self._warnings.warning(
                "failed", "%s: large data of a message can't be copied: %s", one.path, error
            )

    def make(self, one: Copy) -> None:
        """Copy a segment to the disk. Raises OSError."""
        target = self._folder_of(one.keep) / one.name
        target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        copy(one.path, target, one.size, sync=self._sync is not Sync.NONE)
        if not one.keep & Keep.JOURNAL:
            self.held.add(one.name)


def copy(source: Path, target: Path, size: int, *, sync: bool = False) -> None:
    """Copy *size* bytes of a file completely, or not at all. Raises OSError."""
    draft = target.with_name(f"{target.name}.draft")
    try:
        with source.open("rb") as reading, draft.open("wb") as writing:
            _send(reading.fileno(), writing.fileno(), size)
            if sync:
                os.fsync(writing.fileno())
        draft.rename(target)
    except OSError:
        draft.unlink(missing_ok=True)
        raise
    if sync:
        for folder in (target.parent, target.parent.parent):
            sync_path(folder)


def _send(source: int, target: int, size: int) -> None:
    """Copy the first bytes of an open file to another one. Raises OSError."""
    done = 0
    while done < size:
        sent = os.sendfile(target, source, done, size - done)
        if not sent:
            msg = f"the segment has {done:,} of {size:,} bytes"
            raise OSError(msg)
        done += sent
