"""The segments of one run of a module. All connections of the run share them, from any thread.

A segment is written again when central has freed it. A few free segments are kept for that.
"""

import contextlib
import fcntl
import itertools
import os
import threading
from dataclasses import dataclass
from weakref import ref

from tca_module.large.segment import FREE, NEW, Segment
from tca_module.late_calls import late_calls
from tca_wire.messages.large_data import LargeData, OpenedBody

IDLE_SEGMENTS, IDLE_BYTES = 4, 64 << 20  # of free segments that are kept for the next second
_IDLE_SHARE = 8  # ... at most an eighth of the shared memory
_MAPPED = 8  # segments that stay mapped while central holds them; others are used only once
_TIDY_AFTER = 1.0  # seconds
_SMALLEST = 256 << 10  # bytes; a segment of that size may be reused for any smaller data

_numbers = itertools.count(1)


class Lease:
    """The use of a segment by a body of this process. It lasts as long as the body."""

    def __init__(self, pool: "Pool", segment: Segment) -> None:
        self.pool = pool
        self._segment = segment

    @property
    def is_lost(self) -> bool:
        """Whether the file is gone: central counted the module as lost, or the memory was lost."""
        return not any(os.path.exists(self._segment.path(state)) for state in (NEW, "", FREE))


@dataclass(slots=True)
class _Use:
    """The newest use of a segment."""

    lease: ref[Lease]
    user: object
    """The connection that sends it."""
    is_free: bool = False  #: whether ``_look`` has found it free


