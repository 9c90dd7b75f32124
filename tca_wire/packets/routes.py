"""Headers between modules and central about direct messages: their routes and outcomes.

headers.py lists all headers; docs/reference/protocol.md explains the exchange.
"""

from typing import Annotated

from tca_wire.packets.parts import MANY, WireArray
from tca_wire.vocabulary import Outcome

MOST_NOTES = 1000
"""The limit for notes in one report."""
MOST_LOST = 1_000_000_000
"""The limit for messages in one loss."""


class Entrance(WireArray, frozen=True):
    """A slot's entrance for direct messages: the ZeroMQ address of a ROUTER socket, and its key.

    In a slot's Hello the key is the slot's secret. Central derives licences from it (licences.py)
    for the senders, and never shares the key itself. It is in the log of inputs, but in no journal.
    """

    endpoint: str
    key: str
    curve: str = ""
    """The public key of the socket, if that uses CURVE. A sender then needs a key pair, too."""


class Note(WireArray, frozen=True):
    """The note that a slot has handled a direct message."""

    message: str
    sender: str
    """The module that sent it, by central's name for it."""
    origin: int
    """The delivery whose handler sent it (0: none)."""
    size: int
    """The bytes of its data."""
    ago: float
    """Seconds between the end of its handler and this report."""
    seconds: float
    """The time that its handler took."""
    outcome: Outcome = Outcome.DONE
    failure: str = ""


class Loss(WireArray, frozen=True):
    """The number of direct informs that may have been lost; with message "", of lost notes."""

    message: str
    number: int


class Noted(WireArray, frozen=True, tag=80):
    """The outcomes of direct messages, for the journal."""

    notes: Annotated[list[Note], MANY]
    losses: Annotated[list[Loss], MANY] = []


class WatchEntrance(WireArray, frozen=True, tag=81):
    """Send EntranceGone when this entrance is removed, or at once if it does not exist."""

    endpoint: str


class Route(WireArray, frozen=True, tag=82):
    """Send this message to one of these entrances from now on; through central if there is none."""

    message: str
    entrances: list[Entrance] = []


class Barred(WireArray, frozen=True, tag=46):
    """These licences of senders are revoked, at all entrances."""

    numbers: list[str]


class EntranceGone(WireArray, frozen=True, tag=83):
    """The slot of an entrance has left or (*lost*) was lost: it answers no further queries.

    A slot that left still answers what it has started, and says Closing to the senders of other
    queries.
    """

    endpoint: str
    text: str
    lost: bool = True
