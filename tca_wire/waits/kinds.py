"""Waits as data: their kinds, and one wait as shown to people.

Central (for `tca status` and the texts of errors) and the tools (for all that explains a run) use
the same kinds. The words stand in text/waits_in_words.py.
"""

from collections.abc import Sequence
from enum import StrEnum

import msgspec
from msgspec.structs import replace

NAMED = 3
"""Waits of one kind that are told one by one."""


class WaitKind(StrEnum):
    """Why something does not go on."""

    CONSTRAINT = "constraint"  # a point of another task has to come first
    PARENT = "parent"  # a point of its parent has to come first
    DELAY = "delay"  # time has to pass
    LISTENER = "listener"  # the listener of a wiretap holds it
    SUBTASK = "subtask"  # a task under it has not got so far
    RESOURCE = "resource"  # it is queued, and the resource is busy or kept by somebody
    HANDLER = "handler"  # no module handles it
    REPLY = "reply"  # its handler blocks until a query is answered
    TASK = "task"  # its handler blocks until a task reaches a moment
    LOCK = "lock"  # its handler blocks until it has a resource for itself
    CHANGE = (
        "change"  # its handler blocks until the state of a task changes, or it reports something
    )
    RESUME = "resume"  # it is suspended
    RECOVERY = "recovery"  # an exception handler decides on it
    PRESENCE = "presence"  # a module waits until messages are handled
    CONDITION = "condition"  # a monitor watches
    RUNNING = "running"  # a handler runs, and waits for nothing
    LOCKED = "locked"  # somebody has the resource for himself
    CIRCLE = "circle"  # it waits for itself, by way of others


class WaitFor(msgspec.Struct, frozen=True, omit_defaults=True):
    """One wait, as shown to people. Fields that do not apply have their defaults."""

    kind: WaitKind
    number: int = 0
    """The task, message or claim that is waited for. Of RUNNING 0 is the waiting task's own
    handler.
    """
    name: str = ""
    """Its name: "move leg"; of LOCK and LOCKED "lock" or "reservation"; of CONDITION the query that
    is asked, "" of a demon monitor; of CHANGE of no certain task "any move leg".
    """
    moment: int = 0
    """The moment that the task has to reach (a Moment); 0: its end, however it comes."""
    module: str = ""
    """The module of the resource or handler; of LOCKED, and of LOCK in *because*, the one that has
    or wants it. Of RESUME the one that suspended the task, of LISTENER the one that added the
    wiretap.
    """
    resource: str = ""
    seconds: float | None = None
    """Of DELAY: its end, on the journal's clock; after a point that has not come, its length. Of
    RESUME, as central tells it: the beginning of the suspension, on the journal's clock.
    """
    since_birth: bool = False
    """Of RESUME: the task was created suspended."""
    holds: bool | None = None
    """Of CONDITION: the result of the last test; None: there was none."""
    answered: int = 0
    """Of REPLY to a multi-query: the number of answers; *because* has the others."""
    more: int = 0
    """The number of further waits of this kind and moment, not listed one by one; of RESOURCE the
    number of others that would do as well.
    """
    because: "tuple[WaitFor, ...]" = ()
    """The causes in turn. Of RESOURCE and LOCK: its user (RUNNING), its holder (LOCKED), an earlier
    claim (LOCK), or that it has no slot now (HANDLER). Of LOCKED and of such a LOCK: the message
    that it is for (RUNNING; TASK, if it is not handled any more). Of REPLY: the query's place
    (HANDLER, RESOURCE, RUNNING). Of RUNNING: its own waits.
    """


class Waiter(msgspec.Struct, frozen=True, omit_defaults=True):
    """A waiter, as central reports it: a task or message, one with a handler, or a whole module."""

    number: int = 0
    """The task or message; 0: what the module does outside of handlers."""
    name: str = ""
    module: str = ""
    """The module that handles it: the handler waits."""
    more: int = 0
    """The number of others that wait behind it."""
    seconds: float = 0.0
    """The time that it has waited."""
    killed: str = ""
    """The reason why the task was killed; it waits for its end."""
    waits: tuple[WaitFor, ...] = ()
    end: WaitFor | None = None
    """The last cause of its waits, where that is something else."""


class CommonEnd(msgspec.Struct, frozen=True, omit_defaults=True):
    """The last cause of the waits of so many tasks."""

    tasks: int
    wait: WaitFor


def first_ones(waits: Sequence[WaitFor], number: int) -> list[WaitFor]:
    """The first of a *number* of alike waits. The last of them says how many more there are."""
    named = list(waits[:NAMED])
    if more := number - len(named):
        named[-1] = replace(named[-1], more=named[-1].more + more)
    return named
