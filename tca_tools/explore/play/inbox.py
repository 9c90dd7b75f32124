"""The packets from central to a slot that may have messages ahead, and the library's own session,
which reads them.

Other connections hear central at once. Here a packet may be under way for a while, and replies may
be held until a turn ends, to leave together. What a slot says reaches central at once here, too:
what it does before that, nobody can see.
"""

from collections import deque
from typing import Any

from tca_module.session.session import Session
from tca_wire.packets import headers

Item = tuple[Any, bytes]


class SlotInbox:
    """One slot's packets and session."""

    def __init__(self, hello: headers.Hello) -> None:
        self.session = Session(hello)
        self.in_transit: deque[Item] = deque()
        self.last_started = 0  #: the delivery whose reply may be held

    def enqueue(self, header: Any, body: bytes) -> bool:
        """Central has sent a packet; whether it is under way for a while. An answer for which the
        slot waits, and a message when it is free, might as well be heard at once, if nothing is
        before them.
        """
        is_later = bool(self.in_transit) or _is_about_prefetch(header)
        if is_later:
            self.in_transit.append((header, body))
        return is_later

    def receive(self, header: Any, body: bytes) -> bool:
        """A packet has come; whether it is one for scripts."""
        if isinstance(header, headers.Welcome | headers.Deliver | headers.Recall):
            self.session.receive(header, body, 0.0)
            self.session.routing.clear()
            self.session.deliveries.clear()  # they are scripts now
        return not _is_about_prefetch(header)

    def start_next(self) -> Item:
        """Begin with the next message that is ahead."""
        header, body = self.session.ahead.popleft()
        self.last_started = header.delivery
        self.session.held.begin(header.delivery, 0.0)
        return header, body

    def send(self, header: headers.ToCentral, body: bytes) -> bool:
        """A script says something to central, which is among ``outgoing`` then; whether it is
        held.
        """
        if isinstance(header, headers.Reply | headers.Fail):
            return self.session.reply(header, body) and self.session.has_next
        self.session.make_way(header)
        self.session.outgoing.append((header, body))
        return False

    def outgoing(self) -> list[Item]:
        """What goes to central now."""
        return self.session.take_outgoing(float)

    @property
    def state(self) -> list[Any]:
        """All of it that matters."""
        ahead = [header.delivery for header, _ in self.session.ahead]
        return [self.last_started, ahead, [*self.session.outgoing], *self.in_transit]

    @property
    def deliveries(self) -> list[int]:
        """Those that came ahead, or are under way, and are not begun, and those whose replies are
        held.
        """
        packets = (*self.session.outgoing, *self.session.ahead, *self.in_transit)
        return [
            header.delivery
            for header, _ in packets
            if isinstance(header, headers.Deliver | headers.Reply)
        ]


def _is_about_prefetch(header: Any) -> bool:
    return isinstance(header, headers.Recall) or (
        isinstance(header, headers.Deliver) and header.ahead > 0
    )
