"""Outboxes: packets that wait to be sent to their connections, within a bound. Uses no socket.

An *item* is one message, packed. Items of one turn share packets. A connection reports the bytes
that it has read (Receipt). While WINDOW sent bytes are unread, further packets wait here. When all
outboxes together exceed the bound, the fullest is dropped.
"""

from collections import deque
from collections.abc import Callable

from tca_central.events import ConnectionId
from tca_wire.packets.credit import WINDOW

PACKET_BYTES = 64 << 10  # a packet is closed when it holds this much


class Outbox:
    """Packets that wait for one connection."""

    __slots__ = ("packets", "room", "size")

    def __init__(self) -> None:
        self.packets: deque[list[bytes]] = deque()  #: each as its pieces
        self.room = 0  #: bytes that still fit into the last packet
        self.size = 0  #: bytes of all packets

    def add(self, item: list[bytes], size: int) -> None:
        """Append an item, in pieces, to the last packet, or start another packet."""
        if size > self.room:
            self.packets.append([])
            self.room = PACKET_BYTES
        self.packets[-1] += item
        self.room -= size
        self.size += size


class Outboxes:
    """The outboxes of all connections."""

    def __init__(self, send: Callable[[ConnectionId, bytes], bool]) -> None:
        """*send* sends a packet. It returns False if the connection accepts no more now.

        *send* raises ConnectionError if the connection is closed.
        """
        self._send = send
        self._boxes: dict[ConnectionId, Outbox] = {}
        self._ready: dict[ConnectionId, Outbox] = {}  #: outboxes to try to send from
        #: By connection: bytes sent to it that it has not reported as read.
        self._unread: dict[ConnectionId, int] = {}
        self.held = 0  #: bytes in all boxes

    @property
    def has_waiting(self) -> bool:
        """Whether packets wait that a connection did not accept."""
        return bool(self._ready)

    @property
    def unread(self) -> int:
        """Bytes that modules have yet to read, sent or not."""
        return self.held + sum(self._unread.values())

    def add(self, connection: ConnectionId, item: list[bytes]) -> None:
        """Queue an item, in pieces. Connections share a large body, which is a piece of its own."""
        box = self._boxes.get(connection)
        if box is None:
            self._boxes[connection] = box = Outbox()
        size = len(item[0]) if len(item) == 1 else sum(map(len, item))
        box.add(item, size)
        self.held += size
        self._ready[connection] = box

    def ahead(self, connection: ConnectionId) -> int:
        """Return the bytes that a connection has yet to read, sent or not."""
        return self._boxes[connection].size + self._unread.get(connection, 0)

    def credit(self, connection: ConnectionId, size: int) -> None:
        """Note that a connection has read *size* bytes."""
        if connection in self._unread:
            self._unread[connection] = max(0, self._unread[connection] - max(size, 0))
            box = self._boxes.get(connection)
            if box is not None and box.packets:
                self._ready[connection] = box

    def send_all(self) -> list[ConnectionId]:
        """Send what connections accept. Return the connections that turn out to be closed."""
        ready, self._ready = self._ready, {}
        closed = []
        for connection, box in ready.items():
            try:
                self._send_from(box, connection)
            except ConnectionError:
                closed.append(connection)
        for connection in closed:
            self.forget(connection, is_closed=True)
        return closed

    def _send_from(self, box: Outbox, connection: ConnectionId) -> None:
        """Send what one connection accepts. Raises ConnectionError if it is closed."""
        packets, unread = box.packets, self._unread.get(connection, 0)
        try:
            while packets and unread < WINDOW:
                packet = b"".join(packets[0])
                if not self._send(connection, packet):
                    packets[0] = [packet]  # joined only once, however many attempts follow
                    self._ready[connection] = box
                    return
                packets.popleft()
                unread += len(packet)
                box.size -= len(packet)
                self.held -= len(packet)
            if not packets:
                box.room = 0
        finally:
            self._unread[connection] = unread

    def drop_beyond(self, most: int) -> dict[ConnectionId, int]:
        """Drop the fullest outboxes until at most *most* bytes wait. Return the bytes of each."""
        dropped = {}
        while self.held > most:
            connection = max(self._boxes, key=lambda one: self._boxes[one].size)
            dropped[connection] = self._boxes[connection].size
            self.forget(connection)
        return dropped

    def forget(self, connection: ConnectionId, *, is_closed: bool = False) -> None:
        """Drop a connection's outbox. If the connection is closed, forget its unread bytes too."""
        if (box := self._boxes.pop(connection, None)) is not None:
            self.held -= box.size
        self._ready.pop(connection, None)
        if is_closed:
            self._unread.pop(connection, None)

    def forget_all(self) -> None:
        """Drop everything that waits."""
        for connection in list(self._boxes):
            self.forget(connection)

    def idle_connections(self) -> list[ConnectionId]:
        """Return connections with an outbox or unread bytes, but without packets to send now."""
        return [one for one in self._boxes | self._unread if one not in self._ready]
