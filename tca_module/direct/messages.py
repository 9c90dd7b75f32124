"""The direct messages of one connection, sent and received. A LocalCentral has none."""

import time
from collections.abc import Iterable
from typing import Any

from tca_module.direct.inbox import Inbox
from tca_module.direct.note_batch import NEVER, NoteBatch
from tca_module.direct.routes import DirectRoutes
from tca_module.log import log_of
from tca_module.session.session import Session
from tca_module.sockets.direct import EntranceSocket
from tca_module.sockets.transport import DealerTransport
from tca_wire.messages.declarations import Message
from tca_wire.packets.headers import Deliver, ToCentral
from tca_wire.packets.routes import Barred, Noted

RESTLESS = 0.2  # seconds between two checks of a path that waits for an answer or a greeting


class DirectMessages:
    """Sends and receives direct messages for one connection."""

    def __init__(
        self,
        session: Session,
        transport: DealerTransport | None = None,
        entrance_socket: EntranceSocket | None = None,
        messages: Iterable[Message[Any, Any]] = (),
    ) -> None:
        """*messages*: the messages that *entrance_socket* accepts directly from their senders."""
        self._session = session
        self._notes = NoteBatch()
        self.routes = DirectRoutes(session, transport, self._notes)  #: the sending side
        self._inbox: Inbox | None = None
        self._transport, self._entrance_socket = transport, entrance_socket
        if transport is not None and entrance_socket is not None:
            queries = {message.name: message.message_class.has_reply for message in messages}
            self._inbox = Inbox(
                entrance_socket,
                entrance_socket.entrance.key,
                queries,
                self._notes,
                time.monotonic,
                log_of(session.module),
            )
            transport.add(entrance_socket)

    def listen(self) -> None:
        """Process arrived packets, without handling messages."""
        if self.routes.paths or self._session.routing:
            for header in self._session.routing:
                if self._inbox is not None and isinstance(header, Barred):
                    self._inbox.bar(header.numbers)
            self.routes.listen()
        if self._inbox is not None:
            self._inbox.listen()

    def next_delivery(self) -> tuple[Deliver, bytes] | None:
        """Return central's next delivery to handle, or None.

        While a direct message is handled, only queries that the slot's own resource waits for are
        returned.
        """
        deliveries = self._session.deliveries
        if not deliveries or self._inbox is None or not self._inbox.is_busy:
            return deliveries.popleft() if deliveries else None
        own = next((delivery for delivery in deliveries if delivery[0].own), None)
        if own is not None:
            deliveries.remove(own)
        return own

    @property
    def has_delivery(self) -> bool:
        """Whether ``next_delivery`` would return a delivery."""
        is_busy = self._inbox is not None and self._inbox.is_busy
        return any(header.own or not is_busy for header, _ in self._session.deliveries)

    @property
    def _may_start(self) -> bool:
        inbox = self._inbox
        return (
            inbox is not None
            and inbox.has_message
            and not (inbox.is_busy or self._session.open_deliveries.occupying)
        )

    def next_message(self) -> tuple[Deliver, bytes] | None:
        """Return the next direct message; None without any, or while the slot handles a message."""
        return self._inbox.next_message() if self._inbox is not None and self._may_start else None

    def reply(self, header: Any, body: bytes) -> bool:
        """Send the outcome of a handler; return False if its message came through central."""
        if header.delivery >= 0:
            return False
        if self._inbox is not None:
            self._inbox.reply(header, body)
        return True

    def seconds_until_due(self, seconds: float) -> float:
        """Return the seconds until there is something to do, at most *seconds*."""
        if self._inbox is not None and self._may_start:
            return 0.0
        if self.routes.paths and self.routes.is_restless:
            seconds = min(seconds, RESTLESS)
        if self._notes.due == NEVER:
            return seconds
        return max(0.0, min(seconds, self._notes.due - time.monotonic()))

    def report(self, *, at_once: bool = False) -> None:
        """Hand the notes to the session if they are due, or *at_once*."""
        if self._notes.due != NEVER:
            self._notes.report(self._session, time.monotonic(), at_once=at_once)

    def retain_unsent(self, items: Iterable[tuple[ToCentral, bytes]]) -> None:
        """Retain the notes among items that could not be sent to central."""
        for header, _ in items:
            if isinstance(header, Noted):
                self._notes.restore(header, time.monotonic())

    @property
    def is_used(self) -> bool:
        """Whether messages may arrive from other senders than central."""
        return self._inbox is not None or bool(self.routes.paths)

    def stop_receiving(self) -> None:
        """Receive nothing more, and report the remaining notes.

        Queries that wait here are not lost: their senders send them to other handlers.
        """
        if self._inbox is not None:
            if self._transport is not None and self._entrance_socket is not None:
                self._transport.remove(self._entrance_socket)
            self._inbox.close()
            self._inbox = None
        self.report(at_once=True)

    def close(self) -> None:
        """Close everything. Without an earlier ``stop_receiving``, messages being handled fail."""
        self.routes.close()
        if self._inbox is not None:
            self._inbox.drop()
            self._inbox = None
