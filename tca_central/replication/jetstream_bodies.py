"""Large bodies beside a log on NATS JetStream, in a stream of their own.

A body's pieces have subjects of their own, so that a body can be read and removed alone.
"""

import asyncio
import contextlib
from collections.abc import Iterator

from nats.errors import Error as NatsError
from nats.js.api import StorageType, StreamConfig
from nats.js.errors import NotFoundError

from tca_central.replication.jetstream_connection import JetStreamConnection
from tca_central.replication.shared_log import cut

_PIECES = "Tca-Pieces"
_AT_ONCE = 8
"""Pieces on their way at the same time."""


class JetStreamBodies:
    """The large bodies of a log.

    Args:
        line: The connection. The stream of the bodies has the name of the log's, with "-data".
        subject: The first part of all subjects.
    """

    def __init__(self, line: JetStreamConnection, subject: str) -> None:
        self.line = line
        self._stream, self._subject = f"{line.stream}-data", f"{subject}.data"

    async def open(self, replicas: int) -> None:
        """Create the stream, unless it is there."""
        config = StreamConfig(
            name=self._stream,
            subjects=[f"{self._subject}.*.*.*"],
            storage=StorageType.FILE,
            num_replicas=replicas,
            max_msgs_per_subject=1,
            allow_direct=False,
        )
        try:
            await self.line.until_answered(self.line.api.stream_info, self._stream)
        except NotFoundError:
            await self.line.until_answered(self.line.api.add_stream, config)

    def _subject_of(self, name: str) -> str:
        return f"{self._subject}.{name.replace('/', '.')}"

    async def put(self, name: str, data: bytes) -> None:
        """Store a body."""
        pieces, subject = cut(data), self._subject_of(name)
        headers = {_PIECES: str(len(pieces))}
        for some in _windows(len(pieces)):
            await asyncio.gather(
                *(
                    self.line.until_answered(
                        self._publish, f"{subject}.{one}", pieces[one], headers
                    )
                    for one in some
                )
            )

    async def _publish(self, subject: str, piece: bytes, headers: dict[str, str]) -> None:
        await self.line.api.publish(subject, piece, headers=headers)

    async def get(self, name: str) -> bytes | None:
        """Return a body; None if it is missing or incomplete."""
        subject, pieces = self._subject_of(name), []
        try:
            first = await self.line.until_answered(
                self.line.api.get_last_msg, self._stream, f"{subject}.0"
            )
            pieces.append(first.data or b"")
            for some in _windows(int(first.headers[_PIECES]), 1):
                found = await asyncio.gather(
                    *(
                        self.line.until_answered(
                            self.line.api.get_last_msg, self._stream, f"{subject}.{one}"
                        )
                        for one in some
                    )
                )
                pieces += [one.data or b"" for one in found]
        except NotFoundError:
            return None
        return b"".join(pieces)

    async def remove(self, name: str) -> None:
        """Remove a body, or leave it if the servers do not answer."""
        with contextlib.suppress(NatsError, asyncio.TimeoutError, OSError):
            await self.line.api.purge_stream(self._stream, subject=f"{self._subject_of(name)}.*")

    async def names(self) -> list[str]:
        """Return the names of all bodies."""
        info = await self.line.until_answered(
            self.line.api.stream_info, self._stream, f"{self._subject}.*.*.0"
        )
        subjects = info.state.subjects or {}
        return ["/".join(subject.split(".")[-3:-1]) for subject in subjects]


def _windows(number: int, first: int = 0) -> Iterator[range]:
    """Yield the numbers from *first* up to a *number*, some at once."""
    for begin in range(first, number, _AT_ONCE):
        yield range(begin, min(begin + _AT_ONCE, number))
