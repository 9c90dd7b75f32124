"""Headers and packets of direct messages between two modules.

The sender connects to a slot's entrance (routes.py), greets with its key, and numbers what it
sends. The packets are made as those to and from central are (codec.py).
"""

from tca_wire.packets.codec import unpacker
from tca_wire.packets.headers import Answer, Closing, GiveUp, Refused, Unknown
from tca_wire.packets.parts import Numbered, WireArray


class Greet(WireArray, frozen=True, tag=96):
    """First message of a sender, and again when it doubts that its messages have arrived. Answered
    by Greeting.
    """

    version: int
    key: str
    session: str
    """Names this sender's way to this entrance, across reconnects."""
    module: str
    newest: int = 0
    """The highest number that the sender has used."""
    is_first: bool = True
    """It was never answered a Greet in this session."""


class Direct(Numbered, frozen=True, tag=97):
    """Handle this message; the body is its data. A query is answered by Answer or Refused, an
    inform by nothing.
    """

    message: str
    origin: int = 0
    """The delivery that the sender is handling (0: none)."""


class Greeting(WireArray, frozen=True, tag=98):
    """Of the sender's numbers up to *newest*, *missing* ones never arrived; *open* ones are queries
    that will be answered. Answers to any others were given, or are forgotten.
    """

    newest: int
    missing: list[int] = []
    open: list[int] = []


class Begun(Numbered, frozen=True, tag=99):
    """All messages up to this number have been begun with; before Closing: or are counted as
    lost.
    """


ToEntrance = Greet | Direct | GiveUp
FromEntrance = Greeting | Begun | Answer | Refused | Unknown | Closing

unpack_to_entrance = unpacker(ToEntrance, "a message to a slot")
"""The items of a packet that came to an entrance. Raises ProtocolError, whatever the bytes."""

unpack_from_entrance = unpacker(FromEntrance, "a message from a slot")
"""The items of a packet that came from an entrance. Raises ProtocolError, whatever the bytes."""
