"""Headers and packets of direct messages between two modules.

The sender connects to a slot's entrance (routes.py), greets with its key, and numbers its messages.
The packets are built like those to and from central (codec.py).
"""

from tca_wire.packets.codec import unpacker
from tca_wire.packets.headers import Answer, Closing, GiveUp, Refused, Unknown
from tca_wire.packets.parts import Numbered, WireArray


class Greet(WireArray, frozen=True, tag=96):
    """First message of a sender, sent again when it suspects a loss. Answered by Greeting."""

    version: int
    key: str
    session: str
    """The id of this sender's path to this entrance, across reconnects."""
    module: str
    newest: int = 0
    """The highest number that the sender has used."""
    is_first: bool = True
    """No Greet of this session was answered before."""


class Direct(Numbered, frozen=True, tag=97):
    """Handle this message; the body is its data.

    A query is answered by Answer or Refused, an inform is not answered.
    """

    message: str
    origin: int = 0
    """The delivery that the sender is handling (0: none)."""


class Greeting(WireArray, frozen=True, tag=98):
    """The state of the sender's messages up to *newest*.

    *missing* messages never arrived. *open* messages are queries that will be answered. The answers
    to all other queries were sent, or are forgotten.
    """

    newest: int
    missing: list[int] = []
    open: list[int] = []


class Begun(Numbered, frozen=True, tag=99):
    """All messages up to this number have started or, if Closing follows, are counted as lost."""


ToEntrance = Greet | Direct | GiveUp
FromEntrance = Greeting | Begun | Answer | Refused | Unknown | Closing

unpack_to_entrance = unpacker(ToEntrance, "a message to a slot")
"""The items of a packet that came to an entrance. Raises ProtocolError for any invalid bytes."""

unpack_from_entrance = unpacker(FromEntrance, "a message from a slot")
"""The items of a packet from an entrance. Raises ProtocolError for any invalid bytes."""
