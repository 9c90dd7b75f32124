"""Opens the segments of received bodies."""

import fcntl
import mmap
import os
from weakref import WeakSet

from tca_wire.errors import ProtocolError
from tca_wire.messages.large_data import OpenedBody
from tca_wire.packets.large import unpack_handle
from tca_wire.vocabulary import Limit

_POPULATE = getattr(mmap, "MAP_POPULATE", 0)  # one call is cheaper than a fault for each page
_COPIED = 512 << 10  # bytes; to copy so few takes less time than to map them
_MOST_MAPPED = 64  # each has a descriptor, and keeps its sender from using the memory again
_mapped: "WeakSet[mmap.mmap]" = WeakSet()  #: mappings with living views
_FAR = (
    "its {size} bytes stand in shared memory, which this module does not share with central; a"
    f" message to it holds at most {Limit.BODY:d}"
)
_GONE = (
    "the data are gone from shared memory: their task has ended, the memory was full,"
    " or central's computer was restarted or replaced since they were sent"
)


def opened(store: str, body: bytes) -> bytes:
    """Return a large body with the memory of its segment in the folder *store*.

    If the segment can't be read, the body says why when it is decoded.
    """
    try:
        handle, _ = unpack_handle(body)
    except ProtocolError:
        return body  # a decoder reports the damage
    if not handle.segment:
        return body
    found = OpenedBody(body)
    found.handle = handle
    try:
        if store:
            found.content = _memory_of(f"{store}/{handle.segment}", handle.size)
        else:
            is_far = len(body) + handle.size > Limit.BODY  # else central would have sent them
            found.problem = _FAR.format(size=handle.size) if is_far else _GONE
    except FileNotFoundError:
        found.problem = _GONE
    except OSError as error:
        found.problem = f"its data can't be read: {error}"
    return found


def _memory_of(path: str, size: int) -> memoryview:
    """Return the memory of a segment.

    Raises FileNotFoundError if the segment is gone, or another OSError.
    """
    try:
        return _locked_memory_of(path, size)
    except FileNotFoundError:
        # Central has freed it, and its sender has not used it again.
        return _locked_memory_of(f"{path}.free", size)


def _locked_memory_of(path: str, size: int) -> memoryview:
    """Map a segment, and lock it as long as its memory is in use; or copy it."""
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:  # its sender is about to write other data
            raise FileNotFoundError(path) from None
        status = os.fstat(file)
        if os.stat(path, follow_symlinks=False).st_ino != status.st_ino:
            raise FileNotFoundError(path)
        if status.st_size < size:
            msg = f"{path} has {status.st_size} bytes, not {size}"
            raise OSError(msg)
        if size <= _COPIED or len(_mapped) >= _MOST_MAPPED:
            return memoryview(os.pread(file, size, 0))
        # The mapping duplicates the file's descriptor, which keeps the lock.
        memory = mmap.mmap(file, size, flags=mmap.MAP_SHARED | _POPULATE, prot=mmap.PROT_READ)
        _mapped.add(memory)
        return memoryview(memory)
    finally:
        os.close(file)
