"""The newest answers to requests. A module may repeat its requests after a reconnect."""

from collections import OrderedDict
from collections.abc import Iterable

from tca_central.model.budget import ANSWER_BYTES
from tca_central.model.deliveries import Connection
from tca_central.model.stored import Stored
from tca_wire.packets.headers import ToModule
from tca_wire.packets.large import held_size

REMEMBERED_ANSWERS = 64
"""Stored answers per connection."""


class KeptAnswers(Stored):
    """The stored answers of all connections.

    A repeated request whose answer was forgotten is refused as too late.
    """

    __slots__ = ("_kept", "bytes", "forgotten", "most")

    def __init__(self, most: int) -> None:
        #: Bytes that all answers may hold. Those of one connection may hold a quarter of ``most``.
        self.most = most
        self.bytes = 0
        self.forgotten = 0  #: number of answers forgotten because they held too many bytes
        self._kept: OrderedDict[tuple[str, int], tuple[Connection, ToModule, bytes]] = OrderedDict()
        """By (session, request number), oldest first: each answer with its connection."""

    def add(self, connection: Connection, number: int, header: ToModule, body: bytes) -> None:
        """Store the answer to a request; a later answer to the same request replaces it."""
        if (connection.session, number) in self._kept:
            connection.answers.remove(number)
            self._forget(connection, number)
        size = ANSWER_BYTES + held_size(body)
        self._kept[connection.session, number] = connection, header, body
        connection.answers.append(number)
        connection.answer_bytes += size
        self.bytes += size
        if len(connection.answers) > REMEMBERED_ANSWERS:
            self._forget_oldest(connection)
        while connection.answer_bytes > self.most // 4 and len(connection.answers) > 1:
            self._forget_oldest(connection)
            self.forgotten += 1
        self.evict()

    def evict(self) -> None:
        """Forget the oldest answers until all answers hold at most ``most`` bytes."""
        while self.bytes > self.most:
            self._forget_oldest(next(iter(self._kept.values()))[0])
            self.forgotten += 1

    def get(self, connection: Connection, number: int) -> tuple[ToModule | None, bytes]:
        """Return the header and body of the answer to a request.

        If the answer is not stored, the header is None.
        """
        _, header, body = self._kept.get((connection.session, number), (None, None, b""))
        return header, body

    def transfer(self, before: Connection, connection: Connection) -> None:
        """Move the answers of a lost connection to the new connection of its session."""
        connection.answers, before.answers = before.answers, connection.answers
        connection.answer_bytes, before.answer_bytes = before.answer_bytes, 0
        for number in connection.answers:
            _, header, body = self._kept[connection.session, number]
            self._kept[connection.session, number] = connection, header, body

    def walked_bytes(self) -> int:
        """Return the bytes of all answers, counted again to check ``bytes``."""
        return sum(ANSWER_BYTES + held_size(body) for _, _, body in self._kept.values())

    def forget_read(self, connection: Connection, numbers: Iterable[int]) -> None:
        """Forget answers that a connection has read: it repeats these requests no more."""
        for number in numbers:
            if (connection.session, number) in self._kept:
                connection.answers.remove(number)
                self._forget(connection, number)

    def forget_all(self, connection: Connection | None) -> None:
        """Forget the answers of a connection that will not repeat any request."""
        while connection is not None and connection.answers:
            self._forget_oldest(connection)

    def _forget_oldest(self, connection: Connection) -> None:
        """Forget the oldest answer of a connection."""
        self._forget(connection, connection.answers.popleft())

    def _forget(self, connection: Connection, number: int) -> None:
        """Forget the answer to a request that is no longer in the connection's list."""
        _, _, body = self._kept.pop((connection.session, number))
        size = ANSWER_BYTES + held_size(body)
        connection.answer_bytes -= size
        self.bytes -= size
