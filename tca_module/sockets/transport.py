"""Carries packets between one connection and central, and waits for them together with other
files.
"""

import contextlib
import errno
import functools
import math
import os
import select
import selectors
import socket as sockets
import sys
import threading
import time
from collections.abc import Collection
from typing import Any, Protocol

import zmq

from tca_module.errors import MisuseError
from tca_module.sockets.curve import show_key
from tca_module.sockets.pulse import KEEPALIVE, Pulse, pulse_to

_OPTIONS = (
    # No routing id: central tells connections apart by Hello, a fixed id can leave a zombie behind
    # (libzmq #2892).
    (zmq.IMMEDIATE, 1),  # refuse to queue for a central that is not there, instead of losing it
    (
        zmq.PROBE_ROUTER,
        1,
    ),  # an empty message on each new line: a central that does not know us says so at once
    (zmq.SNDHWM, 1000),
    (zmq.LINGER, 1000),
    (zmq.RECONNECT_IVL, 100),
    (zmq.RECONNECT_IVL_MAX, 500),  # a restarted central has everybody back within a second
    # No HEARTBEAT_IVL: one that is due while a socket lingers whose far end has closed ends the
    # process (libzmq 4.3.5: "Assertion failed: !_io_error"; libzmq #3937). TCP notices a dead line
    # by itself.
    *KEEPALIVE,
)


_PROBED_WITHIN = 0.2  # seconds
_LIVELY = 0.02  # seconds after a packet in which the next one is likely to come


class Beside(Protocol):
    """Something that is waited for together with packets from central."""

    def fileno(self) -> int:
        """A file that becomes readable when there may be something: ask ``has_arrived`` before each
        wait for it.
        """

    def has_arrived(self) -> bool:
        """Whether there is something to do."""


class Transport(Beside, Protocol):
    """Carries packets to one central and back; may lose them when the connection breaks, but keeps
    their order.
    """

    @property
    def address(self) -> str:
        """Central's address, for people."""

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        """Send, waiting so long for central to be there and take it; whether it left."""

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        """The next packet; None if there is none in time, or something else has happened, such as
        *alarm*: a moment of the clock on which callbacks are due.
        """

    def files(self) -> Collection[int]:
        """The files of which one becomes readable when there may be something, or ``wake`` is
        called.
        """

    def waker(self) -> "Waker":
        """Ends waits from other threads; from now on ``wake`` takes effect at once."""

    def wake(self) -> None:
        """Let ``receive`` return soon; may be called from any thread."""

    def time(self) -> float:
        """The seconds of the clock on which callbacks are due; it never jumps."""

    def seconds_until(self, moment: float) -> float:
        """The seconds to wait for a moment of that clock; the thread pauses until then."""

    def pausing(self) -> contextlib.AbstractContextManager[Any]:
        """The block in which its thread waits for files, of which this is one; ``receive`` has no
        need of it.
        """

    def close(self) -> None:
        """Close; packets already sent still leave, for a second."""


class Waker:
    """Ends the waits of one thread from others."""

    def __init__(self) -> None:
        if hasattr(os, "eventfd"):
            self._near = self._far = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        else:
            self._near, self._far = os.pipe()
        self._lock = threading.RLock()  # a signal's handler may set it, too
        self._is_set = False

    def fileno(self) -> int:
        """The file that is readable when it is set."""
        return self._near

    def set(self) -> None:
        """End the wait, or the next one."""
        with self._lock:
            if not self._is_set:
                self._is_set = True
                os.write(self._far, _ONE)

    def clear(self) -> bool:
        """Let waits last again; whether it was set."""
        if not self._is_set:
            return False
        with self._lock:
            os.read(self._near, len(_ONE))
            self._is_set = False
        return True

    def close(self) -> None:
        """End for good; twice does no harm."""
        with self._lock:
            self._is_set = True  # nobody waits any more, and nobody is to write into what has the files' numbers next
            files, self._near, self._far = {self._near, self._far}, -1, -1
            for file in files - {-1}:
                os.close(file)


_ONE = (1).to_bytes(8, sys.byteorder)  # what an eventfd takes; a pipe takes anything


def is_anybody_there(address: str) -> bool:
    """Whether the operating system takes connections to *address* (``ipc://`` or ``tcp://``), as it
    does for a stopped process, but not for one that has ended.
    """
    try:
        _probe(address).close()
    except OSError as error:
        return (
            error.errno == errno.EAGAIN
        )  # of a Unix socket: more have come than a process that stands still took
    except ValueError:
        return False
    return True


def is_turned_away(address: str) -> bool:
    """Whether those who connect to *address* are cut off at once, as by a central that has too many
    connections.
    """
    try:
        with _probe(address) as probe:
            return not probe.recv(1)
    except (OSError, ValueError) as error:
        return isinstance(error, ConnectionResetError)


def _probe(address: str) -> sockets.socket:
    """A connection. Raises OSError, or ValueError if *address* is none."""
    if not address.startswith("ipc://"):
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        return sockets.create_connection((host.strip("[]"), int(port)), _PROBED_WITHIN)
    path = address.removeprefix("ipc://")
    probe = sockets.socket(sockets.AF_UNIX)
    try:
        probe.settimeout(_PROBED_WITHIN)
        probe.connect(f"\0{path[1:]}" if path.startswith("@") else path)
    except OSError:
        probe.close()
        raise
    return probe


_NO_PAUSE = contextlib.nullcontext()


