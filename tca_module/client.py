"""Client: a script that handles nothing sends with it."""

from typing import Any, Literal, Self, get_args

import msgspec

from tca_module import checks
from tca_module.checks import check
from tca_module.errors import CentralLost, MisuseError, NoCentral
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, PATIENCE, Connection, ask
from tca_module.link.opening import CentralAddress, hello, open_connection
from tca_module.sending.sender import Sender
from tca_wire.packets.headers import Ask

Topic = Literal["status", "modules", "messages", "tree", "variables", "load", "attached"]
_TOPIC = checks.ArgumentKind(f"one of {', '.join(get_args(Topic))}", lambda topic: topic in get_args(Topic))


class Client(Sender):
    """A connection of a program that handles nothing; it sends under the root. For one thread."""

    def __init__(self, connection: Connection) -> None:
        super().__init__()
        self._link: Connection | None = connection
        connection.root_sender = self

    @property
    def name(self) -> str:
        """The name under which central knows this client."""
        return self._connection().session.module

    @property
    def address(self) -> str:
        """Central's address."""
        return self._connection().transport.address

    def status(self, topic: Topic = "status", *, timeout: float | None = ACKNOWLEDGED_WITHIN) -> Any:
        """Central's report on a topic, as plain values: "status", "modules", "messages", "tree", "variables", "load"
        (how busy everything is, and the longest waits) or "attached" (exception handlers, wiretaps and monitors, at
        most 10,000 of each). Raises Timeout.
        """
        check("status()", _TOPIC, topic=topic)
        answer = ask(self._connection(), Ask(0, topic), f"the question for {topic}", within=timeout)
        return msgspec.msgpack.decode(answer)

    def close(self) -> None:
        """Say goodbye to central; twice does no harm."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connection(self) -> Connection:
        if self._link is None:
            raise MisuseError("this client is closed: use it inside its 'with' block, or connect() again")
        return self._link


def connect(name: str = "script", central: CentralAddress = None, patience: float = PATIENCE / 2) -> Client:
    """Connect to central from a program that is no module.

    Raises CentralLost if no central answers within *patience* seconds; uncaught it ends the program with one line and
    exit code 1.
    """
    check("connect()", checks.NAME, name=name)
    check("connect()", checks.PATIENCE, patience=patience)
    try:
        return Client(open_connection(central, hello(name), patience))
    except CentralLost as error:
        raise NoCentral(str(error)) from None
