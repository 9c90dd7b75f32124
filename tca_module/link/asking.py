"""Questions that central answers by itself, at once."""

from tca_module.errors import Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.session.request import Request
from tca_wire.packets.headers import ToCentral


def ask(
    connection: Connection, header: ToCentral, what: str, body: bytes = b"",
    within: float | None = ACKNOWLEDGED_WITHIN,
) -> bytes:  # fmt: skip
    """The body of central's answer. Raises Timeout if it does not come *within* so many seconds."""
    return answered(connection, header, what, body, within).answers[-1][1]


def answered(
    connection: Connection, header: ToCentral, what: str, body: bytes = b"",
    within: float | None = ACKNOWLEDGED_WITHIN,
) -> Request:  # fmt: skip
    """The question, with its answer. Raises Timeout if that does not come *within* so many seconds."""
    request = connection.request(header, body, wants_answer=True, is_awaited=True)
    if not connection.wait(request, within, what):
        connection.abandon(request)
        raise Timeout(f"{what} was not answered within {within:g} s, though central is alive: it is overloaded")
    return request
