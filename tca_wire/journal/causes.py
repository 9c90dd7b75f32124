"""The causes of the journal's entries: one type for each kind."""

import msgspec

from tca_wire.vocabulary import Due


class _Cause(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The base of all causes: an array whose first element is the kind."""


class Request(_Cause, frozen=True, tag="request"):
    """A connection of a module sent a request."""

    module: str
    """Its name; "?" before its hello."""
    connection: int
    """The number of the module's connection: 0 is its own, the others handle messages."""
    number: int
    """The request's number on its connection (0: no answer wanted)."""
    message: str
    """The header: "Send", "Kill"; "" for invalid bytes."""
    origin: int = 0
    """The delivery whose running handler sent it (0: code outside of handlers)."""


class TimeOver(_Cause, frozen=True, tag="time"):
    """A timer was due."""

    due: Due
    about: int = 0
    """The task or claim of the timer (0: none)."""


class ConnectionLost(_Cause, frozen=True, tag="lost"):
    """A module's connection broke."""

    module: str
    connection: int


class Administrator(_Cause, frozen=True, tag="keeper"):
    """The operator of central, its *keeper*, restarted it or changed keys."""


Cause = Request | TimeOver | ConnectionLost | Administrator
