"""Questions that central itself answers, at once."""

from tca_module.errors import Timeout
from tca_module.link.connection import ACKNOWLEDGED_WITHIN, Connection
from tca_module.session.request import Request
from tca_wire.packets.headers import ToCentral


def ask(
    connection: Connection, header: ToCentral, what: object, body: bytes = b"",
    within: float | None = ACKNOWLEDGED_WITHIN,
) -> bytes:  # fmt: skip
    """The immediate answer of central itself. Raises Timeout if it does not come *within* so many seconds."""
    return answered(connection, header, what, body, within).answers[-1][1]


def answered(
    connection: Connection, header: ToCentral, what: object, body: bytes = b"",
    within: float | None = ACKNOWLEDGED_WITHIN,
) -> Request:  # fmt: skip
    """A question that central itself answers, with the answer. Raises what ``ask`` does."""
    request = connection.request(header, body, wants_answer=True, is_awaited=True)
    if not connection.wait(request, within, what):
        connection.abandon(request)
        within = within or 0.0
        raise Timeout(f"{what} was not answered within {within:g} s, {connection.line.why_late(within)}")
    return request