def wait(transport: Transport, seconds: float, files: Collection[int] = ()) -> dict[int, bool]:
    """Wait, at most so many seconds, until *transport* or one of the *files* (their numbers) has
    something to read. Returns the files that have; False: that one is not open.
    """
    poll = select.poll()
    for file in (*transport.files(), *files):
        poll.register(file, select.POLLIN)
    timeout = 0 if transport.has_arrived() else 1000 * max(0.0, seconds)
    with transport.pausing() if timeout else _NO_PAUSE:
        ready = poll.poll(timeout)
    return {file: not event & select.POLLNVAL for file, event in ready if file in files}


# As plain integers: combining pyzmq's enum members costs a microsecond each time.
EVENTS, POLLIN, DONTWAIT = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.DONTWAIT)
SNDMORE = int(zmq.SNDMORE | zmq.DONTWAIT)


def context() -> "zmq.Context[zmq.Socket[bytes]]":
    """The one ZeroMQ context of this process; a forked child has its own."""
    return _context_of(os.getpid())


@functools.cache
def _context_of(_process: int) -> "zmq.Context[zmq.Socket[bytes]]":
    return zmq.Context()


class DealerTransport:
    """A DEALER socket."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = context().socket(zmq.DEALER)
        self._file = int(self._socket.getsockopt(zmq.FD))
        self._receive_timeout = -1
        self._waker = Waker()
        self._is_woken_at_once = False
        self._is_lively = False  #: something was sent lately, or asked for
        self._all: selectors.DefaultSelector | None = None  #: of all files that are waited for
        self._beside: dict[Beside, int] = {}  #: other things waited for -> the file of each
        for option, value in _OPTIONS:
            self._socket.setsockopt(option, value)
        try:
            show_key(self._socket, address)
            self._socket.connect(address)
        except MisuseError:
            self._socket.close(linger=0)
            raise
        except zmq.ZMQError as error:
            self._socket.close(linger=0)
            msg = f"central's address must be 'ipc:///path/of/socket' or 'tcp://host:port', not {address!r} ({error})"
            raise MisuseError(msg) from None
        self._pulse: Pulse | None = pulse_to(address)  #: None when closed
        self.pulse = self._pulse.name

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        """Send, waiting so long for central to be there and take it; whether it left."""
        self._is_lively = True
        try:
            self._socket.send(packet, DONTWAIT)
        except zmq.Again:
            if wait_seconds <= 0 or not self._socket.poll(int(wait_seconds * 1000), zmq.POLLOUT):
                return False
            return self.send(packet, 0)
        return True

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        """The next packet; None if there is none in time, or something else has happened."""
        socket = self._socket
        if alarm < math.inf:
            timeout_seconds = min(timeout_seconds, self.seconds_until(alarm))
        if timeout_seconds <= 0:
            # Asking is cheaper than the exception that an empty socket raises.
            return socket.recv(DONTWAIT) if int(socket.getsockopt(EVENTS)) & POLLIN else None
        if self._is_lively and not (self._beside or self._is_woken_at_once):
            # ZeroMQ's own wait costs less, but no wake from another thread ends it.
            if (packet := self._receive_soon(min(timeout_seconds, _LIVELY))) is not None:
                return packet
            self._is_lively = False
            timeout_seconds -= _LIVELY
        if timeout_seconds > 0:
            wait(self, timeout_seconds)
        return self.receive(0)

    def _receive_soon(self, timeout_seconds: float) -> bytes | None:
        socket, milliseconds = (
            self._socket,
            int(timeout_seconds * 1000) + 1,
        )  # rounded up: 0 would be a busy wait
        if milliseconds != self._receive_timeout:
            self._receive_timeout = milliseconds
            socket.setsockopt(zmq.RCVTIMEO, milliseconds)
        try:
            return socket.recv()
        except zmq.Again:
            return None

    def add(self, beside: Beside) -> None:
        """From now on ``receive`` waits for this, too."""
        self._beside[beside] = beside.fileno()
        self._together().register(self._beside[beside], selectors.EVENT_READ)

    def remove(self, beside: Beside) -> None:
        """Wait for it no longer."""
        self._together().unregister(self._beside.pop(beside))

    def _together(self) -> selectors.DefaultSelector:
        if self._all is None:
            self._all = selectors.DefaultSelector()
            self._all.register(self._file, selectors.EVENT_READ)
        return self._all

    def has_arrived(self) -> bool:
        """Whether there is something to receive, here or beside, or ``wake`` was called since this
        was asked last.
        """
        is_woken = self._waker.clear()
        arrived = [beside.has_arrived() for beside in self._beside]  # all must be asked
        return bool(int(self._socket.getsockopt(EVENTS)) & POLLIN) or is_woken or any(arrived)

    def time(self) -> float:
        """The seconds of the clock on which callbacks are due; it never jumps."""
        return time.monotonic()

    def seconds_until(self, moment: float) -> float:
        """The seconds to wait for a moment of that clock."""
        return moment - time.monotonic()

    def pausing(self) -> contextlib.AbstractContextManager[Any]:
        """Nobody asks."""
        return _NO_PAUSE

    def fileno(self) -> int:
        """A file that becomes readable when a packet arrives: ask ``has_arrived`` before each wait
        for it.
        """
        return self._together().fileno()

    def files(self) -> Collection[int]:
        """The files of which one becomes readable when there may be something, or ``wake`` is
        called.
        """
        return self._file, self._waker.fileno(), *self._beside.values()

    def waker(self) -> Waker:
        """Ends waits from other threads; from now on ``wake`` takes effect at once."""
        self._is_woken_at_once = True
        return self._waker

    def wake(self) -> None:
        """Let ``receive`` return soon: within 0.02 s, until somebody asked for the waker."""
        self._waker.set()

    def close(self) -> None:
        """Close; packets already sent still leave, for a second."""
        if self._all is not None:
            self._all.close()
        self._socket.close()
        self._waker.close()
        if self._pulse is not None:
            self._pulse.release()
            self._pulse = None
