"""Central's socket: its options, and the address at which it listens."""

import zmq

from tca_central.errors import CentralError
from tca_central.shell.gate import Gate
from tca_wire.vocabulary import Limit

LIVELY = 20
"""The time after a packet (ms) within which another one is likely."""

_OPTIONS = (
    (zmq.ROUTER_MANDATORY, 1),
    (zmq.SNDHWM, 1000),
    (zmq.RCVHWM, 16),
    (zmq.RCVTIMEO, LIVELY),
    (zmq.MAXMSGSIZE, int(Limit.PACKET)),
    (zmq.LINGER, 1000),
    (zmq.HANDSHAKE_IVL, 2000),
    # No HEARTBEAT_IVL: docs/decisions/0063-the-pulse-of-a-process.md
    (zmq.TCP_MAXRT, 5000),  # milliseconds that the far end may acknowledge nothing
    (zmq.TCP_KEEPALIVE, 1),  # so that there is always something to acknowledge
    (zmq.TCP_KEEPALIVE_IDLE, 1),  # seconds
    (zmq.TCP_KEEPALIVE_INTVL, 1),
)


def socket_in(context: "zmq.Context[zmq.Socket[bytes]]") -> "zmq.Socket[bytes]":
    """Return a socket that is not bound yet."""
    socket = context.socket(zmq.ROUTER)
    for option, value in _OPTIONS:
        socket.setsockopt(option, value)
    return socket


def check_can_bind(endpoint: str) -> None:
    """Raise CentralError if no program can listen at a TCP address. Others are not checked."""
    if not endpoint.startswith("tcp://"):
        return
    with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
        try:
            socket.bind(endpoint)
        except zmq.ZMQError as error:
            raise _cannot_listen(endpoint, error) from None


def _cannot_listen(endpoint: str, error: zmq.ZMQError) -> CentralError:
    reason = "another program uses it" if error.errno == zmq.EADDRINUSE else error.strerror
    return CentralError(f"can't listen on {endpoint}: {reason}; choose another address with --bind")


def bind(
    socket: "zmq.Socket[bytes]",
    endpoint: str,
    context: "zmq.Context[zmq.Socket[bytes]]",
    gate: Gate,
) -> None:
    """Guard a socket with the gate, and bind it. Raises CentralError, and closes all of them."""
    try:
        gate.open(context, socket)
        socket.bind(endpoint)
    except (zmq.ZMQError, CentralError) as error:
        gate.close()
        context.destroy()
        if isinstance(error, CentralError):
            raise
        raise _cannot_listen(endpoint, error) from None
