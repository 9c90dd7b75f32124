"""A segment that this process writes: a file in shared memory. Its name says its state.

``7.new`` is on its way to central, ``7`` is held by central, ``7.free`` is free. Decision 125 has
the rules. Central renames the first two, the sender the last.
"""

import contextlib
import fcntl
import mmap
import os

NEW, FREE = ".new", ".free"

_POPULATE = getattr(mmap, "MAP_POPULATE", 0)  # one call is cheaper than a fault for each page


class Segment:
    """A file of shared memory that this process can write again and again.

    The file stays when the object ends: its state decides about it.
    """

    def __init__(self, folder: str, number: int, size: int) -> None:
        """Create the file. Raises OSError, for example if there is no space."""
        self.number = number
        self.capacity = _rounded(size)
        self._folder = folder
        self._file = os.open(
            self.path(NEW), os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600
        )
        try:
            # Without this, a full memory would end the process when it writes.
            os.posix_fallocate(self._file, 0, self.capacity)
            flags = mmap.MAP_SHARED | _POPULATE
            self.memory = memoryview(mmap.mmap(self._file, self.capacity, flags=flags))
            self._inode = os.fstat(self._file).st_ino
        except BaseException:
            self.remove(NEW)
            raise

    def __del__(self) -> None:
        if hasattr(self, "_file"):
            os.close(self._file)

    def path(self, state: str) -> str:
        """Return the name of the file in a state."""
        return f"{self._folder}/{self.number}{state}"

    def renew(self, number: int) -> bool:
        """Give the segment a new number, if central has freed it. Return whether it has.

        Raises OSError if the segment can't be written again, and removes it. A receiver may still
        read it, whose view lasts. Or central has restored the file from the disk: it is not the one
        that is mapped here.
        """
        new = f"{self._folder}/{number}{NEW}"
        try:
            os.rename(self.path(FREE), new)
        except FileNotFoundError:
            return False
        self.number = number
        try:
            if os.stat(new).st_ino != self._inode:
                raise FileNotFoundError(new)
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.remove(NEW)
            raise
        fcntl.flock(self._file, fcntl.LOCK_UN)
        return True

    def remove(self, state: str) -> None:
        """Remove the file, if it is in this state."""
        with contextlib.suppress(OSError):
            os.unlink(self.path(state))


def _rounded(size: int) -> int:
    """Return a size with some room, so that data of changing sizes find a segment to reuse."""
    step = max(mmap.PAGESIZE, 1 << max(0, size.bit_length() - 4))
    return -(-size // step) * step
