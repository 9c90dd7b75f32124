"""The folder of shared memory with large data: its life, and the segments that central holds.

Central holds a segment while a ``StoredBody`` with its name exists. The name of the segment's file
tells its state to senders and to the next central (decision 125). Files are renamed at the end of a
turn, when the log of the turn has been written.
"""

import contextlib
import logging
import math
import os
import re
import shutil
import time
from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path

from tca_central.shell.dead_stores import JOURNAL, KEY, DeadStores, open_folder
from tca_central.shell.kept_data import KeptData
from tca_central.shell.log_writer import lock
from tca_wire.errors import ProtocolError
from tca_wire.packets.large import Handle, Keep, LargeBody, pack_handle, unpack_handle

log = logging.getLogger("tca.central")

ROOT = Path("/dev/shm")  # noqa: S108 - the folder inside is private
_INCARNATION = re.compile(r"[0-9a-f]{1,32}")
OWN = "0"
"""The folder of segments that central itself makes, in place of an incarnation."""

_KEPT = int(Keep.TASK | Keep.JOURNAL)
NEW, FREE = ".new", ".free"

CLEANED_EVERY = 30.0
"""Seconds between two searches for the folders of dead centrals: their modules may end later."""

SAVED_IN = 60.0
"""Seconds to wait for another central that saves the data of this run at present."""

DELAY = 0.5
"""Seconds before the segment of a task is copied: most tasks with large data end sooner."""

TRIED_AGAIN = 5.0
"""Seconds after which a failed copy is tried again: the disk may have been full."""

ORPHANED = 30.0
"""Seconds after a restart for which segments stay that no message of the state refers to.

A module repeats the request that brought a segment, if the crash lost it.
"""


class StoredBody(LargeBody):
    """A large body of central. Its end is reported to the store."""

    name = ""  #: the name of its segment
    ended: list[str]  #: gets the name at the end

    def __del__(self) -> None:
        """Report the end. The store works on it later: this may happen anywhere, in any thread."""
        self.ended.append(self.name)


@dataclass(slots=True)
class _Held:
    """A segment that central holds."""

    size: int
    keep: int = 0  #: the flags of all its bodies
    bodies: int = 0  #: the number of bodies with its name, and of copies to the disk in progress


