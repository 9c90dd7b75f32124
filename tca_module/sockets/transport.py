"""Carries packets between a connection and central; waits for them and for other files at once."""

import contextlib
import functools
import math
import os
import select
import sys
import threading
import time
from collections.abc import Collection, Sequence
from typing import Any, Protocol

import zmq

from tca_module.errors import MisuseError
from tca_module.sockets.curve import set_client_key
from tca_module.sockets.place import Place, place_of
from tca_module.sockets.pulse import KEEPALIVE, Pulse, pulse_to
from tca_wire.endpoint import BadAddresses, addresses_in

_OPTIONS = (
    # No routing id: central identifies connections by Hello, and a fixed id can leave a zombie
    # behind (libzmq #2892).
    (zmq.IMMEDIATE, 1),  # refuse a packet for a central that is away, instead of losing it
    # Sends an empty message on each new line: a central that does not know the line says so.
    (zmq.PROBE_ROUTER, 1),
    (zmq.SNDHWM, 1000),
    (zmq.LINGER, 1000),
    (zmq.RECONNECT_IVL, 100),
    (zmq.RECONNECT_IVL_MAX, 500),  # all modules reconnect to a restarted central within a second
    # No HEARTBEAT_IVL, because a heartbeat can end the process. That happens when it is due on a
    # lingering socket after the far end has closed (libzmq 4.3.5: "Assertion failed: !_io_error";
    # libzmq #3937). TCP keepalive detects a dead line instead.
    *KEEPALIVE,
)


# Seconds without a heartbeat after which central may lead at another address. Central sends one a
# second. A wrong guess costs little: only a central that leads listens.
_SILENT = 1.5
_LOOKS_EVERY = 0.5  # seconds between two looks whether central is gone, if it may move
_SOUGHT_EVERY = 0.25  # the same if it is gone
_LIVELY = 0.02  # seconds after a packet in which the next one is likely


class Transport(Protocol):
    """Carries packets to one central and back.

    Packets may be lost when the connection breaks, but their order is kept.
    """

    hold_seconds: float
    """The seconds for which messages may wait for others, to share a packet."""
    has_others: bool
    """Whether central may move to another address."""

    def is_lost(self) -> bool:
        """Return whether central may have moved: it is gone from here, or silent."""

    def seek(self) -> bytes | None:
        """Connect to another address at which central was found.

        Returns the name of the pulse to it; None if no other address has answered yet.
        """

    @property
    def address(self) -> str:
        """Central's present address, for people."""

    @property
    def addresses(self) -> Sequence[str]:
        """All addresses at which central may be, the present one first."""

    def has_arrived(self) -> bool:
        """Return whether something has arrived, or ``wake`` was called since the last call."""

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        """Send a packet; return whether it left.

        Waits at most *wait_seconds* until central is there and accepts the packet.
        """

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        """Return the next packet, or None if none comes in time or another event ends the wait.

        The wait also ends at *alarm*, a time of the handlers' clock.
        """

    def files(self) -> Collection[int]:
        """Return the files to wait for. Call ``has_arrived`` before each wait.

        One of them becomes readable when something may have arrived, or when ``wake`` is called.
        """

    def waker(self) -> "Waker":
        """Return the waker, and make ``wake`` take effect at once from now on."""

    def wake(self) -> None:
        """Make ``receive`` return soon. May be called from any thread."""

    def time(self) -> float:
        """Return the time of the handlers' clock, in seconds. It never jumps."""

    def seconds_until(self, moment: float) -> float:
        """Return the seconds to wait until *moment*, a time of the handlers' clock.

        The thread then pauses until that time. A stepped clock remembers the time.
        """

    def pausing(self) -> contextlib.AbstractContextManager[Any]:
        """Return a block in which the thread waits for files, among them this transport's.

        ``receive`` does not need the block.
        """

    def close(self) -> None:
        """Close. Packets already sent still leave, for a second."""


class OneAddress:
    """The part of a transport that can't move."""

    address: str
    has_others = False

    @property
    def addresses(self) -> Sequence[str]:
        """The address."""
        return [self.address]

    def is_lost(self) -> bool:
        """Return False."""
        return False

    def seek(self) -> bytes | None:
        """Return None."""
        return None


