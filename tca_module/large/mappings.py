"""The segments that this process reads: their memory, and the locks on their files.

To map a file costs more than to copy 100 KiB. So a few mappings stay, for the next data that a
sender writes to the same file. Only numpy's arrays tell when the last view of a mapping has ended,
so without numpy each mapping is used once.
"""

import contextlib
import fcntl
import mmap
import os
import sys
import threading
import time
from typing import Any
from weakref import ref

_POPULATE = getattr(mmap, "MAP_POPULATE", 0)  # one call is cheaper than a fault for each page
_MOST, _MOST_BYTES = 8, 64 << 20  # of mappings that stay
_TIDY_AFTER = 1.0  # seconds


class _Mapping:
    """A mapped file. It is locked as long as a view of it lives."""

    def __init__(self, file: int, memory: mmap.mmap, inode: int) -> None:
        self.memory = memory
        self.inode = inode
        self._file = file
        self._views: dict[int, ref[Any]] = {}  #: by their ids, because arrays have no hash

    def view(self, path: str, size: int) -> memoryview:
        """Return the first *size* bytes, which are those of the segment *path*.

        Raises FileNotFoundError if the file has that name no longer.
        """
        array: Any = sys.modules["numpy"].frombuffer(self.memory, "u1", size)
        with _lock:
            view = ref(array, self._end_view)
            self._views[id(view)] = view
            _lock_to_read(self._file, path)
        if os.stat(path, follow_symlinks=False).st_ino != self.inode:
            raise FileNotFoundError(path)
        return memoryview(array)

    def _end_view(self, view: "ref[Any]") -> None:
        """Unlock the file after its last view. Any thread calls this, perhaps within ``view``."""
        with _lock:
            self._views.pop(id(view), None)
            if not self._views and self._file >= 0:
                fcntl.flock(self._file, fcntl.LOCK_UN)

    @property
    def is_used(self) -> bool:
        """Whether a view lives."""
        return bool(self._views)

    @property
    def is_removed(self) -> bool:
        """Whether the file has no name any more."""
        return not os.fstat(self._file).st_nlink

    def close(self) -> None:
        """Close the file. Its memory lasts as long as a view."""
        os.close(self._file)
        self._file = -1


_lock = threading.RLock()  # a view may end while its thread has the lock
_mappings: dict[int, _Mapping] = {}  #: by inode, the one that was used last at the end
_tidy_at = 0.0


def memory_of(path: str, size: int) -> memoryview:
    """Map a segment, and lock it as long as its memory is in use.

    Raises FileNotFoundError if the segment is gone, or another OSError.
    """
    with _lock:
        found = _mappings.pop(os.stat(path, follow_symlinks=False).st_ino, None)
        if found is not None:
            _mappings[found.inode] = found
    if found is not None and size <= len(found.memory):
        return found.view(path, size)
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        _lock_to_read(file, path)
        status = os.fstat(file)
        if os.stat(path, follow_symlinks=False).st_ino != status.st_ino:
            raise FileNotFoundError(path)
        if status.st_size < size:
            msg = f"{path} has {status.st_size} bytes, not {size}"
            raise OSError(msg)
        # The mapping duplicates the file's descriptor, which keeps the lock.
        memory = mmap.mmap(
            file, status.st_size, flags=mmap.MAP_SHARED | _POPULATE, prot=mmap.PROT_READ
        )
        mapping = _Mapping(file, memory, status.st_ino)
        if "numpy" in sys.modules and _add(mapping):
            file = -1
            return mapping.view(path, size)
        return memoryview(memory)[:size]
    finally:
        if file >= 0:
            os.close(file)


def _lock_to_read(file: int, path: str) -> None:
    """Lock a file. Raises FileNotFoundError if its sender is about to write other data."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        raise FileNotFoundError(path) from None


def _add(mapping: _Mapping) -> bool:
    """Keep a mapping for later. Return False if too many others are in use."""
    with _lock:
        others = list(_mappings.values())
        number, size = len(others), sum(len(one.memory) for one in others)
        for other in others:
            if number < _MOST and size + len(mapping.memory) <= _MOST_BYTES:
                break
            if not other.is_used:
                _mappings.pop(other.inode).close()
                number, size = number - 1, size - len(other.memory)
        else:
            if number >= _MOST or size + len(mapping.memory) > _MOST_BYTES:
                return False
        return _mappings.setdefault(mapping.inode, mapping) is mapping


def tidy() -> None:
    """Free the memory of files that were removed. Does so once a second at most."""
    global _tidy_at  # noqa: PLW0603
    if not _mappings or (now := time.monotonic()) < _tidy_at:
        return
    with _lock:
        _tidy_at = now + _TIDY_AFTER
        for one in list(_mappings.values()):
            if not one.is_used and one.is_removed:
                _mappings.pop(one.inode).close()


def _forget_mappings() -> None:
    """Leave the parent's locks alone in a forked child."""
    global _lock  # noqa: PLW0603
    _lock = threading.RLock()
    for one in _mappings.values():
        with contextlib.suppress(OSError):
            one.close()
    _mappings.clear()


os.register_at_fork(after_in_child=_forget_mappings)
