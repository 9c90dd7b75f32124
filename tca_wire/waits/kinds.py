"""Waits as data: their kinds, and one wait for display.

Central (for `tca status` and the texts of errors) and the tools (for explanations of a run) use the
same kinds. The words are in text/waits_in_words.py.
"""

from collections.abc import Sequence
from enum import StrEnum

import msgspec
from msgspec.structs import replace

NAMED = 3
"""The number of waits that are listed for one kind."""


class WaitKind(StrEnum):
    """The reason why something does not continue."""

    CONSTRAINT = "constraint"  # a point of another task must be reached first
    PARENT = "parent"  # a point of its parent must be reached first
    DELAY = "delay"  # a time must pass
    LISTENER = "listener"  # the listener of a wiretap holds it
    SUBTASK = "subtask"  # a descendant has not reached that moment
    RESOURCE = "resource"  # it is queued: the resource is busy or locked
    HANDLER = "handler"  # no module handles it
    REPLY = "reply"  # its handler blocks until a query is answered
    TASK = "task"  # its handler blocks until a task reaches a moment
    LOCK = "lock"  # its handler blocks until it gets a lock
    CHANGE = "change"  # its handler blocks until a task changes its state or reports something
    RESUME = "resume"  # it is suspended
    RECOVERY = "recovery"  # an exception handler decides on it
    PRESENCE = "presence"  # a module waits until messages are handled
    CONDITION = "condition"  # a monitor watches
    RUNNING = "running"  # a handler runs, and waits for nothing
    LOCKED = "locked"  # the resource is locked
    CIRCLE = "circle"  # it waits for itself, by way of others


class WaitFor(msgspec.Struct, frozen=True, omit_defaults=True):
    """One wait, for display. Fields that do not apply have their defaults."""

    kind: WaitKind
    number: int = 0
    """The task, message or claim that is waited for. For RUNNING, 0 is the task's own handler."""
    name: str = ""
    """Its name: "move leg".

    For LOCK and LOCKED it is "lock" or "reservation". For CONDITION it is the query, "" for a demon
    monitor. For CHANGE of any task of a message it is "any move leg".
    """
    moment: int = 0
    """The moment that the task has to reach (a Moment); 0: its end, whatever its outcome."""
    module: str = ""
    """The module of the resource or handler.

    For LOCKED, and for LOCK in *because*, it is the lock's holder or requester. For RESUME it is
    the module that suspended the task, for LISTENER the module that added the wiretap.
    """
    resource: str = ""
    seconds: float | None = None
    """A time on the journal's clock: the end of a DELAY, or the start of a suspension (RESUME).

    For a delay after a point that is not reached, it is the length of the delay instead.
    """
    since_birth: bool = False
    """For RESUME: the task was created suspended."""
    holds: bool | None = None
    """For CONDITION: the result of the last test; None: not tested yet."""
    is_owed: bool = False
    """For RUNNING: the handler has returned, and owes its later reply."""
    answered: int = 0
    """For REPLY to a multi-query: the number of answers; *because* has the missing ones."""
    more: int = 0
    """The number of further waits of this kind and moment; for RESOURCE, of further resources."""
    because: "tuple[WaitFor, ...]" = ()
    """The causes in turn.

    - RESOURCE, LOCK: user (RUNNING), holder (LOCKED), earlier claim (LOCK), no slot (HANDLER).
    - LOCKED, and LOCK in *because*: its message (RUNNING; TASK, if it is no longer handled).
    - REPLY: the query's place (HANDLER, RESOURCE, RUNNING).
    - RUNNING: its own waits.
    """


class Waiter(msgspec.Struct, frozen=True, omit_defaults=True):
    """A waiter in central's reports: a task or message, with its handler, or a whole module."""

    number: int = 0
    """The task or message; 0: the code of the module outside of handlers."""
    name: str = ""
    module: str = ""
    """The module whose handler waits."""
    more: int = 0
    """The number of others that wait behind it."""
    seconds: float = 0.0
    """The time that it has waited."""
    killed: str = ""
    """The reason why the task was killed, if it waits for its end."""
    waits: tuple[WaitFor, ...] = ()
    end: WaitFor | None = None
    """The last cause of its waits, if it differs from them."""


class CommonEnd(msgspec.Struct, frozen=True, omit_defaults=True):
    """The last cause of the waits of several tasks; *tasks* is their number."""

    tasks: int
    wait: WaitFor


def first_ones(waits: Sequence[WaitFor], number: int) -> list[WaitFor]:
    """Return the first NAMED of *number* similar waits. The last one counts the waits left out."""
    named = list(waits[:NAMED])
    if more := number - len(named):
        named[-1] = replace(named[-1], more=named[-1].more + more)
    return named
