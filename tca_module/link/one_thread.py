"""The check that a connection is used only by its thread and in the process that opened it."""

import os
import threading
from contextlib import AbstractContextManager
from typing import Any
from weakref import WeakSet

from tca_module.errors import MisuseError
from tca_module.session.session import Session

_NO_THREAD = 0
SEND_WITH_YOUR_OWN = (
    "a handler sends with its task, other threads with a client of their own: connect(), or one"
    " that they share: connect(..., threads=True)"
)


class ThreadBound:
    """The part of a Connection that refuses use in other threads and processes.

    Tasks, clients and all other objects of users send with a Connection, which checks their calls.
    """

    session: Session

    def __init__(self) -> None:
        # Other threads take the lock to keep the connection alive and to send late replies.
        self._lock: Any = threading.RLock()
        self._owner, self._owner_name = threading.get_ident(), threading.current_thread().name
        _opened_here.add(self)

    def __reduce__(self) -> Any:
        what = (
            f"an object with the connection of '{self.session.module}' can't be pickled or copied"
        )
        raise MisuseError(f"{what}: send a task's id, and use connect().task(id) where it arrives")

    @property
    def is_own_thread(self) -> bool:
        """Whether the calling thread owns this connection."""
        return threading.get_ident() == self._owner

    def check_thread(
        self, used: object = None, owns: str = "opened it", remedy: str = SEND_WITH_YOUR_OWN
    ) -> None:
        """Raise MisuseError in another thread.

        The error names the *used* object, why its thread *owns* it, and the remedy.
        """
        if threading.get_ident() != self._owner:
            self.check_process()
            what = used or f"a connection of module '{self.session.module}'"
            where = f"is used in thread '{threading.current_thread().name}'"
            owner = f"belongs to thread '{self._owner_name}', which {owns}"
            raise MisuseError(f"{what} {where}, but {owner}: {remedy}")

    def locked(self) -> AbstractContextManager[object]:
        """Return the lock, for a ``with`` block in the owning thread.

        In another thread this raises MisuseError instead of waiting, because a thread that serves a
        slot holds the lock most of the time.
        """
        self.check_thread()
        lock: AbstractContextManager[object] = self._lock
        return lock

    def acquire(self, within: float) -> bool:
        """Lock the connection in any thread; return False if its thread waits all that time."""
        return bool(self._lock.acquire(timeout=within))

    def unlock(self) -> None:
        """End ``acquire``."""
        self._lock.release()

    def mark_inherited(self) -> None:
        """Mark this connection as inherited by a forked process.

        The connection then has no owner. So the thread check of each call fails, and its error
        reports the fork.
        """
        self._owner, self._lock = _NO_THREAD, _NoLock(self)

    @property
    def is_inherited(self) -> bool:
        """Whether another process has opened this connection."""
        return self._owner == _NO_THREAD

    def check_process(self) -> None:
        """Raise MisuseError in a process that was forked from the opening one."""
        if self.is_inherited:
            what = f"the connection of '{self.session.module}' is used in process {os.getpid()}"
            raise MisuseError(
                f"{what}, which was forked from the one that opened it: connect() in each process"
            )


class _NoLock:
    """The lock of an inherited connection. Acquiring it raises MisuseError.

    The real lock may be held for ever, by a thread that the fork did not copy.
    """

    def __init__(self, connection: ThreadBound) -> None:
        self._connection = connection

    def acquire(self, **_: object) -> None:
        """Raise MisuseError."""
        self._connection.check_process()

    __enter__ = acquire

    def __exit__(self, *_: object) -> None: ...


_opened_here: WeakSet[ThreadBound] = WeakSet()


def _inherit() -> None:
    """Mark all connections as inherited in a forked child, which must open its own."""
    for connection in list(_opened_here):
        connection.mark_inherited()
    _opened_here.clear()


os.register_at_fork(after_in_child=_inherit)
