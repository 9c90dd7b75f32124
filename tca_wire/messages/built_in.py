"""Failures that need no declaration of yours: central and the library raise them.

Their names are in failures.py.
"""

from tca_wire.messages import failures
from tca_wire.messages.declarations import Failure

MODULE_LOST = Failure(failures.MODULE_LOST)
"""The module that handled the message is lost."""

UNCERTAIN = Failure(failures.UNCERTAIN, kind_of=MODULE_LOST)
"""It is unknown whether the handler did its work."""

HANDLER_ERROR = Failure(failures.HANDLER_ERROR)
"""A handler raised a Python error."""

FORGOTTEN = Failure(failures.FORGOTTEN, kind_of=HANDLER_ERROR)
"""A handler's LaterReply was dropped without an answer."""

CANCELLED = Failure(failures.CANCELLED, kind_of=HANDLER_ERROR)
"""An asynchronous handler was cancelled."""

BAD_DATA = Failure(failures.BAD_DATA)
"""A handler's data or result does not fit the declaration."""

TIMEOUT = Failure(failures.TIMEOUT)
"""A deadline was missed, or an attempt or a wait took too long."""

OVERLOAD = Failure(failures.OVERLOAD)
"""A queue or central's memory is full."""

DEADLOCK = Failure(failures.DEADLOCK)
"""The task waits in a cycle that can never end."""

REJECTED = Failure(failures.REJECTED)
"""A handler did not accept a task, or was busy."""

LOCK_LOST = Failure(failures.LOCK_LOST)
"""A lock or reservation was taken from a task that still needed it."""
