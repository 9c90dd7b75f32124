"""The door of central's socket: turns newcomers away before file descriptors run out.

libzmq accepts connections by itself, and ends the process when a Unix socket's accept finds no
descriptor (over TCP it spins instead); an unbind would cut all connections (libzmq #3317). So a
shut door puts another file in the place of the listening one: its queue is always empty. Whoever
comes meanwhile is accepted and closed here.

A rush can't outrun it: libzmq stops to accept when a thousand of its events have not been read.
Where the limit is so low that fewer descriptors can be kept free, half of them are.
"""

import contextlib
import logging
import os
import resource
import socket as sockets
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import zmq
from zmq.utils.monitor import parse_monitor_message

MOST_DESCRIPTORS = 1 << 20  # more are of no use
_WATCHED = int(
    zmq.EVENT_LISTENING | zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED | zmq.EVENT_MONITOR_STOPPED
)
_EVENTS = "inproc://door"
_RUSH = 1100  # connections that libzmq may accept before their events are read, and some more
_TURN = 0.001  # seconds
_LOOK_AGAIN = 1.0  # seconds after which a shut door may be opened

log = logging.getLogger("tca.central")


def make_room() -> None:
    """Let this process have as many file descriptors as it may, and its threads take turns often
    enough to count.
    """
    sys.setswitchinterval(_TURN)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MOST_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):  # some systems allow less than they say
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


class Door:
    """Watches a socket, in a thread of its own; to be made before the socket is bound, and opened
    after that.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", closed: Callable[[int], None]) -> None:
        """*closed* is called, in that thread, when so many connections have closed."""
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        self.limit = MOST_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft
        self.most = self.limit - min(self.limit // 2, _RUSH)  #: descriptors in use
        self._closed = closed
        self._socket = socket
        socket.monitor(_EVENTS, _WATCHED)
        self._monitor = socket.context.socket(zmq.PAIR)
        self._monitor.setsockopt(zmq.RCVHWM, 1)
        self._monitor.connect(_EVENTS)
        self._is_shut = False
        self._gate = self._listener = self._placeholder = -1
        self._thread = threading.Thread(target=self._watch, name="door", daemon=True)

    def open(self) -> None:
        """Begin. The socket listens by now."""
        while (event := self._event())["event"] != zmq.EVENT_LISTENING:
            pass
        self._gate = event["value"]  #: the descriptor from which libzmq accepts
        os.set_blocking(self._gate, False)
        self._listener, self._placeholder = os.dup(self._gate), _never_called()
        self._thread.start()

    def close(self) -> None:
        """End, before the socket is closed."""
        self._socket.disable_monitor()
        if self._thread.is_alive():
            self._thread.join()
        self._monitor.close()
        if self._is_shut:
            # libzmq ends the process if it can't find again what it listens to
            self._put(self._listener)
        for file in (self._listener, self._placeholder):
            if file >= 0:
                os.close(file)

    def _put(self, file: int) -> None:
        """Have libzmq accept from a file. Its epoll goes on to watch the listening one, which stays
        open here.
        """
        if sys.platform == "linux":  # a kqueue would forget it
            os.dup2(file, self._gate, inheritable=False)
        self._is_shut = file == self._placeholder

    def _watch(self) -> None:
        poller = zmq.Poller()
        poller.register(self._monitor, zmq.POLLIN)
        while True:
            poller.register(
                self._listener, zmq.POLLIN if self._is_shut and sys.platform == "linux" else 0
            )
            ready = dict(poller.poll(int(_LOOK_AGAIN * 1000) if self._is_shut else None))
            if self._monitor in ready and not self._take_events():
                return
            if self._listener in ready:
                self._turn_away()
            if self._is_shut:
                self._open_if_there_is_room()

    def _take_events(self) -> bool:
        """False: that was all."""
        closed = 0
        self._shut_if_full()
        while self._monitor.poll(0):
            event = self._event()["event"]
            self._shut_if_full()
            if event == zmq.EVENT_MONITOR_STOPPED:
                return False
            closed += event == zmq.EVENT_DISCONNECTED
        if closed:
            self._closed(closed)
        return True

    def _event(self) -> dict[str, Any]:
        return dict(parse_monitor_message(self._monitor.recv_multipart()))

    def _shut_if_full(self) -> None:
        """Quick, since in a rush other threads have Python's lock: a new file gets the lowest
        number that is free.
        """
        lowest = self.limit
        with contextlib.suppress(OSError):
            lowest = os.dup(self._gate)
            os.close(lowest)
        if lowest >= self.most and not self._is_shut:
            self._put(self._placeholder)
            log.warning(
                "takes no more connections: %d of %d file descriptors are in use; end some programs, or start central \
with a higher limit (ulimit -Hn)",
                lowest,
                self.limit,
            )

    def _open_if_there_is_room(self) -> None:
        used = sum(1 for _ in Path("/dev/fd").iterdir())
        if used < self.most - self.limit // 16:
            self._put(self._listener)
            log.warning(
                "takes connections again: %d of %d file descriptors are in use", used, self.limit
            )

    def _turn_away(self) -> None:
        """Close what waits to be accepted."""
        # all are gone
        with (
            contextlib.suppress(OSError),
            sockets.socket(fileno=os.dup(self._listener)) as listener,
        ):
            while True:
                listener.accept()[0].close()


def _never_called() -> int:
    """A listening socket that nobody can reach."""
    with tempfile.TemporaryDirectory() as folder, sockets.socket(sockets.AF_UNIX) as listener:
        listener.setblocking(False)
        listener.bind(str(Path(folder) / "nobody"))
        listener.listen()
        return listener.detach()