class Waker:
    """Ends the waits of one thread from other threads."""

    def __init__(self) -> None:
        if hasattr(os, "eventfd"):
            self._read_end = self._write_end = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        else:
            self._read_end, self._write_end = os.pipe()
        self._lock = threading.RLock()  # reentrant, because a signal handler may set it, too
        self._is_set = False

    def fileno(self) -> int:
        """Return the file that is readable while the waker is set."""
        return self._read_end

    def set(self) -> None:
        """End the current wait, or the next one."""
        with self._lock:
            if not self._is_set:
                self._is_set = True
                os.write(self._write_end, _ONE)

    def clear(self) -> bool:
        """Reset the waker; return whether it was set."""
        if not self._is_set:
            return False
        with self._lock:
            os.read(self._read_end, len(_ONE))
            self._is_set = False
        return True

    def close(self) -> None:
        """Close for good. May be called twice."""
        with self._lock:
            # So that no later ``set`` writes into another file that gets the same number.
            self._is_set = True
            files, self._read_end, self._write_end = {self._read_end, self._write_end}, -1, -1
            for file in files - {-1}:
                os.close(file)


_ONE = (1).to_bytes(8, sys.byteorder)  # an eventfd requires eight bytes; a pipe accepts anything


_NO_PAUSE = contextlib.nullcontext()


def wait_for_files(
    transport: Transport, seconds: float, files: Collection[int] = ()
) -> dict[int, bool]:
    """Wait until *transport* or one of the *files* (their numbers) is readable, at most *seconds*.

    Returns the ready files; False stands for a file that is not open.
    """
    poll = select.poll()
    for file in (*transport.files(), *files):
        poll.register(file, select.POLLIN)
    timeout = 0 if transport.has_arrived() else 1000 * max(0.0, seconds)
    with transport.pausing() if timeout else _NO_PAUSE:
        ready = poll.poll(timeout)
    return {file: not event & select.POLLNVAL for file, event in ready if file in files}


# Plain integers, because combining pyzmq's enum members costs a microsecond each time.
_EVENTS, _POLLIN, _POLLOUT = int(zmq.EVENTS), int(zmq.POLLIN), int(zmq.POLLOUT)
_DONTWAIT = int(zmq.DONTWAIT)


def context() -> "zmq.Context[zmq.Socket[bytes]]":
    """Return the one ZeroMQ context of this process; a forked child has its own."""
    return _context_of(os.getpid())


@functools.cache
def _context_of(_process: int) -> "zmq.Context[zmq.Socket[bytes]]":
    return zmq.Context()


