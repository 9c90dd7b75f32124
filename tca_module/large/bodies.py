"""The large bodies of one connection: stored before they leave, opened when they arrive."""

import contextlib
import errno
import os
from pathlib import Path

from tca_module.errors import Refused
from tca_module.large.opening import opened
from tca_module.large.pool import Lease, Pool, join_pool, leave_pool
from tca_wire.errors import BadData
from tca_wire.messages.large_data import LargeData, OpenedBody, copy_of, detached, inline
from tca_wire.packets.headers import Welcome
from tca_wire.packets.large import MARK
from tca_wire.vocabulary import Limit, Refusal

_FULL = (errno.ENOSPC, errno.EDQUOT)


class LargeBodies:
    """The large bodies of one connection.

    Without memory that it shares with central, a body holds its data itself.
    """

    def __init__(self) -> None:
        self._run: tuple[str, str] | None = None  #: folder and epoch of the present central
        self._pool: Pool | None = None

    def on_welcome(self, header: Welcome, incarnation: str) -> bool:
        """Use the store of the central that has welcomed the connection.

        Returns whether it shares memory with this process.
        """
        if self._run == (header.store, header.epoch):
            if self._pool is not None:
                self._pool.take_back(self)
            return self._pool is not None
        self.close()
        self._run = header.store, header.epoch
        try:
            if header.store and Path(header.store, "key").read_text().strip() == header.epoch:
                self._pool = join_pool(header.store, incarnation)
        except (OSError, ValueError):
            pass
        return self._pool is not None

    def store(self, body: bytes, what: object, *, is_away: bool = False) -> bytes:
        """Return a body that can be sent: large data are copied into a segment.

        If central *is_away*, they are copied to the memory of this process, until ``restore``: a
        message that is given up then leaves no segment. *what* names the message in errors.

        Raises Refused if shared memory is full, and BadData if the data are gone, or too large for
        a connection without shared memory.
        """
        if body[:1] != MARK or self._is_stored(body):
            return body
        data = body if isinstance(body, LargeData) else copy_of(body)
        if self._pool is None:
            return _inline(data, what)
        if is_away:
            return detached(data)
        try:
            return self._pool.store(data, self)
        except OSError as error:
            if error.errno not in _FULL:
                return _inline(data, what)
            free = os.statvfs(self._pool.folder)
            text = (
                f"shared memory is full: {data.size:,} bytes are needed,"
                f" {free.f_bavail * free.f_frsize:,} are free in {self._pool.folder}"
            )
            raise Refused(str(what), Refusal.OVERLOAD, text) from None

    def _is_stored(self, body: bytes) -> bool:
        """Whether a body is in a segment of this run, or can have none."""
        if isinstance(body, OpenedBody):
            return isinstance(body.owner, Lease) and body.owner.pool is self._pool
        return self._pool is None and not isinstance(body, LargeData)

    def restore(self, body: bytes) -> bytes:
        """Return what ``store`` does, for a body that may have been stored before.

        If its segment is gone, its data are stored again. If memory is full, the body holds them
        itself. If they are too many for that, or gone, the body is returned as it is: its receiver
        reports that it can't read the data.
        """
        if body[:1] != MARK:
            return body
        try:
            if isinstance(body, OpenedBody) and self._has_lost(body):
                body = copy_of(body)
            return self.store(body, "")
        except Refused:
            with contextlib.suppress(BadData):
                return inline(body)
        except BadData:
            pass
        return bytes(body)

    def _has_lost(self, body: OpenedBody) -> bool:
        """Whether a body is stored, but its segment is gone."""
        owner = body.owner
        return isinstance(owner, Lease) and owner.pool is self._pool and owner.is_lost

    def opened(self, body: bytes) -> bytes:
        """Return a received body; a large one with its memory."""
        if body[:1] != MARK or isinstance(body, OpenedBody):
            return body
        return opened(self._run[0] if self._pool is not None and self._run else "", body)

    def close(self) -> None:
        """Use the present store no longer."""
        pool, self._pool, self._run = self._pool, None, None
        if pool is not None:
            leave_pool(pool)


def _inline(data: LargeData, what: object) -> bytes:
    try:
        return inline(data)
    except BadData:
        limit = f"a message holds at most {Limit.BODY:d}"
        where = "if its module shares no memory with central"
        text = f"{what} has {data.size} bytes: {limit} {where}; send a reference instead"
        raise BadData(text) from None
