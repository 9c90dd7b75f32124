"""How much a peer has read: central sends nobody more than WINDOW bytes of which it has not heard
that they were read.

So what waits for somebody who does not read lies in central, which can count it, and not in ZeroMQ,
which can't.
"""

from tca_wire.packets.codec import pack_item
from tca_wire.packets.headers import Beat, Receipt

WINDOW = 1 << 20
REPORTED_AFTER = 256 << 10

_BEAT = pack_item(Beat())


class Receipts:
    """What was read of central's packets, and central has not been told yet."""

    def __init__(self) -> None:
        self._read = 0

    def due(self, packet: bytes) -> bytes:
        """What to send after this packet has been read: most times nothing."""
        if packet != _BEAT:
            self._read += len(packet)
        return pack_item(Receipt(self._read)) if self._read >= REPORTED_AFTER else b""

    def sent(self) -> None:
        """That has left."""
        self._read = 0