class DealerTransport:
    """A transport by a DEALER socket."""

    hold_seconds = 0.001

    def __init__(self, addresses: str) -> None:
        """*addresses*: one, or several with commas, of which one central leads."""
        try:
            found = addresses_in(addresses)
        except BadAddresses as error:
            raise MisuseError(str(error)) from None
        self._place: Place | None = place_of(found) if len(found) > 1 else None
        self.has_others = self._place is not None
        self.address = address = found[0] if self._place is None else self._place.address
        self._addresses = found
        self._socket = context().socket(zmq.DEALER)
        self._file = int(self._socket.getsockopt(zmq.FD))
        self._receive_timeout = -1
        self._waker = Waker()
        self._is_woken_at_once = False
        #: a packet was sent lately, or each packet since then came soon after the one before
        self._is_lively = False
        for option, value in _OPTIONS:
            self._socket.setsockopt(option, value)
        try:
            set_client_key(self._socket, address)
            self._socket.connect(address)
        except MisuseError:
            self._socket.close(linger=0)
            raise
        except zmq.ZMQError as error:
            self._socket.close(linger=0)
            raise MisuseError(
                "central's address must be 'ipc:///path/of/socket' or 'tcp://host:port',"
                f" not {address!r} ({error})"
            ) from None
        #: None when closed
        self._pulse: Pulse | None = pulse_to(address, is_felt=self.has_others)
        self.pulse = self._pulse.name

    @property
    def _is_connected(self) -> bool:
        return bool(int(self._socket.getsockopt(_EVENTS)) & _POLLOUT)

    @property
    def addresses(self) -> Sequence[str]:
        """All addresses at which central may be, the present one first."""
        return [self.address, *(one for one in self._addresses if one != self.address)]

    def is_lost(self) -> bool:
        """Return whether central may have moved: it is gone from here, or silent."""
        if self._pulse is None or self._place is None:
            return False
        has_moved = self._place.address != self.address
        return has_moved or not self._is_connected or self._pulse.silence() > _SILENT

    def seek(self) -> bytes | None:
        """Connect to another address at which central was found. Return the pulse's name."""
        if self._pulse is None or self._place is None:
            return None
        try:
            if (found := self._place.seek(self.address)) == self.address:
                return None
            set_client_key(self._socket, found)  # the key may have changed
            pulse = pulse_to(found, is_felt=True)
        except (MisuseError, RuntimeError):  # no usable key; or Python ends and starts no thread
            return None
        self._socket.disconnect(self.address)
        self._socket.connect(found)
        self._pulse.release()
        self._pulse, self.address = pulse, found
        return pulse.name

    def send(self, packet: bytes, wait_seconds: float) -> bool:
        """Send a packet; return whether it left. Waits *wait_seconds* at most."""
        self._is_lively = True
        try:
            self._socket.send(packet, _DONTWAIT)
        except zmq.Again:
            if wait_seconds <= 0 or not self._socket.poll(int(wait_seconds * 1000), zmq.POLLOUT):
                return False
            return self.send(packet, 0)
        return True

    def receive(self, timeout_seconds: float, alarm: float = math.inf) -> bytes | None:
        """Return the next packet, or None if none comes in time or another event ends the wait."""
        socket = self._socket
        if alarm < math.inf:
            timeout_seconds = min(timeout_seconds, self.seconds_until(alarm))
        if timeout_seconds <= 0:
            # Asking first is cheaper than the exception that an empty socket raises.
            return socket.recv(_DONTWAIT) if int(socket.getsockopt(_EVENTS)) & _POLLIN else None
        if self._is_lively and not self._is_woken_at_once:
            # ZeroMQ's own wait is cheaper, but no wake from another thread ends it.
            if (packet := self._receive_soon(min(timeout_seconds, _LIVELY))) is not None:
                return packet
            self._is_lively = False
            timeout_seconds -= _LIVELY
        if timeout_seconds > 0:
            if self.has_others:  # no event may tell that central is gone
                every = _LOOKS_EVERY if self._is_connected else _SOUGHT_EVERY
                timeout_seconds = min(timeout_seconds, every)
            wait_for_files(self, timeout_seconds)
        return self.receive(0)

    def _receive_soon(self, timeout_seconds: float) -> bytes | None:
        socket = self._socket
        milliseconds = int(timeout_seconds * 1000) + 1  # rounded up: 0 would be a busy wait
        if milliseconds != self._receive_timeout:
            self._receive_timeout = milliseconds
            socket.setsockopt(zmq.RCVTIMEO, milliseconds)
        try:
            return socket.recv()
        except zmq.Again:
            return None

    def has_arrived(self) -> bool:
        """Return whether something has arrived, or ``wake`` was called since the last call."""
        is_woken = self._waker.clear()
        # Asked even after a wake, because the call resets the socket's file.
        return bool(int(self._socket.getsockopt(_EVENTS)) & _POLLIN) or is_woken

    def time(self) -> float:
        """Return the time of the handlers' clock, in seconds. It never jumps."""
        return time.monotonic()

    def seconds_until(self, moment: float) -> float:
        """Return the seconds to wait until *moment*, a time of the handlers' clock."""
        return moment - time.monotonic()

    def pausing(self) -> contextlib.AbstractContextManager[Any]:
        """Return a block that does nothing: no test steps this clock."""
        return _NO_PAUSE

    def files(self) -> Collection[int]:
        """Return the files to wait for.

        One of them becomes readable when something may have arrived, or when ``wake`` is called.
        """
        return self._file, self._waker.fileno()

    def waker(self) -> Waker:
        """Return the waker, and make ``wake`` take effect at once from now on."""
        self._is_woken_at_once = True
        return self._waker

    def wake(self) -> None:
        """Make ``receive`` return within 0.02 s, or at once after a call of ``waker``."""
        self._waker.set()

    def close(self) -> None:
        """Close. Packets already sent still leave, for a second."""
        self._socket.close()
        self._waker.close()
        if self._pulse is not None:
            self._pulse.release()
            self._pulse = None