class Pool:
    """The segments of one run of a module, in a folder of central's store."""

    def __init__(self, store: str, incarnation: str) -> None:
        """Create the folder. Raises OSError."""
        self.users = 0  #: the number of connections
        self.folder = f"{store}/{incarnation}"
        self._incarnation = incarnation
        self._process = os.getpid()
        self._lock = threading.Lock()
        self._uses: dict[int, _Use] = {}  #: by the segment's number, the oldest first
        self._mapped: dict[int, Segment] = {}  #: those of the uses that stay mapped
        self._stores_until_look = 0
        self._has_stored = False  #: whether data were stored since the last ``tidy``
        os.makedirs(self.folder, mode=0o700, exist_ok=True)
        memory = os.statvfs(store)
        self._idle_bytes = min(IDLE_BYTES, memory.f_frsize * memory.f_blocks // _IDLE_SHARE)
        self._key = _locked_key(store)

    def store(self, data: LargeData, user: object) -> OpenedBody:
        """Copy data into a segment; return their body. Raises OSError.

        The segment is not written again as long as the body lives.
        """
        with self._lock:
            segment = self._free_segment(data.size)
        if segment is None:
            segment = self._new_segment(data.size)
        data.write(segment.memory)
        body = OpenedBody(data.body(f"{self._incarnation}/{segment.number}"))
        body.content = segment.memory.toreadonly()[: data.size]
        body.owner = lease = Lease(self, segment)
        with self._lock:
            self._uses[segment.number] = _Use(ref(lease), user)
            if len(self._mapped) < _MAPPED:
                self._mapped[segment.number] = segment
            if not self._has_stored:
                self._has_stored = True
                late_calls().add(self.tidy, _TIDY_AFTER)
        return body

    def _new_segment(self, size: int) -> Segment:
        try:
            return Segment(self.folder, next(_numbers), size)
        except FileNotFoundError:  # central has removed the folder: it counted the module as lost
            with contextlib.suppress(FileExistsError):  # another thread has made it
                os.mkdir(self.folder, 0o700)
        except OSError:
            with self._lock:  # make room
                self._look()
                self._trim(0, 0)
        return Segment(self.folder, next(_numbers), size)

    def _free_segment(self, size: int) -> Segment | None:
        """Return a free segment for data of a size, with a new number."""
        most = max(_SMALLEST, 2 * size)
        for number, segment in list(self._mapped.items()):
            if size <= segment.capacity <= most and self._uses[number].lease() is None:
                try:
                    is_renewed = segment.renew(next(_numbers))
                except OSError:
                    self._forget(number)
                    continue
                if is_renewed:
                    self._forget(number)
                    return segment
        self._stores_until_look -= 1
        if self._stores_until_look < 0:
            self._look()
            # The cost of a look grows with the number of files: look less often if they are many.
            self._stores_until_look = len(self._uses) // 16
        return None

    def _look(self) -> None:
        """Read the states of the segments, and forget those that are gone."""
        try:
            names = set(os.listdir(self.folder)) if self._uses else set()
        except FileNotFoundError:  # central counted the module as lost
            names = set()
        for number, use in list(self._uses.items()):
            if use.lease() is not None:
                continue
            if f"{number}{FREE}" in names:
                use.is_free = True
                if number not in self._mapped:
                    self._remove(number, FREE)
            elif f"{number}{NEW}" not in names and str(number) not in names:
                self._forget(number)  # central has removed it

    def _remove(self, number: int, state: str) -> None:
        """Remove a segment that is in this state. Only central may remove the others."""
        try:
            os.unlink(f"{self.folder}/{number}{state}")
        except FileNotFoundError:
            return
        self._forget(number)

    def _forget(self, number: int) -> None:
        """Forget a segment. Its file is gone, or has another number."""
        self._uses.pop(number, None)
        self._mapped.pop(number, None)

    def _trim(self, most: int, most_bytes: int) -> None:
        """Remove the oldest free segments, until the rest is within these bounds."""
        free = {
            number: segment.capacity
            for number, segment in self._mapped.items()
            if self._uses[number].is_free
        }
        number_left, size = len(free), sum(free.values())
        for number, capacity in free.items():
            if number_left <= most and size <= most_bytes:
                return
            self._remove(number, FREE)
            number_left, size = number_left - 1, size - capacity

    def tidy(self) -> bool:
        """Remove free segments, but for a few if data were stored lately. Return True.

        The thread of late calls calls this each second while the module has segments.
        """
        with self._lock, contextlib.suppress(OSError):
            has_stored, self._has_stored = self._has_stored, False
            self._look()
            self._trim(IDLE_SEGMENTS, self._idle_bytes) if has_stored else self._trim(0, 0)
            if self._uses:
                late_calls().add(self.tidy, _TIDY_AFTER)
        return True

    def take_back(self, user: object) -> None:
        """Remove the segments that a connection has sent before it broke, and central never got.

        Central has welcomed the connection again. A segment with a body is sent again.
        """
        with self._lock:
            for number, use in list(self._uses.items()):
                if use.user is user and use.lease() is None:
                    self._remove(number, NEW)

    def close(self) -> None:
        """Remove the free segments. Central removes the others, which it may still need."""
        if os.getpid() != self._process:
            return
        self.unlock_key()
        with self._lock, contextlib.suppress(OSError):
            self._look()
            for number in list(self._uses):
                self._remove(number, FREE)
            self._uses.clear()
            self._mapped.clear()
            os.rmdir(self.folder)  # fails if segments are left

    def unlock_key(self) -> None:
        """Let any central remove the store, if its own central is away."""
        key, self._key = self._key, -1
        if key >= 0:
            os.close(key)


def _locked_key(store: str) -> int:
    """Lock the store's key, so that no other central removes the store while its own is away.

    Returns the open file; -1 if the store has no key.
    """
    try:
        key = os.open(f"{store}/key", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return -1
    with contextlib.suppress(OSError):  # a central removes the store now
        fcntl.flock(key, fcntl.LOCK_SH | fcntl.LOCK_NB)
    return key


_pools: dict[tuple[str, str], Pool] = {}
_pools_lock = threading.Lock()


def join_pool(store: str, incarnation: str) -> Pool:
    """Return the pool of a module's run, for one more connection. Raises OSError."""
    with _pools_lock:
        pool = _pools.get((store, incarnation))
        if pool is None:
            pool = _pools[store, incarnation] = Pool(store, incarnation)
        pool.users += 1
        return pool


def leave_pool(pool: Pool) -> None:
    """Note that a connection uses a pool no longer. The last one closes it."""
    with _pools_lock:
        pool.users -= 1
        if pool.users:
            return
        for key in [key for key, one in _pools.items() if one is pool]:
            del _pools[key]
    pool.close()


def _forget_pools() -> None:
    """Forget the parent's pools in a forked child, whose connections have pools of their own."""
    global _pools_lock  # noqa: PLW0603
    for pool in _pools.values():
        pool.unlock_key()
    _pools.clear()
    _pools_lock = threading.Lock()


os.register_at_fork(after_in_child=_forget_pools)
