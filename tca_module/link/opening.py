"""Opens a connection to a central behind a socket, or to one in this process."""

import os
import socket
from collections.abc import Callable
from secrets import token_hex
from typing import Protocol

import msgspec

from tca_module.checks import CENTRAL, check
from tca_module.link.connection import Connection
from tca_module.session.lasting_attachments import LastingAttachments
from tca_module.session.session import PREFETCH, Session
from tca_module.sockets.transport import DealerTransport, Transport
from tca_wire.endpoint import default_endpoint
from tca_wire.packets.headers import PROTOCOL_VERSION, Hello


class CentralInProcess(Protocol):
    """A central that is reached without a socket, such as LocalCentral."""

    def transport(self) -> Transport:
        """Return a new connection to this central."""


TAKEOVER = 30.0
"""The least patience (s) of a connection to one of several centrals: another one may take over."""

CentralAddress = str | CentralInProcess | None
"""A ZeroMQ address, a central in this process, or None: $TCA_CENTRAL or the default socket."""


def open_connection(
    central: CentralAddress,
    hello: Hello,
    patience: float,
    is_stopped: Callable[[], bool] = lambda: False,
    attachments: LastingAttachments | None = None,
    *,
    logs_wait: bool = False,
) -> Connection:
    """Open a connection and return it when central has welcomed it.

    With *logs_wait*, a wait for central of more than a second is logged. Raises CentralLost if
    central does not answer within *patience* seconds.
    """
    check(f"'{hello.module}'", CENTRAL, central=central)
    if central is None or isinstance(central, str):
        socket_transport = DealerTransport(default_endpoint() if central is None else central)
        transport: Transport = socket_transport
        hello = msgspec.structs.replace(hello, pulse=socket_transport.pulse)
    else:
        transport = central.transport()
    connection = Connection(transport, Session(hello, attachments), patience=patience)
    try:
        connection.open(is_stopped, logs_wait=logs_wait)
        if transport.has_others:
            connection.wait_loop.patience = max(patience, TAKEOVER)
    except BaseException:
        connection.drop()
        raise
    return connection


def hello(
    module: str,
    connection: int = 0,
    resource: str = "",
    incarnation: str = "",
    hung_after: float = 0.0,
    *,
    cancels_on_leave: bool = False,
) -> Hello:
    """Return the Hello with which a connection introduces itself.

    *incarnation* names one run of the module; "" stands for a new run.
    """
    return Hello(
        0,
        PROTOCOL_VERSION,
        module,
        incarnation or token_hex(16),
        connection,
        resource,
        process=f"{socket.gethostname()}:{os.getpid()}",
        prefetch=PREFETCH if resource else 0,
        hung_after=hung_after,
        cancels_on_leave=cancels_on_leave,
    )
