"""Connections from outside of handlers: what opens one, and the client for scripts that are no module."""

import logging
import os
import socket
from collections.abc import Callable, Iterable
from secrets import token_hex
from types import TracebackType
from typing import Any, Literal, Protocol, Self, get_args

import msgspec

from tca_module.direct.exchange import Direct, Door
from tca_module.errors import CentralLost, MisuseError, NoCentral, Timeout
from tca_module.link.attachments import Attachments
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, PATIENCE, Connection
from tca_module.link.session import Session
from tca_module.link.transport import DealerTransport, Transport
from tca_module.sending.arguments import check_central, check_patience, check_topic, checked_name
from tca_module.sending.sender import Sender
from tca_wire.endpoint import default_endpoint
from tca_wire.messages.declarations import Message
from tca_wire.packets.headers import PROTOCOL_VERSION, Ask, Hello

Topic = Literal["status", "modules", "messages", "tree", "variables", "load", "attached"]


class CentralNearby(Protocol):
    """A central that is reached without a socket, such as LocalCentral."""

    def transport(self) -> Transport:
        """A new connection to it."""


CentralAddress = str | CentralNearby | None
"""Where central is: a ZeroMQ address, one in this process, or None: $TCA_CENTRAL or the default socket."""


def open_connection(
    central: CentralAddress, hello: Hello, patience: float, is_stopped: Callable[[], bool] = lambda: False,
    direct: Iterable[Message[Any, Any]] = (), attachments: Attachments | None = None,
) -> Connection:  # fmt: skip
    """A connection that central has welcomed. Raises CentralLost if nobody answers for *patience* seconds.

    It takes the messages *direct* from their senders, too, without central. *attachments* are those of its module.
    """
    check_central(central)
    if central is None or isinstance(central, str):
        address = default_endpoint() if central is None else central
        connection = _connection_by_socket(address, hello, patience, list(direct), attachments)
    else:
        connection = Connection(central.transport(), Session(hello, attachments), patience=patience)
    try:
        connection.open(is_stopped)
    except BaseException:
        connection.drop()
        raise
    return connection


def _connection_by_socket(
    address: str, hello: Hello, patience: float, direct: list[Message[Any, Any]], attachments: Attachments | None
) -> Connection:
    transport, door = DealerTransport(address), None
    hello = msgspec.structs.replace(hello, pulse=transport.pulse)
    if direct:
        try:
            door = Door(address, direct)
            hello = msgspec.structs.replace(hello, entrance=door.entrance)
        except OSError as error:
            log = logging.getLogger(f"tca.{hello.module}")
            log.warning("nothing can come to '%s' directly (%s): all goes through central", hello.resource, error)
    session = Session(hello, attachments)
    without_central = Direct(session, transport, f"{hello.incarnation}/{hello.connection}", door)
    return Connection(transport, session, patience=patience, direct=without_central)


def hello(module: str, incarnation: str, connection: int = 0, resource: str = "") -> Hello:
    """How a connection introduces itself."""
    process = f"{socket.gethostname()}:{os.getpid()}"
    return Hello(0, PROTOCOL_VERSION, module, incarnation, connection, resource, process)


def new_incarnation() -> str:
    """A name for one run of a module, and no other."""
    return token_hex(8)


class Client(Sender):
    """A connection of a program that handles nothing; what it sends hangs under the root. For one thread."""

    def __init__(self, connection: Connection) -> None:
        super().__init__()
        self._link: Connection | None = connection
        connection.outside = self

    @property
    def name(self) -> str:
        """The name under which central knows this client."""
        return self._connection().session.module

    @property
    def address(self) -> str:
        """Central's address."""
        return self._connection().address

    def status(self, topic: Topic = "status", *, timeout: float | None = ACKNOWLEDGED_WITHIN) -> Any:
        """What central knows of a topic, as plain values: "status", "modules", "messages", "tree", "variables",
        "load" (how busy everything is, and who waits longest) or "attached" (exception handlers, wiretaps
        and monitors; at most 10 000 of each, with how many there are).

        Raises Timeout if it does not say so within *timeout* seconds (None: waits for ever).
        """
        check_topic(topic, get_args(Topic))
        connection = self._connection()
        request = connection.request(Ask(0, topic), wants_answer=True, is_awaited=True)
        if not connection.wait(request, timeout, f"the question for {topic}"):
            connection.abandon(request)
            where = f"central at {connection.address}"
            msg = f"{where} did not answer the question for {topic} within {timeout:g} s: it is overloaded, ask later"
            raise Timeout(msg)
        return msgspec.msgpack.decode(request.answers[-1][1])

    def close(self) -> None:
        """Say goodbye to central; twice does no harm."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _connection(self) -> Connection:
        if self._link is None:
            msg = "this client is closed: use it inside its 'with' block, or connect() again"
            raise MisuseError(msg)
        return self._link


def connect(name: str = "script", central: CentralAddress = None, patience: float = PATIENCE / 2) -> Client:
    """Connect to central from a program that is no module.

    Raises CentralLost if none answers in *patience* seconds: in a script that nobody catches it ends the program with
    one line and exit code 1.
    """
    check_patience(patience)
    greeting = hello(checked_name("module", name), new_incarnation())
    try:
        return Client(open_connection(central, greeting, patience))
    except CentralLost as error:
        raise NoCentral(str(error)) from None
