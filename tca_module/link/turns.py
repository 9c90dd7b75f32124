"""Turns of a slot. In a turn, a slot handles prefetched messages one after the other.

At the end of the turn, the slot sends their replies together. While a handler runs, the connection
is not locked. If the handler takes long, another thread sends the replies to the earlier messages.
"""

import threading
from collections.abc import Callable

from tca_module.link.packet_line import PacketLine
from tca_module.session.session import PREFETCH
from tca_wire.packets.headers import Deliver

TURN_SECONDS = 0.001  # seconds after which a turn starts no further message
# A quarter of what a slot may prefetch: central refills it while the slot handles the others.
TURN_MESSAGES = PREFETCH // 4
_REPLY_WITHIN = 0.02  # seconds that a reply may wait for a slow handler


class Turns:
    """The turns of one connection. The connection's thread calls them and has the lock once."""

    def __init__(self, line: PacketLine, lock: threading.RLock) -> None:
        self._session = line.session
        self._line = line
        self._lock = lock

    def run(
        self, may_continue: Callable[[], bool], handle: Callable[[Deliver, bytes], None]
    ) -> None:
        """Handle the first prefetched message, and more while *may_continue* and time allow."""
        session, until = self._session, self._line.clock() + TURN_SECONDS
        try:
            for _ in range(TURN_MESSAGES):
                header, body = session.prefetched.popleft()
                session.held_replies.begin(header.delivery, self._line.handler_time())
                if session.outgoing:
                    self._line.hold(self._line.clock() + _REPLY_WITHIN)
                self._line.is_occupied = False
                self._lock.release()
                try:
                    handle(header, body)
                finally:
                    self._lock.acquire()
                    self._line.is_occupied = True
                if self._line.clock() >= until or not may_continue():
                    break
        finally:
            session.held_replies.stop()
        self._line.flush()
