"""Checks the keys of programs that connect over TCP.

ZeroMQ asks at each handshake whether a key is known (ZAP), and a thread answers. The sockets name a
domain and enforce it, so that without an answer no program gets in. Without a domain ZeroMQ would
let in every program. Before central listens, ``try_out`` checks that a known key gets in and an
unknown one does not.
"""

import contextlib
import logging
import tempfile
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import zmq
from zmq.utils import z85

from tca_central.errors import CentralError
from tca_central.shell.log_limit import LogLimit

DOMAIN = b"tca"
_ADDRESS = "inproc://zeromq.zap.01"
_NOT_NOW = b"300"
_TRIED_WITHIN = 5000  # milliseconds for each step of ``try_out``

log = logging.getLogger("tca.central")


class KeyPair(NamedTuple):
    """A pair of CURVE keys, as text."""

    public: str
    secret: str


def new_pair() -> KeyPair:
    """Generate a pair of keys.

    The public half never starts with "-", so that no command line takes it for an option.
    """
    public, secret = zmq.curve_keypair()
    while public.startswith(b"-"):
        public, secret = zmq.curve_keypair()
    return KeyPair(public.decode(), secret.decode())


def guard(socket: "zmq.Socket[bytes]", own: KeyPair) -> None:
    """Let only known keys in, and no program if keys can't be checked. Call this before the bind.

    *own* are central's keys.
    """
    socket.setsockopt(zmq.ZAP_DOMAIN, DOMAIN)  # ZeroMQ does not enforce an empty one
    socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, own.secret.encode())


class Authenticator:
    """Answers for the sockets of one context whether a key is known.

    ZeroMQ then gives each packet its sender's public key as ``User-Id``.
    """

    def __init__(
        self, context: "zmq.Context[zmq.Socket[bytes]]", is_known: Callable[[str], bool]
    ) -> None:
        """*is_known* is called in the authenticator's thread."""
        self._is_known = is_known
        self._trial_key = ""  #: the key that ``try_out`` lets in while it runs
        self._has_answered = threading.Event()
        self._limited_log = LogLimit(log)
        self._socket = context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(_ADDRESS)
        self._end_sender = context.socket(zmq.PAIR)
        self._end_receiver = context.socket(zmq.PAIR)
        self._end_sender.bind("inproc://authenticator")
        self._end_receiver.connect("inproc://authenticator")
        self._thread = threading.Thread(target=self._run, name="authenticator", daemon=True)
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        """Whether it still answers."""
        return self._thread.is_alive()

    def close(self) -> None:
        """End the thread: from now on no program gets in."""
        with contextlib.suppress(zmq.ZMQError):
            self._end_sender.send(b"", zmq.DONTWAIT)
        self._thread.join()
        self._end_sender.close(0)

    def _run(self) -> None:
        """Answer handshakes until ``close``, or until the context ends."""
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._end_receiver, zmq.POLLIN)
        try:
            while self._end_receiver not in (ready := dict(poller.poll())):
                if self._socket in ready:
                    self._socket.send_multipart(self._answer(self._socket.recv_multipart()))
                    self._has_answered.set()
        except zmq.ContextTerminated:
            pass
        except Exception:
            log.exception(
                "no program can connect any more: the authenticator has failed; start central again"
            )
        finally:
            self._socket.close(0)
            self._end_receiver.close(0)

    def _answer(self, request: list[bytes]) -> list[bytes]:
        """Return the answer to a handshake (ZeroMQ RFC 27).

        An unknown key gets the status "not now" rather than "never". After "never" libzmq would not
        try again, and a program whose key is allowed later would have to be restarted.
        """
        version, number, domain, address, _, mechanism, *credentials = request
        is_ours = (version, domain, mechanism) == (b"1.0", DOMAIN, b"CURVE") and len(
            credentials
        ) == 1
        key = z85.encode(credentials[0]).decode() if is_ours and len(credentials[0]) == 32 else ""
        if key and (key == self._trial_key or self._is_known(key)):
            return [b"1.0", number, b"200", b"OK", key.encode(), b""]
        where = address.decode(errors="backslashreplace")
        if not self._trial_key:
            self._limited_log.warning(
                where, "refused a key from %s that is not allowed here: %s", where, key or "none"
            )
        return [b"1.0", number, _NOT_NOW, b"this key is not allowed", b"", b""]

    def try_out(self, context: "zmq.Context[zmq.Socket[bytes]]", own: KeyPair) -> None:
        """Check that a known key gets in and an unknown one does not. Raises CentralError."""
        known, stranger = new_pair(), new_pair()
        self._trial_key = known.public
        self._has_answered.clear()
        try:
            with ExitStack() as stack:
                folder = stack.enter_context(tempfile.TemporaryDirectory())
                socket = stack.enter_context(context.socket(zmq.ROUTER))
                guard(socket, own)
                socket.setsockopt(zmq.LINGER, 0)
                address = f"ipc://{Path(folder) / 's'}"
                socket.bind(address)
                refused = _knock(stack, context, address, stranger, own.public)
                self._has_answered.wait(_TRIED_WITHIN / 1000)
                let_in = _knock(stack, context, address, known, own.public)
                gets_in = [bool(let_in.poll(_TRIED_WITHIN)), bool(refused.poll(0))]
        finally:
            self._trial_key = ""
        if gets_in != [True, False]:
            what = "an unknown key was let in" if gets_in[1] else "a known key was not let in"
            msg = f"keys can't be checked here ({what} when tried): check the installation of pyzmq"
            raise CentralError(msg)


def _knock(
    stack: ExitStack,
    context: "zmq.Context[zmq.Socket[bytes]]",
    address: str,
    pair: KeyPair,
    central: str,
) -> "zmq.Socket[bytes]":
    """Connect with a pair of keys. Return the socket that reports when the handshake succeeds."""
    socket = stack.enter_context(context.socket(zmq.DEALER))
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.CURVE_SERVERKEY, central.encode())
    socket.setsockopt(zmq.CURVE_PUBLICKEY, pair.public.encode())
    socket.setsockopt(zmq.CURVE_SECRETKEY, pair.secret.encode())
    monitor: zmq.Socket[bytes] = socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
    stack.callback(monitor.close, 0)
    stack.callback(socket.disable_monitor)
    socket.connect(address)
    return monitor
