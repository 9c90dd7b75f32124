"""The pulse of this process: a socket that echoes central's heartbeats, as proof of life.

ZeroMQ's own C code echoes the heartbeats, so that no echo waits for Python's lock
(docs/decisions/0063-the-pulse-of-a-process.md).
"""

import contextlib
import math
import os
import signal
import threading
import time
from secrets import token_hex

import zmq

from tca_module.sockets.curve import set_client_key

KEEPALIVE = (
    (zmq.TCP_KEEPALIVE, 1),
    (zmq.TCP_KEEPALIVE_IDLE, 5),  # seconds
    (zmq.TCP_KEEPALIVE_INTVL, 1),
    (zmq.TCP_KEEPALIVE_CNT, 5),
)
"""TCP options that detect a line whose far end has vanished."""


class Pulse:
    """The pulse that all connections of this process to one central share; see ``pulse_to``."""

    def __init__(self, address: str, *, is_felt: bool) -> None:
        self.users = 0
        # A fixed routing id is safe here, because it is unique. If the remains of an old line
        # keep a new line out, this process is not watched, but nothing else is lost.
        self.name = b"pulse " + token_hex(8).encode()  #: the routing id of the socket
        self._key = os.getpid(), address, is_felt  # a forked child has a pulse of its own
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        socket = self._context.socket(zmq.DEALER)
        for option, value in _OPTIONS:
            socket.setsockopt(option, value)
        socket.setsockopt(zmq.ROUTING_ID, self.name)
        set_client_key(socket, address)
        socket.connect(address)
        copies = self._context.socket(zmq.PUB) if is_felt else None
        #: gets a copy of each heartbeat
        self._heartbeats = self._context.socket(zmq.SUB) if is_felt else None
        if copies is not None and self._heartbeats is not None:
            copies.setsockopt(zmq.LINGER, 0)
            copies.bind("inproc://copies")
            self._heartbeats.setsockopt(zmq.CONFLATE, 1)
            self._heartbeats.setsockopt(zmq.LINGER, 0)
            self._heartbeats.setsockopt(zmq.SUBSCRIBE, b"")
            self._heartbeats.connect("inproc://copies")
        self._felt = math.inf  #: when a heartbeat was last found; infinite before the first one
        self._feeling = threading.Lock()  #: held while the copies are read
        is_started = threading.Event()
        self._thread = threading.Thread(
            target=_echo, args=(socket, copies, is_started), name="pulse", daemon=True
        )
        self._thread.start()
        # The thread must run before central knows of the pulse, and before another thread holds
        # Python's lock for long.
        is_started.wait()

    def silence(self) -> float:
        """Return the seconds since central's last heartbeat, at most since the last call but one.

        Central sends one a second, unless ``--lost-after`` is 0. Before the first one the result is
        negative. Only for a pulse that is felt.
        """
        now = time.monotonic()
        with self._feeling:
            copies = self._heartbeats
            if (
                copies is not None
                and not copies.closed
                and int(copies.getsockopt(_EVENTS)) & _POLLIN  # cheaper than a poll
            ):
                copies.recv()
                self._felt = now
            return now - self._felt

    def release(self) -> None:
        """End one use; the last one closes the pulse."""
        with _lock:
            self.users -= 1
            if self.users:
                return
            _pulses.pop(self._key, None)
        with self._feeling:
            if self._heartbeats is not None:
                self._heartbeats.close()
        self._context.term()
        self._thread.join()


_OPTIONS = (
    (zmq.SNDHWM, 10),
    (zmq.RCVHWM, 10),
    (zmq.LINGER, 0),
    (zmq.RECONNECT_IVL, 100),
    (zmq.RECONNECT_IVL_MAX, 500),
    # Without this, the kernel tries for minutes to reach a computer that is away.
    (zmq.CONNECT_TIMEOUT, 5000),
    *KEEPALIVE,  # a socket that only answers never notices by itself that central is away
)
_EVENTS, _POLLIN = int(zmq.EVENTS), int(zmq.POLLIN)
_lock = threading.Lock()
_pulses: dict[tuple[int, str, bool], Pulse] = {}


def pulse_to(address: str, *, is_felt: bool = False) -> Pulse:
    """Return this process's pulse for the central at *address*. Call ``release`` in the end.

    *is_felt*: ``silence`` is called, which needs a copy of each heartbeat.
    """
    with _lock:
        key = os.getpid(), address, is_felt
        pulse = _pulses.get(key)
        if pulse is None:
            pulse = _pulses[key] = Pulse(address, is_felt=is_felt)
        pulse.users += 1
        return pulse


def _echo(
    socket: "zmq.Socket[bytes]",
    copies: "zmq.Socket[bytes] | None",
    is_started: threading.Event,
) -> None:
    # A signal delivered to this thread would have to wait for Python's lock.
    signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
    with contextlib.suppress(zmq.ContextTerminated), socket, copies or contextlib.nullcontext():
        is_started.set()
        zmq.proxy(socket, socket, copies)
