"""What hangs on a connection stays in the process that opened it: it can't be pickled, nor used after a fork."""

import os
from typing import Any
from weakref import WeakSet

from tca_module.errors import MisuseError
from tca_module.session.session import Session

_NO_THREAD = 0


class OfOneProcess:
    """The part of a Connection that refuses its use in other processes. Whatever users hold leads to it."""

    session: Session
    _owner: int
    _lock: Any

    def __init__(self) -> None:
        _opened_here.add(self)

    def __reduce__(self) -> Any:
        what = f"what uses the connection of '{self.session.module}' can't be pickled or copied"
        raise MisuseError(f"{what}: send a task's id, and use connect().task(id) where it arrives")

    def be_inherited(self) -> None:
        """This process was forked from the one that opened it. From now on no thread owns it, and no lock of it opens:
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
            raise MisuseError(f"{what}, which was forked from the one that opened it: connect() in each process")


class _NoLock:
    """The lock of an inherited connection. The real one may have been held when the process was forked."""

    def __init__(self, connection: OfOneProcess) -> None:
        self._connection = connection

    def acquire(self, **_: object) -> None:
        """Raise MisuseError."""
        self._connection.check_process()

    __enter__ = acquire

    def __exit__(self, *_: object) -> None: ...


_opened_here: WeakSet[OfOneProcess] = WeakSet()


def _inherit() -> None:
    """A forked child opens its own."""
    for connection in list(_opened_here):
        connection.be_inherited()
    _opened_here.clear()


os.register_at_fork(after_in_child=_inherit)
