"""Errors of the daemon.

RequestError         a module asked for something that can't be done: it is refused, nothing of it remains
CentralError         central cannot start or go on: the address is taken, the journal can't be written
"""

from tca_wire.vocabulary import Refusal


class RequestError(Exception):
    """A module's request cannot be done. Raised before anything has changed, or after everything was undone."""

    def __init__(self, refusal: Refusal, text: str) -> None:
        super().__init__(text)
        self.refusal = refusal
        self.text = text


class CentralError(Exception):
    """Central cannot start or go on; the text says what, which and what to do."""
