"""Outboxes hold unsent packets. A connection is sent no more than it reads, and a slow reader
delays no other.
"""

from tca_central.events import ConnectionId
from tca_central.shell.outboxes import PACKET_BYTES, Outboxes
from tca_wire.packets import codec
from tca_wire.packets.credit import REPORTED_AFTER, WINDOW, Receipts
from tca_wire.packets.headers import Beat, Receipt

READS, STALLED = ConnectionId(b"reads"), ConnectionId(b"stalled")


class Socket:
    """A socket with two connections. One of them reads; the other does not."""

    def __init__(self) -> None:
        self.sent: dict[ConnectionId, list[bytes]] = {READS: [], STALLED: []}
        self.accepts = True
        self.boxes = Outboxes(self.send)

    def send(self, connection: ConnectionId, packet: bytes) -> bool:
        if connection not in self.sent:
            raise ConnectionError
        if self.accepts:
            self.sent[connection].append(packet)
        return self.accepts

    def size(self, connection: ConnectionId) -> int:
        return sum(map(len, self.sent[connection]))


def test_items_share_packets_and_keep_their_order() -> None:
    socket = Socket()
    items = [bytes([number % 256]) * 1000 for number in range(200)]
    for item in items:
        socket.boxes.add(READS, [item])
    assert socket.boxes.send_all() == []
    assert b"".join(socket.sent[READS]) == b"".join(items)
    assert max(map(len, socket.sent[READS])) <= PACKET_BYTES
    assert socket.boxes.held == 0


def test_reader_without_receipts_gets_no_more_than_the_window() -> None:
    socket, receipts = Socket(), Receipts()
    for _ in range(80):
        for one in (READS, STALLED):
            socket.boxes.add(one, [bytes(PACKET_BYTES)])
        socket.boxes.send_all()
        if receipt := receipts.due(socket.sent[READS][-1]):
            ((header, _),) = codec.unpack_to_central(receipt)
            assert isinstance(header, Receipt)
            socket.boxes.credit(READS, header.size)
            receipts.sent()
    assert socket.size(READS) == 80 * PACKET_BYTES
    assert socket.size(STALLED) == WINDOW
    assert socket.boxes.held == 80 * PACKET_BYTES - WINDOW
    assert not socket.boxes.has_waiting  # no packet waits for the socket itself
    socket.boxes.credit(STALLED, WINDOW)
    socket.boxes.send_all()
    assert socket.size(STALLED) == 2 * WINDOW


def test_fullest_outbox_is_dropped_first() -> None:
    socket = Socket()
    for _ in range(30):
        socket.boxes.add(STALLED, [bytes(PACKET_BYTES)])
    socket.boxes.send_all()
    socket.boxes.add(READS, [bytes(10)])
    assert socket.boxes.drop_beyond(1 << 20) == {}
    given_up = socket.boxes.drop_beyond(100_000)
    assert given_up == {STALLED: 30 * PACKET_BYTES - WINDOW}
    assert socket.boxes.held == 10
    socket.boxes.add(STALLED, [bytes(10)])  # the unread bytes of the connection still count
    socket.boxes.send_all()
    assert socket.size(STALLED) == WINDOW


def test_busy_socket_is_retried_and_lost_connection_reported() -> None:
    socket = Socket()
    socket.accepts = False
    socket.boxes.add(READS, [b"one"])
    socket.boxes.send_all()
    assert socket.boxes.has_waiting
    socket.accepts = True
    socket.boxes.send_all()
    assert socket.sent[READS] == [b"one"]
    lost = ConnectionId(b"lost")
    socket.boxes.add(lost, [b"two"])
    assert socket.boxes.send_all() == [lost]
    assert lost not in socket.boxes.idle_connections()
    assert socket.boxes.held == 0


def test_heartbeats_are_not_counted_for_receipts() -> None:
    receipts, beat = Receipts(), codec.pack_item(Beat())
    assert not any(receipts.due(beat) for _ in range(REPORTED_AFTER // len(beat) + 1))
    assert receipts.due(bytes(REPORTED_AFTER))
