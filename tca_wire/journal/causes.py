"""The causes of the journal's entries: one type for each kind."""

import msgspec

from tca_wire.vocabulary import Due


class _Cause(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The base of all causes: an array whose first element is the kind."""


class Request(_Cause, frozen=True, tag="request"):
    """A connection of a module sent something."""

    module: str
    """Its name; "?" if it has not said hello."""
    connection: int
    """The module's connection: 0 is its own, the others handle messages."""
    number: int
    """The request's number on its connection (0: it wants no answer)."""
    message: str
    """The message of the protocol: "Send", "Kill"; "" for bytes that are none."""
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


class Administrator(_Cause, frozen=True, tag="keeper"):
    """Whoever runs central did something: it was started again, or keys have changed."""


Cause = Request | TimeOver | ConnectionLost | Administrator
