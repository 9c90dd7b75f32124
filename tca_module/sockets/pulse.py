"""The pulse of this process: a socket that echoes central's packets, so that central sees that the
process lives.

ZeroMQ's own C code echoes them, without Python's lock
(docs/decisions/0063-the-pulse-of-a-process.md).
"""

import contextlib
import os
import signal
import threading
from secrets import token_hex

import zmq

from tca_module.sockets.curve import show_key

KEEPALIVE = (
    (zmq.TCP_KEEPALIVE, 1),
    (zmq.TCP_KEEPALIVE_IDLE, 5),  # seconds
    (zmq.TCP_KEEPALIVE_INTVL, 1),
    (zmq.TCP_KEEPALIVE_CNT, 5),
)
"""Options by which a line whose far end has vanished is noticed."""


class Pulse:
    """One for all connections of this process to one central: ``pulse_to`` gives it, ``release``
    ends its use.
    """

    def __init__(self, address: str) -> None:
        self.users = 0
        # A routing id of one's own is safe here: nobody else has it, and a line that it shuts out
        # is only not watched.
        self.name = b"pulse " + token_hex(8).encode()  #: its routing id
        self._key = os.getpid(), address  # after a fork the child has a pulse of its own
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        socket = self._context.socket(zmq.DEALER)
        for option, value in _OPTIONS:
            socket.setsockopt(option, value)
        socket.setsockopt(zmq.ROUTING_ID, self.name)
        show_key(socket, address)
        socket.connect(address)
        beats = threading.Event()
        self._thread = threading.Thread(
            target=_send_back, args=(socket, beats), name="pulse", daemon=True
        )
        self._thread.start()
        beats.wait()  # before central hears of it, and before anybody keeps Python's lock

    def release(self) -> None:
        """One user less; the last one ends it."""
        with _lock:
            self.users -= 1
            if self.users:
                return
            _pulses.pop(self._key, None)
        self._context.term()
        self._thread.join()


_OPTIONS = (
    (zmq.SNDHWM, 10),
    (zmq.RCVHWM, 10),
    (zmq.LINGER, 0),
    (zmq.RECONNECT_IVL, 100),
    (zmq.RECONNECT_IVL_MAX, 500),
    (
        zmq.CONNECT_TIMEOUT,
        5000,
    ),  # else the kernel tries for minutes to reach a computer that is away
    *KEEPALIVE,  # it only answers: by itself it would never notice that there is nobody any more
)
_lock = threading.Lock()
_pulses: dict[tuple[int, str], Pulse] = {}


def pulse_to(address: str) -> Pulse:
    """The pulse of this process for the central at *address*; ``release`` it in the end."""
    with _lock:
        pulse = _pulses.get((os.getpid(), address))
        if pulse is None:
            pulse = _pulses[os.getpid(), address] = Pulse(address)
        pulse.users += 1
        return pulse


def _send_back(socket: "zmq.Socket[bytes]", beats: threading.Event) -> None:
    # A signal that came here would have to wait for Python's lock.
    signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    with contextlib.suppress(zmq.ContextTerminated), socket:
        beats.set()
        zmq.proxy(socket, socket)
