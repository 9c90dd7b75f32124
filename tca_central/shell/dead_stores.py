"""The folders that dead centrals have left in the shared memory.

Another central of the same user frees their memory. If a run can continue, it first copies the
segments that the run's central held to the run's folder, where that central restores them from.
"""

import contextlib
import errno
import fcntl
import logging
import os
import shutil
import stat
import threading
from pathlib import Path

from tca_central.shell.kept_data import copy
from tca_wire.packets.large import HELD_FOLDER

log = logging.getLogger("tca.central")

KEY = "key"
"""The file that holds the epoch. A module that can read it shares memory with central.

Modules lock it, so that no other central removes the folder while this one is away.
"""

JOURNAL = "journal"
"""The file that holds the path of the run's folder on the disk, if the run can continue."""


class DeadStores:
    """Removes the folders of the user's centrals that neither run nor have modules left.

    Args:
        root: The folder of the computer's shared memory.
        own: The folder of this central.
        journal: The folder of this central's journal, in which no other run can continue.
    """

    def __init__(self, root: Path, own: Path, journal: Path | None) -> None:
        self._root, self._own, self._journal = root, own, journal
        self._failed: set[Path] = set()  #: folders whose data could not be saved
        self._thread: threading.Thread | None = None

    def remove(self) -> None:
        """Remove the folders soon, in a thread: much data may have to be copied to the disk."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._run, name="dead stores", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        for folder in self._root.glob(f"tca-{os.getuid()}-*"):
            if folder == self._own:
                continue
            with contextlib.suppress(OSError), contextlib.ExitStack() as opened:
                files = [open_folder(folder)]
                opened.callback(os.close, files[0])
                with contextlib.suppress(FileNotFoundError):
                    files.append(os.open(folder / KEY, os.O_RDONLY | os.O_CLOEXEC))
                    opened.callback(os.close, files[1])
                for file in files:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if self._save(folder):
                    shutil.rmtree(folder, ignore_errors=True)

    def _save(self, folder: Path) -> bool:
        """Copy the held segments to the folder of their run. Return False if that fails."""
        try:
            journal = _journal_of(folder)
            if journal is not None and journal != self._journal:
                _copy_held(folder, journal)
        except OSError as error:
            if folder not in self._failed:
                self._failed.add(folder)
                log.warning("%s stays: its data can't be saved for their run: %s", folder, error)
            return False
        return True


def open_folder(folder: Path) -> int:
    """Open a folder that only this user may use. Raises OSError."""
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    found = os.fstat(opened)
    if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        os.close(opened)
        msg = f"{folder} belongs to another user"
        raise PermissionError(msg)
    return opened


def _journal_of(folder: Path) -> Path | None:
    """Return the journal's folder of a run that can continue, if it still exists.

    Raises OSError.
    """
    with contextlib.suppress(FileNotFoundError):
        path = Path(os.fsdecode((folder / JOURNAL).read_bytes()))
        if path.is_absolute() and path.is_dir():
            return path
    return None


def _copy_held(folder: Path, journal: Path) -> None:
    """Copy the segments that a central held. Raises OSError."""
    epoch = folder.name.split("-", 2)[2]
    target = journal / HELD_FOLDER / epoch
    missing = [
        path
        for path in folder.glob("*/*")
        if path.name.isdecimal() and not (target / path.parent.name / path.name).exists()
    ]
    sizes = {path: path.stat().st_size for path in missing}
    if missing and 2 * sum(sizes.values()) > shutil.disk_usage(journal).free:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), f"{journal}")
    for path, size in sizes.items():
        name = f"{path.parent.name}/{path.name}"
        (target / name).parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        copy(path, target / name, size, sync=True)
