"""Failures that need no declaration: central raises them, or the module library."""

MODULE_LOST = "module lost"
"""The module that handled the message is lost."""

UNCERTAIN = "uncertain"
"""It is unknown whether the handler did its work: a kind of "module lost".

The handler's module did not reconnect after a restart of central.
"""

HANDLER_ERROR = "handler error"
"""A handler raised a Python error.

A failure that the handler received and did not catch is a kind of "handler error".
"""

BAD_DATA = "bad data"
"""A handler's data or result does not fit the declaration."""

TIMEOUT = "timeout"
OVERLOAD = "overload"
DEADLOCK = "deadlock"

REJECTED = "rejected"
"""A handler did not accept a task, or was busy."""

FORGOTTEN = "forgotten"
"""A handler's LaterReply was dropped without an answer: a kind of "handler error"."""

LOCK_LOST = "lock lost"
"""A lock or reservation was taken from a task that still needed it."""

CANCELLED = "cancelled"
"""An asynchronous handler was cancelled: a kind of "handler error"."""

NOT_BY_CHOICE = frozenset(
    (MODULE_LOST, UNCERTAIN, HANDLER_ERROR, BAD_DATA, TIMEOUT, OVERLOAD, DEADLOCK, LOCK_LOST)
)
"""An exception handler that fails with one of these, or a kind of one, has decided nothing."""

BUILT_IN = NOT_BY_CHOICE | {REJECTED, FORGOTTEN, CANCELLED}
"""The names of all these failures."""


def misspelt(name: str) -> str:
    """Return the built-in failure that *name* differs from in case and separators only; else ""."""
    letters = _letters(name)
    return next((one for one in BUILT_IN if name != one and letters == _letters(one)), "")


def _letters(name: str) -> str:
    return "".join(letter for letter in name.casefold() if letter.isalnum())
