"""Keys for this program's sockets: over TCP, keys encrypt, and authenticate both ends."""

import zmq
from zmq.utils.monitor import recv_monitor_message

from tca_module.errors import MisuseError
from tca_wire.errors import KeyRefused
from tca_wire.keys import NO_KEY, VARIABLE, ClientKey, client_key

# central ends an unfinished handshake after two seconds
_HANDSHAKE_MILLISECONDS = 2500
_EVENTS = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
)


def set_client_key(socket: "zmq.Socket[bytes]", address: str) -> ClientKey | None:
    """Set this program's key for the central at *address* on a socket, before it connects.

    The socket then talks to no other central. Returns the key; None if this program uses no key.
    Raises MisuseError.
    """
    try:
        key = client_key(address)
    except KeyRefused as error:
        raise MisuseError(str(error)) from None
    if key is not None:
        socket.setsockopt(zmq.CURVE_SERVERKEY, key.central.encode())
        socket.setsockopt(zmq.CURVE_PUBLICKEY, key.public.encode())
        socket.setsockopt(zmq.CURVE_SECRETKEY, key.secret.encode())
    return key


def key_problem(context: "zmq.Context[zmq.Socket[bytes]]", address: str) -> str:
    """Return why the central at *address* rejects this program's key; "" if it accepts the key.

    This tries to connect, for up to 2.5 seconds.
    """
    if not address.startswith("tcp://"):
        return ""
    with context.socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        try:
            key = set_client_key(socket, address)
        except MisuseError as error:
            return str(error)
        monitor = socket.get_monitor_socket(_EVENTS)
        try:
            socket.connect(address)
            has_event = monitor.poll(_HANDSHAKE_MILLISECONDS)
            event = recv_monitor_message(monitor)["event"] if has_event else None
        finally:
            socket.disable_monitor()
            monitor.close(0)
    if event is None or event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
        return ""
    if key is None:
        remedy = f"make one with 'tca keys new NAME' where central runs, and name it in ${VARIABLE}"
        return f"it wants a key, and this program shows none: {remedy}"
    return (
        f"it does not allow the key '{key.name}' (see 'tca keys list' where central runs),"
        " is not the central that the key is for,"
        f" or wants no key (set ${VARIABLE}={NO_KEY} to show none)"
    )
