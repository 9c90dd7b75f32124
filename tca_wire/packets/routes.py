"""Headers between modules and central about direct messages: their routes and outcomes.

The lists of all headers are in headers.py; docs/protocol.md tells the story.
"""

from typing import Annotated

from tca_wire.packets.parts import MANY, WireArray
from tca_wire.vocabulary import Outcome

MOST_NOTES = 1000
"""Notes in one report."""
MOST_LOST = 1_000_000_000
"""Messages in one loss."""


class Entrance(WireArray, frozen=True):
    """A slot's entrance for direct messages: the ZeroMQ address of a ROUTER socket, and its key.

    In a slot's Hello the key is a secret of the slot's. Central gives those who send such messages
    licences that it makes of it (licences.py), and nothing to anybody else; no journal has them,
    but the log of inputs.
    """

    endpoint: str
    key: str
    curve: str = ""
    """The public key of the socket, if it asks for CURVE: whoever connects needs it, and shows a
    pair of its own.
    """


class Note(WireArray, frozen=True):
    """The note that a slot has handled a direct message."""

    message: str
    sender: str
    """The module that sent it, by the name that central gave it."""
    origin: int
    """The delivery whose handler sent it (0: none)."""
    size: int
    """Bytes of its data."""
    ago: float
    """Seconds between the end of its handler and this report."""
    seconds: float
    """The time that its handler took."""
    outcome: Outcome = Outcome.DONE
    failure: str = ""


class Loss(WireArray, frozen=True):
    """The number of informs sent directly that were lost, or may have been; of message "": notes
    that were not kept.
    """

    message: str
    number: int


class Noted(WireArray, frozen=True, tag=80):
    """The outcomes of direct messages, for the journal."""

    notes: Annotated[list[Note], MANY]
    losses: Annotated[list[Loss], MANY] = []


class WatchEntrance(WireArray, frozen=True, tag=81):
    """Say EntranceGone when this entrance is gone, or at once if it is not there."""

    endpoint: str


class Route(WireArray, frozen=True, tag=82):
    """From now on send this message to one of these entrances; if there is none, through
    central.
    """

    message: str
    entrances: list[Entrance] = []


class Barred(WireArray, frozen=True, tag=46):
    """These licences of senders are not valid any more, at any entrance."""

    numbers: list[str]


class EntranceGone(WireArray, frozen=True, tag=83):
    """The slot of an entrance is gone: queries that it has not answered will not be. If it was not
    *lost* but left, it answers what it has begun with, and says Closing to those whose queries it
    has not.
    """

    endpoint: str
    text: str
    lost: bool = True
