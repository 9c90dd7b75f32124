"""What is to be sent: packets that wait for their connections, within a bound. Knows no socket.

Items of a turn share packets. A connection that has not read what it was sent gets no more before
it says so (Receipt):
the rest waits here. If all that is too much, the connection for which most waits is given up.
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
        self.packets: deque[list[bytes]] = deque()  #: the pieces of each
        self.room = 0  #: bytes that go into the last one
        self.size = 0  #: bytes of all

    def put(self, item: list[bytes], size: int) -> None:
        """Add an item, in pieces, to the last packet, or begin another one."""
        if size > self.room:
            self.packets.append([])
            self.room = PACKET_BYTES
        self.packets[-1] += item
        self.room -= size
        self.size += size


class Outboxes:
    """Those of all connections."""

    def __init__(self, send: Callable[[ConnectionId, bytes], bool]) -> None:
        """*send* sends a packet; False: the line takes no more now. Raises ConnectionError if there
        is none.
        """
        self._send = send
        self._boxes: dict[ConnectionId, Outbox] = {}
        self._ready: dict[ConnectionId, Outbox] = {}  #: those with something to send
        #: bytes that were sent, and not read as far as is known
        self._unread: dict[ConnectionId, int] = {}
        self.held = 0  #: bytes in all boxes

    @property
    def are_waiting(self) -> bool:
        """Whether a line takes no more now."""
        return bool(self._ready)

    @property
    def unread(self) -> int:
        """Bytes that were sent, or wait to be, and were not read."""
        return self.held + sum(self._unread.values())

    def put(self, connection: ConnectionId, item: list[bytes]) -> None:
        """An item, in pieces, is to be sent. A large body is a piece of its own: many who are sent
        it share it.
        """
        box = self._boxes.get(connection)
        if box is None:
            self._boxes[connection] = box = Outbox()
        size = sum(map(len, item))
        box.put(item, size)
        self.held += size
        self._ready[connection] = box

    def got(self, connection: ConnectionId, size: int) -> None:
        """A connection has read so much."""
        if connection in self._unread:
            self._unread[connection] = max(0, self._unread[connection] - max(size, 0))
            box = self._boxes.get(connection)
            if box is not None and box.packets:
                self._ready[connection] = box

    def send_all(self) -> list[ConnectionId]:
        """Send what can be sent; the connections whose lines are gone."""
        ready, self._ready = self._ready, {}
        gone = []
        for connection, box in ready.items():
            try:
                self._send_from(box, connection)
            except ConnectionError:
                gone.append(connection)
        for connection in gone:
            self.forget(connection, is_gone=True)
        return gone

    def _send_from(self, box: Outbox, connection: ConnectionId) -> None:
        packets, unread = box.packets, self._unread.get(connection, 0)
        try:
            while packets and unread < WINDOW:
                packet = b"".join(packets[0])
                if not self._send(connection, packet):
                    packets[0] = [packet]  # joined once, however often it is tried
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

    def give_up_beyond(self, most: int) -> dict[ConnectionId, int]:
        """Forget those for which most waits until no more than so many bytes do; how much waited
        for each.
        """
        given_up = {}
        while self.held > most:
            connection = max(self._boxes, key=lambda one: self._boxes[one].size)
            given_up[connection] = self._boxes[connection].size
            self.forget(connection)
        return given_up

    def forget(self, connection: ConnectionId, *, is_gone: bool = False) -> None:
        """Nothing that waits is sent any more. If the line *is gone*, nothing is on its way
        either.
        """
        if (box := self._boxes.pop(connection, None)) is not None:
            self.held -= box.size
        self._ready.pop(connection, None)
        if is_gone:
            self._unread.pop(connection, None)

    def forget_all(self) -> None:
        """Nothing may be sent."""
        for connection in list(self._boxes):
            self.forget(connection)

    def connections(self) -> list[ConnectionId]:
        """All to which something was sent, or is not to be sent yet."""
        return [one for one in self._boxes | self._unread if one not in self._ready]
