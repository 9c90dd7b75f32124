"""What waits to be sent: nobody gets more than he reads, and who reads nothing costs only
himself.
"""

from tca_central.events import ConnectionId
from tca_central.shell.outboxes import PACKET_BYTES, Outboxes
from tca_wire.packets import codec
from tca_wire.packets.credit import REPORTED_AFTER, WINDOW, Receipts
from tca_wire.packets.headers import Beat, Receipt

READS, STANDS = ConnectionId(b"reads"), ConnectionId(b"stands")


class Line:
    """A socket with two lines."""

    def __init__(self) -> None:
        self.sent: dict[ConnectionId, list[bytes]] = {READS: [], STANDS: []}
        self.takes = True
        self.boxes = Outboxes(self.send)

    def send(self, connection: ConnectionId, packet: bytes) -> bool:
        if connection not in self.sent:
            raise ConnectionError
        if self.takes:
            self.sent[connection].append(packet)
        return self.takes

    def size(self, connection: ConnectionId) -> int:
        return sum(map(len, self.sent[connection]))


def test_items_share_packets_and_keep_their_order() -> None:
    line = Line()
    items = [bytes([number % 256]) * 1000 for number in range(200)]
    for item in items:
        line.boxes.add(READS, [item])
    assert line.boxes.send_all() == []
    assert b"".join(line.sent[READS]) == b"".join(items)
    assert max(map(len, line.sent[READS])) <= PACKET_BYTES
    assert line.boxes.held == 0


def test_reader_without_receipts_gets_no_more_than_the_window() -> None:
    line, receipts = Line(), Receipts()
    for _ in range(80):
        for one in (READS, STANDS):
            line.boxes.add(one, [bytes(PACKET_BYTES)])
        line.boxes.send_all()
        if receipt := receipts.due(line.sent[READS][-1]):
            ((header, _),) = codec.unpack_to_central(receipt)
            assert isinstance(header, Receipt)
            line.boxes.credit(READS, header.size)
            receipts.sent()
    assert line.size(READS) == 80 * PACKET_BYTES
    assert line.size(STANDS) == WINDOW
    assert line.boxes.held == 80 * PACKET_BYTES - WINDOW
    assert not line.boxes.has_waiting  # for the line: nobody tries in vain
    line.boxes.credit(STANDS, WINDOW)
    line.boxes.send_all()
    assert line.size(STANDS) == 2 * WINDOW


def test_fullest_outbox_is_dropped_first() -> None:
    line = Line()
    for _ in range(30):
        line.boxes.add(STANDS, [bytes(PACKET_BYTES)])
    line.boxes.send_all()
    line.boxes.add(READS, [bytes(10)])
    assert line.boxes.drop_beyond(1 << 20) == {}
    given_up = line.boxes.drop_beyond(100_000)
    assert given_up == {STANDS: 30 * PACKET_BYTES - WINDOW}
    assert line.boxes.held == 10
    line.boxes.add(STANDS, [bytes(10)])  # what it has not read is not forgotten with it
    line.boxes.send_all()
    assert line.size(STANDS) == WINDOW


def test_busy_socket_is_retried_and_lost_connection_reported() -> None:
    line = Line()
    line.takes = False
    line.boxes.add(READS, [b"one"])
    line.boxes.send_all()
    assert line.boxes.has_waiting
    line.takes = True
    line.boxes.send_all()
    assert line.sent[READS] == [b"one"]
    nobody = ConnectionId(b"nobody")
    line.boxes.add(nobody, [b"two"])
    assert line.boxes.send_all() == [nobody]
    assert nobody not in line.boxes.connections()
    assert line.boxes.held == 0


def test_heartbeats_are_not_counted_for_receipts() -> None:
    receipts, beat = Receipts(), codec.pack_item(Beat())
    assert not any(receipts.due(beat) for _ in range(REPORTED_AFTER // len(beat) + 1))
    assert receipts.due(bytes(REPORTED_AFTER))
