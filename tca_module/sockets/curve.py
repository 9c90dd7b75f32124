"""Keys on this program's sockets to central: over TCP they encrypt, and prove who is at either
end.
"""

import zmq
from zmq.utils.monitor import recv_monitor_message

from tca_module.errors import MisuseError
from tca_wire.errors import KeyRefused
from tca_wire.keys import NO_KEY, VARIABLE, ClientKey, client_key

# milliseconds: after two seconds central ends a handshake that comes to nothing
_ANSWERED_WITHIN = 2500
_EVENTS = (
    zmq.EVENT_HANDSHAKE_SUCCEEDED
    | zmq.EVENT_HANDSHAKE_FAILED_AUTH
    | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
    | (zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL)
)


def show_key(socket: "zmq.Socket[bytes]", address: str) -> ClientKey | None:
    """Have a socket show this program's key to the central at *address*, and to no other; before it
    connects. Returns the key; None: none is shown. Raises MisuseError.
    """
    key = key_for(address)
    if key is not None:
        put_key(socket, key)
    return key


def put_key(socket: "zmq.Socket[bytes]", key: ClientKey) -> None:
    """Have a socket show a key, and speak only to its central."""
    socket.setsockopt(zmq.CURVE_SERVERKEY, key.central.encode())
    socket.setsockopt(zmq.CURVE_PUBLICKEY, key.public.encode())
    socket.setsockopt(zmq.CURVE_SECRETKEY, key.secret.encode())


def key_for(address: str) -> ClientKey | None:
    """The key that this program shows the central at *address*; None: none. Raises MisuseError."""
    try:
        return client_key(address)
    except KeyRefused as error:
        raise MisuseError(str(error)) from None


def make_server(socket: "zmq.Socket[bytes]") -> str:
    """Have a socket speak only to those who know its public key, which is new; before it is bound.
    Returns the key.
    """
    public, secret = zmq.curve_keypair()
    socket.setsockopt(zmq.CURVE_SERVER, 1)
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
    return public.decode()


def speak_only_to(socket: "zmq.Socket[bytes]", server: str) -> None:
    """Have a socket speak to whoever has the secret half of a key, and show a pair that nobody
    knows.
    """
    public, secret = zmq.curve_keypair()
    put_key(socket, ClientKey("", public.decode(), secret.decode(), server))


def why_not_let_in(context: "zmq.Context[zmq.Socket[bytes]]", address: str) -> str:
    """What is wrong with the key that this program shows the central at *address*; "" if nothing
    is. Takes a moment.
    """
    if not address.startswith("tcp://"):
        return ""
    with context.socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        try:
            key = show_key(socket, address)
        except MisuseError as error:
            return str(error)
        monitor = socket.get_monitor_socket(_EVENTS)
        try:
            socket.connect(address)
            event = (
                recv_monitor_message(monitor)["event"] if monitor.poll(_ANSWERED_WITHIN) else None
            )
        finally:
            socket.disable_monitor()
            monitor.close(0)
    if event is None or event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
        return ""
    if key is None:
        made = "'tca keys new NAME' makes one where central runs"
        return f"it wants a key, and this program shows none: {made}, ${VARIABLE} names it here"
    theirs = f"it does not allow the key '{key.name}' (where central runs, 'tca keys list' shows those that it does)"
    return f"{theirs}, is not the central that this is a key for, or asks for none (${VARIABLE}={NO_KEY} shows none)"