class Store:
    """The segments of one run.

    It has no folder until ``open``, and if memory can't be shared.

    Args:
        root: The folder of the computer's shared memory.
    """

    def __init__(self, root: Path | None = None) -> None:
        self._root = root or ROOT
        self.folder: Path | None = None
        self._lock = -1
        self._is_locked = True  #: whether this central has the lock of the open folder
        self._held: dict[str, _Held] = {}  #: by name
        self._ended: list[str] = []  #: names of bodies that have ended
        #: Incarnations that share memory: each has a folder, which tells the next central.
        self._sharing: set[str] = set()
        self._orphans: dict[str, float] = {}  #: by name: when to release it
        self._due: dict[str, float] = {}  #: by name: when to copy it to the disk, if it is held
        self._dead: DeadStores | None = None
        self._next_cleaning = 0.0  #: when to search for the folders of dead centrals again
        self._made = 0  #: the number of the newest segment of central itself
        self._kept: KeptData | None = None

    # --- the folder -------------------------------------------------------------------------------

    def open(
        self, epoch: str, kept: KeptData | None = None, *, succeeds_living: bool = False
    ) -> None:
        """Create the folder of a run, or continue with it. Remove the folders of dead centrals.

        Args:
            epoch: The run.
            kept: Copies segments to the disk; None: nothing is copied.
            succeeds_living: Whether the central before may still live, and have the lock. It
                changes nothing any more.
        """
        folder = self._root / f"tca-{os.getuid()}-{epoch}"
        try:
            self._lock, self._is_locked = _locked_folder(folder, is_patient=not succeeds_living)
            (folder / KEY).write_text(epoch)
            if kept is not None and kept.keeps_tasks:
                (folder / JOURNAL).write_bytes(os.fsencode(kept.folder))
            (folder / OWN).mkdir(exist_ok=True, mode=0o700)
        except OSError as error:
            log.info("no shared memory for large data: %s", error)
            self._close_lock()
            return
        self.folder, self._kept = folder, kept
        self._made = time.time_ns() // 1000
        self._dead = DeadStores(self._root, folder, None if kept is None else kept.folder)
        self._reconcile()

    def _reconcile(self) -> None:
        """Adapt the files to a recovered state, which counts as no messages in a new run."""
        self._count_ended()
        if self._kept is not None:
            self._kept.remove_all_but(self._held)
        for name, held in list(self._held.items()):
            self._mark_held(name)
            if self._kept is not None and not self._path(name).exists():
                self._kept.restore(name, self._path(name))
            self._keep(name, held.keep)
        self._sharing.update(self._incarnations())
        due = time.monotonic() + ORPHANED
        for incarnation in self._incarnations():
            for file in _names_in(self._folder / incarnation):
                if file.isdecimal() and (name := f"{incarnation}/{file}") not in self._held:
                    self._orphans[name] = due
                elif incarnation == OWN and file.endswith(NEW):
                    (self._folder / OWN / file).unlink(missing_ok=True)

    def close(self, *, is_over: bool) -> None:
        """Stop. If the run *is_over*, remove the folder; else copy the segments of tasks first."""
        if self._kept is not None:
            if self.folder is not None and not is_over:
                self._copy_due(math.inf)
            self._kept.close(is_over=is_over)
        if self.folder is not None and is_over:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.folder = None
        self._close_lock()

    def _close_lock(self) -> None:
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    @property
    def _folder(self) -> Path:
        assert self.folder is not None
        return self.folder

    def _path(self, name: str) -> Path:
        return self._folder / name

    def _incarnations(self) -> Iterator[str]:
        """Yield the names of the folders of modules, and of central's own."""
        for name in _names_in(self._folder):
            if (self._folder / name).is_dir():
                yield name

    def add_module(self, incarnation: str) -> None:
        """Note that a module shares memory, and make its folder."""
        if self.folder is not None and _INCARNATION.fullmatch(incarnation):
            with contextlib.suppress(OSError):
                (self.folder / incarnation).mkdir(exist_ok=True, mode=0o700)
                self._sharing.add(incarnation)

    def is_shared_with(self, incarnation: str) -> bool:
        """Whether a module shares memory."""
        return incarnation in self._sharing

    # --- segments ---------------------------------------------------------------------------------

    @property
    def held_bytes(self) -> int:
        """The bytes of the segments that central holds."""
        return sum(held.size for held in self._held.values())

    def adopt(self, body: bytes) -> bytes:
        """Return a large body as one that holds its segment. The core gets this one."""
        try:
            handle, _ = unpack_handle(body)
        except ProtocolError:
            return body  # the core refuses it
        if not (name := handle.segment):
            return body
        stored = StoredBody(body)
        stored.name, stored.ended, stored.held = name, self._ended, len(body) + handle.size
        held, wanted = self._held.get(name), handle.keep & _KEPT
        if held is None:
            self._held[name] = held = _Held(handle.size)
            if self.folder is not None:
                self._mark_held(name)
        held.bodies += 1
        missing, held.keep = wanted & ~held.keep, held.keep | wanted
        if missing and self.folder is not None:
            self._keep(name, wanted)
        return stored

    def _mark_held(self, name: str) -> None:
        """Rename a segment that has arrived. It may be held already, or missing.

        It is free if the core dropped this message before: its sender then repeats it, and does not
        write the segment again.
        """
        path = f"{self._folder}/{name}"
        for state in (NEW, FREE):
            try:
                os.rename(path + state, path)  # noqa: PTH104 - three times as fast
            except OSError:
                continue
            return

    def _keep(self, name: str, keep: int) -> None:
        """Copy a segment to the disk, if *keep* says so: now, or when it has been held a while."""
        if self._kept is None or not keep:
            return
        if keep & Keep.JOURNAL or self._kept.is_prompt:
            self._copy(name, keep)
        else:
            self._due[name] = time.monotonic() + DELAY

    def _copy_due(self, now: float) -> None:
        """Copy the segments that are due, and still held. Note which copies to try again."""
        while self._kept is not None and self._kept.failed:
            self._due[self._kept.failed.pop()] = now + TRIED_AGAIN
        for name in [name for name, due in self._due.items() if due <= now]:
            del self._due[name]
            if (held := self._held.get(name)) is not None:
                self._copy(name, held.keep)

    def _copy(self, name: str, keep: int) -> None:
        """Have a segment copied to the disk. The copy counts as a body."""
        path, held = self._path(name), self._held[name]
        if self._kept is not None and path.exists():
            held.bodies += self._kept.add(name, path, held.size, Keep(keep))

    def flush(self) -> None:
        """Bring the segments of tasks to the disk, if they must be there. Raises CentralError."""
        if self._kept is not None:
            self._kept.flush()

    def settle(self, modules: Container[str]) -> None:
        """Release the segments that are needed no more. *modules* are the known incarnations."""
        if not self._ended and (self._kept is None or not self._kept.ended):
            return
        for name in self._count_ended():
            if self.folder is not None:
                if self._kept is not None:
                    self._kept.release(name)
                self._release(name, modules)

    def _count_ended(self) -> list[str]:
        """Count the bodies that have ended. Return the segments that none is left of."""
        released = []
        for ended in (self._ended, [] if self._kept is None else self._kept.ended):
            while ended:
                name = ended.pop()
                held = self._held[name]
                held.bodies -= 1
                if not held.bodies:
                    del self._held[name]
                    released.append(name)
        return released

    def _release(self, name: str, modules: Container[str]) -> None:
        """Give a segment back to its module, or remove it if the module has left."""
        path, incarnation = f"{self._folder}/{name}", name.partition("/")[0]
        try:
            if incarnation in modules and incarnation != OWN:
                os.rename(path, path + FREE)  # noqa: PTH104 - three times as fast
            else:
                Path(path).unlink()
        except OSError:  # the sender named a segment that does not exist
            return

    def sweep(self, modules: Container[str]) -> None:
        """Remove what modules have left behind. Release segments of requests that were lost.

        Copy the segments of tasks that have been held a while to the disk. Called once a second.
        """
        if self.folder is None:
            return
        now = time.monotonic()
        if not self._is_locked:
            self._is_locked = _is_locked_now(self._lock)
        if self._dead is not None and now >= self._next_cleaning:
            self._next_cleaning = now + CLEANED_EVERY
            self._dead.remove()
        self._copy_due(now)
        for name in [name for name, due in self._orphans.items() if due <= now]:
            del self._orphans[name]
            if name not in self._held:
                self._release(name, modules)
        for incarnation in self._incarnations():
            if incarnation not in modules and incarnation != OWN:
                self._sharing.discard(incarnation)
                self._remove_unheld(incarnation)

    def _remove_unheld(self, incarnation: str) -> None:
        """Remove the files of a module that has left, but for held ones; then its folder."""
        folder = self._folder / incarnation
        with contextlib.suppress(OSError):
            for file in _names_in(folder):
                name = f"{incarnation}/{file}"
                if name not in self._held and name not in self._orphans:
                    (folder / file).unlink()
            folder.rmdir()

    # --- the bytes of segments --------------------------------------------------------------------

    def write(self, handle: Handle, data: memoryview) -> bytes:
        """Write the bytes of an inline body to a segment. Return the body with its name.

        Raises OSError.
        """
        self._made += 1
        name = f"{OWN}/{self._made}"
        path = self._path(name + NEW)
        try:
            with path.open("xb") as stream:
                stream.write(data)
        except OSError:
            path.unlink(missing_ok=True)
            raise
        return pack_handle(Handle(name, handle.size, handle.keep, handle.data))

    def read(self, handle: Handle) -> bytes:
        """Return a body with the bytes of its segment. Raises OSError."""
        if self.folder is None:
            raise FileNotFoundError(handle.segment)
        with self._path(handle.segment).open("rb") as stream:
            data = stream.read(handle.size)
        if len(data) < handle.size:
            msg = f"segment {handle.segment} has {len(data)} bytes"
            raise OSError(msg)
        return pack_handle(Handle("", handle.size, handle.keep, handle.data)) + data


def _names_in(folder: Path) -> list[str]:
    """Return the names in a folder. A module or the user may have removed it."""
    try:
        return [path.name for path in folder.iterdir()]
    except OSError:
        return []


def _locked_folder(folder: Path, *, is_patient: bool) -> tuple[int, bool]:
    """Create and lock a private folder. Raises OSError.

    Returns the lock's file, and whether it is locked; always if the call *is_patient*.
    """
    while True:
        folder.mkdir(exist_ok=True, mode=0o700)
        locked = open_folder(folder)
        try:
            if not is_patient:
                return locked, _is_locked_now(locked)
            lock(locked, SAVED_IN)
            if os.fstat(locked).st_nlink and folder.exists():
                return locked, True  # else another central has just removed it as a dead one's
        except OSError:
            os.close(locked)
            raise
        os.close(locked)


def _is_locked_now(file: int) -> bool:
    """Lock a file, unless another process has the lock. Return whether it is locked."""
    try:
        lock(file, 0.0)
    except BlockingIOError:
        return False
    return True
