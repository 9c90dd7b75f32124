"""The packets from central to a slot with a prefetch, and the library's session that reads them.

Other connections receive central's packets at once. A packet to such a slot may be in transit for a
while. The slot's session may hold replies, to send them together. Packets from the slot reach
central at once, since the effects of a delay could not be observed.
"""

from collections import deque
from typing import Any

from tca_module.session.session import Session
from tca_wire.packets import headers

Item = tuple[Any, bytes]


class SlotInbox:
    """The packets and the session of one slot."""

    def __init__(self, hello: headers.Hello) -> None:
        self.session = Session(hello)
        self.in_transit: deque[Item] = deque()
        self.last_started = 0  #: the delivery whose reply the session may hold

    def enqueue(self, header: Any, body: bytes) -> bool:
        """Store a packet from central if it is in transit for a while; return whether it is.

        If no packet is in transit, one that is not about prefetched messages arrives at once. A
        delay of it would make no difference.
        """
        is_later = bool(self.in_transit) or _is_about_prefetch(header)
        if is_later:
            self.in_transit.append((header, body))
        return is_later

    def receive(self, header: Any, body: bytes) -> bool:
        """Process a packet that arrives; return whether it concerns scripts."""
        if isinstance(header, headers.Welcome | headers.Deliver | headers.Recall):
            self.session.receive(header, body, 0.0)
            self.session.deliveries.clear()  # scripts play these deliveries
        return not _is_about_prefetch(header)

    def start_next(self) -> Item:
        """Start the next prefetched message."""
        header, body = self.session.prefetched.popleft()
        self.last_started = header.delivery
        self.session.held_replies.begin(header.delivery, 0.0)
        return header, body

    def send(self, header: headers.ToCentral, body: bytes) -> bool:
        """Queue a header of a script for ``outgoing``; return whether the session holds it."""
        if isinstance(header, headers.Reply | headers.Fail):
            return self.session.reply(header, body) and self.session.may_begin_next
        self.session.return_before_claim(header)
        self.session.outgoing.append((header, body))
        return False

    def outgoing(self) -> list[Item]:
        """Remove and return the items to send to central now."""
        return self.session.pop_outgoing(float)

    @property
    def state(self) -> list[Any]:
        """The part of the inbox that influences what happens next."""
        prefetched = [header.delivery for header, _ in self.session.prefetched]
        return [self.last_started, prefetched, [*self.session.outgoing], *self.in_transit]

    @property
    def deliveries(self) -> list[int]:
        """The deliveries that are in transit or prefetched, or whose reply is held."""
        packets = (*self.session.outgoing, *self.session.prefetched, *self.in_transit)
        return [
            header.delivery
            for header, _ in packets
            if isinstance(header, headers.Deliver | headers.Reply)
        ]


def _is_about_prefetch(header: Any) -> bool:
    return isinstance(header, headers.Recall) or (
        isinstance(header, headers.Deliver) and header.ahead > 0
    )
