"""The client: what a script that handles nothing sends with."""

from types import TracebackType
from typing import Any, Literal, Self

import msgspec

from tca_module import checks
from tca_module.checks import check, one_of
from tca_module.errors import CentralLost, MisuseError, NoCentral, Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, PATIENCE, Connection
from tca_module.link.opening import CentralAddress, hello, new_incarnation, open_connection
from tca_module.sending.sender import Sender
from tca_wire.packets.headers import Ask

Topic = Literal["status", "modules", "messages", "tree", "variables", "load", "attached"]


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
        check("status()", one_of(Topic), topic=topic)
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
            raise MisuseError("this client is closed: use it inside its 'with' block, or connect() again")
        return self._link


def connect(name: str = "script", central: CentralAddress = None, patience: float = PATIENCE / 2) -> Client:
    """Connect to central from a program that is no module.

    Raises CentralLost if none answers in *patience* seconds: in a script that nobody catches it ends the program with
    one line and exit code 1.
    """
    check("connect()", checks.NAME, name=name)
    check("connect()", checks.PATIENCE, patience=patience)
    greeting = hello(name, new_incarnation())
    try:
        return Client(open_connection(central, greeting, patience))
    except CentralLost as error:
        raise NoCentral(str(error)) from None
