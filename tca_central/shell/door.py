"""The door of central's socket: rejects new connections before file descriptors run out.

libzmq accepts connections in a thread of its own. If no descriptor is free, an accept at a Unix
socket ends the process, and an accept at a TCP socket spins. An unbind would cut all connections
(libzmq #3317). A shut door therefore replaces the listening descriptor by another socket, to which
no program connects. The door itself then accepts new connections and closes them.

A rush of connections can't outrun the door: libzmq stops accepting once a thousand of its events
are unread. The door therefore shuts when only a thousand descriptors and a reserve are left. If the
limit is low, it shuts when half of all descriptors are left.
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
_RUSH = 1100  # connections that libzmq may accept before their events are read, and a reserve
_SWITCH_INTERVAL = 0.001  # seconds that a thread may run while others wait
_CHECK_PERIOD = 1.0  # seconds between checks of whether a shut door can open

log = logging.getLogger("tca.central")


def raise_descriptor_limit() -> None:
    """Raise this process's limit of file descriptors, and let its threads alternate often.

    The door's thread must run often enough to count connections in a rush.
    """
    sys.setswitchinterval(_SWITCH_INTERVAL)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, MOST_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):  # some systems allow less than they say
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


class Door:
    """Watches a listening socket in a thread of its own.

    Create it before the socket is bound, and open it after that.
    """

    def __init__(self, socket: "zmq.Socket[bytes]", on_closed: Callable[[int], None]) -> None:
        """The door's thread calls *on_closed* with the number of connections that have closed."""
        soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        self.limit = MOST_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft
        #: The number of descriptors in use at which it shuts.
        self.shut_at = self.limit - min(self.limit // 2, _RUSH)
        self._on_closed = on_closed
        self._socket = socket
        socket.monitor(_EVENTS, _WATCHED)
        self._monitor = socket.context.socket(zmq.PAIR)
        self._monitor.setsockopt(zmq.RCVHWM, 1)
        self._monitor.connect(_EVENTS)
        self._is_shut = False
        self._accepting = -1  #: the descriptor from which libzmq accepts
        self._listener = -1  #: a copy of that descriptor for the listening socket
        self._placeholder = -1  #: a socket that no program can reach, for a shut door
        self._thread = threading.Thread(target=self._watch, name="door", daemon=True)

    def open(self) -> None:
        """Start watching. The socket must be bound."""
        while (event := self._event())["event"] != zmq.EVENT_LISTENING:
            pass
        self._accepting = event["value"]
        os.set_blocking(self._accepting, False)
        self._listener, self._placeholder = os.dup(self._accepting), _unreachable_socket()
        self._thread.start()

    def close(self) -> None:
        """Stop watching; call this before the socket is closed."""
        self._socket.disable_monitor()
        if self._thread.is_alive():
            self._thread.join()
        self._monitor.close()
        if self._is_shut:
            # libzmq ends the process unless its descriptor is the listening socket again.
            self._accept_from(self._listener)
        for file in (self._listener, self._placeholder):
            if file >= 0:
                os.close(file)

    def _accept_from(self, file: int) -> None:
        """Make libzmq accept from a descriptor.

        libzmq's epoll still watches the listening socket, which stays open here.
        """
        if sys.platform == "linux":  # a kqueue would forget the listening socket
            os.dup2(file, self._accepting, inheritable=False)
        self._is_shut = file == self._placeholder

    def _watch(self) -> None:
        """Count closed connections, and shut and open the door, until libzmq's events end."""
        poller = zmq.Poller()
        poller.register(self._monitor, zmq.POLLIN)
        while True:
            poller.register(
                self._listener, zmq.POLLIN if self._is_shut and sys.platform == "linux" else 0
            )
            ready = dict(poller.poll(int(_CHECK_PERIOD * 1000) if self._is_shut else None))
            if self._monitor in ready and not self._process_events():
                return
            if self._listener in ready:
                self._reject_waiting()
            if self._is_shut:
                self._open_if_there_is_room()

    def _process_events(self) -> bool:
        """Process libzmq's events. Return False after the last one."""
        closed = 0
        self._shut_if_full()
        while self._monitor.poll(0):
            event = self._event()["event"]
            self._shut_if_full()
            if event == zmq.EVENT_MONITOR_STOPPED:
                return False
            closed += event == zmq.EVENT_DISCONNECTED
        if closed:
            self._on_closed(closed)
        return True

    def _event(self) -> dict[str, Any]:
        """Return libzmq's next event; wait for it."""
        return dict(parse_monitor_message(self._monitor.recv_multipart()))

    def _shut_if_full(self) -> None:
        """Shut the door if the lowest free descriptor, which a new file would get, is too high.

        This must be quick: in a rush other threads hold Python's lock.
        """
        lowest = self.limit
        with contextlib.suppress(OSError):
            lowest = os.dup(self._accepting)
            os.close(lowest)
        if lowest >= self.shut_at and not self._is_shut:
            self._accept_from(self._placeholder)
            log.warning(
                "accepts no more connections: %d of %d file descriptors are in use; "
                "end some programs, or start central with a higher limit (ulimit -Hn)",
                lowest,
                self.limit,
            )

    def _open_if_there_is_room(self) -> None:
        """Open the shut door when enough descriptors are free, with a margin."""
        used = sum(1 for _ in Path("/dev/fd").iterdir())
        if used < self.shut_at - self.limit // 16:
            self._accept_from(self._listener)
            log.warning(
                "accepts connections again: %d of %d file descriptors are in use", used, self.limit
            )

    def _reject_waiting(self) -> None:
        """Close connections that wait to be accepted."""
        # An OSError ends the loop: no connection waits.
        with (
            contextlib.suppress(OSError),
            sockets.socket(fileno=os.dup(self._listener)) as listener,
        ):
            while True:
                listener.accept()[0].close()


def _unreachable_socket() -> int:
    """Return a listening socket that no program can reach."""
    with tempfile.TemporaryDirectory() as folder, sockets.socket(sockets.AF_UNIX) as listener:
        listener.setblocking(False)
        listener.bind(str(Path(folder) / "unused"))
        listener.listen()
        return listener.detach()
