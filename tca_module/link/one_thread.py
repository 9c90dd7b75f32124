"""A connection belongs to one thread, and to the process that opened it: it can't be pickled, nor
used after a fork.
"""

import os
import threading
from contextlib import AbstractContextManager
from typing import Any
from weakref import WeakSet

from tca_module.errors import MisuseError
from tca_module.session.session import Session

_NO_THREAD = 0
SEND_WITH_YOUR_OWN = (
    "a handler sends with its task, other threads with a client of their own: connect()"
)


class OfOneThread:
    """The part of a Connection that refuses its use elsewhere. Whatever users hold leads to it."""

    session: Session

    def __init__(self) -> None:
        # against threads that only keep it alive, and send what is late
        self._lock: Any = threading.RLock()
        self._owner, self._owner_name = threading.get_ident(), threading.current_thread().name
        _opened_here.add(self)

    def __reduce__(self) -> Any:
        what = f"what uses the connection of '{self.session.module}' can't be pickled or copied"
        raise MisuseError(f"{what}: send a task's id, and use connect().task(id) where it arrives")

    @property
    def is_mine(self) -> bool:
        """Whether it belongs to the calling thread."""
        return threading.get_ident() == self._owner

    def check_thread(
        self, used: object = None, owns: str = "opened it", remedy: str = SEND_WITH_YOUR_OWN
    ) -> None:
        """Raise MisuseError in another thread. Names what is *used*, why its thread *owns* it, and
        the remedy.
        """
        if threading.get_ident() != self._owner:
            self.check_process()
            what = used or f"a connection of module '{self.session.module}'"
            where = f"is used in thread '{threading.current_thread().name}'"
            raise MisuseError(
                f"{what} {where}, but belongs to thread '{self._owner_name}', which {owns}: {remedy}"
            )

    def mine(self) -> AbstractContextManager[object]:
        """The lock, for a block in its own thread. Raises MisuseError in others, before it is
        taken: a thread that serves keeps it for ever.
        """
        self.check_thread()
        lock: AbstractContextManager[object] = self._lock
        return lock

    def be_inherited(self) -> None:
        """This process was forked from the one that opened it. From now on no thread owns it, and
        no lock of it opens:
        so the checks of threads, which are made anyhow, find it out.
        """
        self._owner, self._lock = _NO_THREAD, _NoLock(self)

    @property
    def is_inherited(self) -> bool:
        """Whether another process has opened it."""
        return self._owner == _NO_THREAD

    def check_process(self) -> None:
        """Raise MisuseError in a process that was forked from the one that opened it."""
        if self.is_inherited:
            what = f"the connection of '{self.session.module}' is used in process {os.getpid()}"
            raise MisuseError(
                f"{what}, which was forked from the one that opened it: connect() in each process"
            )


class _NoLock:
    """The lock of an inherited connection. The real one may have been held when the process was
    forked.
    """

    def __init__(self, connection: OfOneThread) -> None:
        self._connection = connection

    def acquire(self, **_: object) -> None:
        """Raise MisuseError."""
        self._connection.check_process()

    __enter__ = acquire

    def __exit__(self, *_: object) -> None: ...


_opened_here: WeakSet[OfOneThread] = WeakSet()


def _inherit() -> None:
    """A forked child opens its own."""
    for connection in list(_opened_here):
        connection.be_inherited()
    _opened_here.clear()


os.register_at_fork(after_in_child=_inherit)
