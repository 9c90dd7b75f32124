"""Failures that nobody has to declare: central raises them, or the module library where a handler
went wrong.
"""

MODULE_LOST = "module lost"
"""The module that handled a message is gone."""

UNCERTAIN = "uncertain"
"""Whether a handler did what it had to is not known: its module did not come back when central did.
A kind of "module lost".
"""

HANDLER_ERROR = "handler error"
"""A handler let an error pass. What failed elsewhere, and it let pass, is a kind of this."""

BAD_DATA = "bad data"
"""A handler's data or result does not fit the declaration."""

TIMEOUT = "timeout"
OVERLOAD = "overload"
DEADLOCK = "deadlock"

REJECTED = "rejected"
"""A handler did not accept a task, or had no time for it."""

FORGOTTEN = "forgotten"
"""The LaterReply of a handler was dropped without an answer: a kind of "handler error"."""

LOCK_LOST = "lock lost"
"""A lock or reservation was taken away from a task that still counted on it."""

CANCELLED = "cancelled"
"""An asynchronous handler was cancelled: a kind of "handler error"."""

NOT_BY_CHOICE = frozenset(
    (MODULE_LOST, UNCERTAIN, HANDLER_ERROR, BAD_DATA, TIMEOUT, OVERLOAD, DEADLOCK, LOCK_LOST)
)
"""An exception handler that fails with one of these, or a kind of them, has decided nothing."""
