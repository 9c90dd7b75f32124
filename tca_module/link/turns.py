"""Turns of a slot. In a turn, a slot handles prefetched messages one after the other.

At the end of the turn, the slot sends their replies together. While a handler runs, the connection
is not locked. If the handler takes long, another thread sends the replies to the earlier messages.
"""

import os
import threading
import time
from collections.abc import Callable

from tca_module.link.packet_line import PacketLine
from tca_wire.packets.headers import Deliver

TURN_SECONDS = 0.001  # seconds after which a turn starts no further message
_CHECK_PERIOD = 0.02  # seconds between two checks for replies that wait for a slow handler
_IDLE_CHECKS = 50  # checks without work after which the thread ends


class Turns:
    """The turns of one connection. The connection's thread calls them and has the lock once."""

    def __init__(self, line: PacketLine, lock: threading.RLock) -> None:
        self._session = line.session
        self._line = line
        self._lock = lock
        self._is_watched = False

    def run(
        self, may_continue: Callable[[], bool], handle: Callable[[Deliver, bytes], None]
    ) -> None:
        """Handle the first prefetched message, and more while *may_continue* and time allow."""
        session, until = self._session, self._line.clock() + TURN_SECONDS
        try:
            while True:
                header, body = session.prefetched.popleft()
                session.held_replies.begin(header.delivery, self._line.handler_time())
                if session.held_replies.ended and not self._is_watched:
                    self._is_watched = True
                    _watcher.add(self)
                self._lock.release()
                try:
                    handle(header, body)
                finally:
                    self._lock.acquire()
                if self._line.clock() >= until or not may_continue():
                    break
        finally:
            session.held_replies.stop()
        self._line.flush()

    def send_late_replies(self) -> bool:
        """Send the replies that wait, from another thread. Returns False if there were none."""
        # The flag is cleared before the replies are read, because a turn first adds its reply and
        # then tests the flag.
        self._is_watched = False
        if self._session.held_replies.ended:
            self._is_watched = True
            if self._lock.acquire(blocking=False):
                try:
                    self._line.flush(0.0, is_patient=True)
                finally:
                    self._lock.release()
        return self._is_watched


class _Watcher:
    """The thread that sends late replies. It runs while there are turns in which replies wait."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._watched: dict[Turns, None] = {}
        self._is_running = False

    def add(self, turns: Turns) -> None:
        """Watch these turns until no replies wait."""
        with self._lock:
            self._watched[turns] = None
            if not self._is_running:
                self._is_running = True
                threading.Thread(target=self._run, name="turns", daemon=True).start()

    def _run(self) -> None:
        idle = 0
        while self._is_running:
            time.sleep(_CHECK_PERIOD)
            with self._lock:
                idle = 0 if self._watched else idle + 1
                self._watched = {
                    turns: None for turns in self._watched if turns.send_late_replies()
                }
                self._is_running = idle < _IDLE_CHECKS


_watcher = _Watcher()


def _reset_after_fork() -> None:
    """Start afresh in a forked child, which has none of the threads."""
    global _watcher  # noqa: PLW0603
    _watcher = _Watcher()


os.register_at_fork(after_in_child=_reset_after_fork)
