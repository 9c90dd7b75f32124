"""Failures that need no declaration: central raises them, or the module library."""

from difflib import get_close_matches

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


_NEAR = 0.85
"""The least likeness of a misspelt name: one wrong letter in seven, or two swapped ones."""


def misspelt(name: str) -> str:
    """Return the built-in failure that *name* nearly spells; "" for another name."""
    known = {_letters(one): one for one in sorted(BUILT_IN)}
    near = get_close_matches(_letters(name), known, n=1, cutoff=_NEAR)
    return known[near[0]] if near and name not in BUILT_IN else ""


def _letters(name: str) -> str:
    return "".join(letter for letter in name.casefold() if letter.isalnum())
