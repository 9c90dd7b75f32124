"""What an entry of the journal came from: one type a kind of cause."""

import msgspec

from tca_wire.vocabulary import Due


class _Cause(msgspec.Struct, frozen=True, array_like=True):
    """What all causes share: an array whose first element is the kind."""


class Request(_Cause, frozen=True, tag="request"):
    """A connection of a module sent something."""

    module: str
    """Its name; "?" if it has not said hello."""
    connection: int
    """Which of the module's connections: 0 is its own, the others handle messages."""
    number: int
    """Of the request, as the connection counts them (0: it wants no answer)."""
    message: str
    """Which message of the protocol: "Send", "Kill"; "" for bytes that are none."""
    origin: int = 0
    """The delivery whose handler asked, while it ran (0: code outside of handlers did)."""


class TimeOver(_Cause, frozen=True, tag="time"):
    """Something was due."""

    due: Due
    about: int = 0
    """The task, or of a claim its id; 0 for none."""


class ConnectionLost(_Cause, frozen=True, tag="lost"):
    """A connection of a module broke."""

    module: str
    connection: int


Cause = Request | TimeOver | ConnectionLost
