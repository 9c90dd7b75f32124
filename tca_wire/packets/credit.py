"""Flow control: central sends no more while a peer has WINDOW bytes to acknowledge as read.

Messages for a slow reader therefore wait in central, which counts them, and not in ZeroMQ, which
can't count.
"""

from tca_wire.packets.codec import pack_item
from tca_wire.packets.headers import Beat, Receipt

WINDOW = 1 << 20
REPORTED_AFTER = 256 << 10

_BEAT = pack_item(Beat())


class Receipts:
    """The bytes that were read from central's packets and not reported yet."""

    def __init__(self) -> None:
        self._read = 0

    def due(self, packet: bytes) -> bytes:
        """Return the receipt to send after this packet has been read; b"" if none is due."""
        if packet != _BEAT:
            self._read += len(packet)
        return pack_item(Receipt(self._read)) if self._read >= REPORTED_AFTER else b""

    def now(self, answers: list[int]) -> Receipt:
        """Return a receipt for all that has been read, with *answers* that had large data.

        It counts as sent.
        """
        receipt = Receipt(self._read, answers)
        self.sent()
        return receipt

    def sent(self) -> None:
        """Reset the count: the receipt was sent."""
        self._read = 0
