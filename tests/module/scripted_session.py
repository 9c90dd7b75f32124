"""A session without a connection. Tests hand it central's headers, and take the module's headers
from it.
"""

from tca_module.session.request import Request
from tca_module.session.session import HELLO_NUMBER, Session
from tca_wire.packets.headers import (
    PROTOCOL_VERSION,
    Hello,
    Send,
    ToCentral,
    ToModule,
    Welcome,
)
from tca_wire.packets.parts import HandlerFormat, MessageFormat
from tca_wire.vocabulary import MessageClass

HELLO = Hello(HELLO_NUMBER, PROTOCOL_VERSION, "legs", "run 1")
A_GOAL = Send(0, "walk")
WALK = MessageFormat("walk", MessageClass.GOAL, "{}")
HANDLES_WALK = HandlerFormat("walk", "legs")


def pop_headers(session: Session) -> list[ToCentral]:
    """Return the headers that the session has to send. They count as sent afterwards."""
    outgoing = [header for header, _ in session.outgoing]
    session.outgoing.clear()
    return outgoing


def receive(session: Session, *heard: ToModule, now: float = 0.0) -> None:
    for header in heard:
        session.receive(header, b"", now)


def send_requests(session: Session, *asked: ToCentral, wants_answer: bool = True) -> list[Request]:
    """Make requests, and count them as sent."""
    requests = [session.request(one, wants_answer=wants_answer) for one in asked]
    pop_headers(session)
    return requests


def welcome(epoch: str = "one") -> Welcome:
    return Welcome(HELLO_NUMBER, 1, "legs", epoch)
