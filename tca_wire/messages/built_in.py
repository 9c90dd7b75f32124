"""Failures that need no declaration of yours: central and the library raise them.

Their names are in failures.py.
"""

from tca_wire.messages import failures
from tca_wire.messages.declarations import Failure

MODULE_LOST = Failure(failures.MODULE_LOST)
"""The module that handled the message is lost.

Cause: its process ended, or was silent for longer than ``--lost-after``.

Remedy: retry the task, if its handler may run twice. See the module's output.
"""

UNCERTAIN = Failure(failures.UNCERTAIN, kind_of=MODULE_LOST)
"""It is unknown whether the handler did its work.

Cause: its module and central went away together. It is a kind of "module lost".

Remedy: find out in the world what was done, then retry or resolve.
"""

HANDLER_ERROR = Failure(failures.HANDLER_ERROR)
"""A handler raised a Python error.

Cause: a mistake in the handler, or a device that raised an error.

Remedy: read the traceback in the module's log. Raise a declared failure for what you expect.
"""

FORGOTTEN = Failure(failures.FORGOTTEN, kind_of=HANDLER_ERROR)
"""A handler's LaterReply was dropped without an answer.

Cause: no variable of the module refers to the LaterReply. It is a kind of "handler error".

Remedy: keep a reference until you call ``reply()`` or ``fail()``.
"""

CANCELLED = Failure(failures.CANCELLED, kind_of=HANDLER_ERROR)
"""An asynchronous handler was cancelled.

Cause: code of the handler cancelled its own asyncio task. It is a kind of "handler error".

Remedy: catch ``asyncio.CancelledError`` where you cancel.
"""

BAD_DATA = Failure(failures.BAD_DATA)
"""A handler's data or result does not fit the declaration.

Cause: the handler returned a value of another type, or has another version of the message.

Remedy: return the declared type. Share one file of declarations.
"""

TIMEOUT = Failure(failures.TIMEOUT)
"""A deadline was missed, or an attempt or a wait took too long.

Cause: the work or a wait before it took longer than ``deadline=``, ``attempt_timeout=`` or a
``timeout=`` of the handler.

Remedy: see what the task waited for with 'tca status', then give more time or retry.
"""

OVERLOAD = Failure(failures.OVERLOAD)
"""A queue or central's memory is full.

Cause: messages come faster than they are handled, or a newer message displaced this one.

Remedy: send less often, add slots with ``capacity=``, or bound the queue with ``pending=``.
"""

DEADLOCK = Failure(failures.DEADLOCK)
"""The task waits in a cycle that can never end.

Cause: handlers wait for each other, or for locks that they hold.

Remedy: break the cycle that the text names: more capacity, another resource, or one order of locks.
"""

REJECTED = Failure(failures.REJECTED)
"""A handler did not accept a task, or was busy.

Cause: the handler raised ``task.rejected()``, or its resource has ``when_busy="reject"``.

Remedy: send the task later, or with other data. The text gives the reason.
"""

LOCK_LOST = Failure(failures.LOCK_LOST)
"""A lock or reservation was taken from a task that still needed it.

Cause: its module or central was restarted, or an operator called ``unlock``.

Remedy: check the state of the device, lock it again, then continue.
"""
