"""What something waits for, as data: the kinds of waits, and one wait as people are told of it.

Central (for `tca status` and the texts of errors) and the tools (for all that explains a run) use the same kinds.
The words stand in text/waits_in_words.py.
"""

from enum import StrEnum

import msgspec


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
    RESUME = "resume"  # it is suspended
    RECOVERY = "recovery"  # an exception handler decides what becomes of it
    PRESENCE = "presence"  # a module waits until messages are handled
    CONDITION = "condition"  # a monitor watches
    RUNNING = "running"  # a handler runs, and waits for nothing
    LOCKED = "locked"  # somebody has the resource for himself
    CIRCLE = "circle"  # it waits for itself, by way of others


class WaitFor(msgspec.Struct, frozen=True, omit_defaults=True):
    """One thing that is waited for, as people are told of it. Fields that do not apply have their defaults."""

    kind: WaitKind
    number: int = 0
    """The task, message or claim that is waited for. Of RUNNING 0 is the waiting task's own handler."""
    name: str = ""
    """What that is called: "move leg"; of LOCK and LOCKED "lock" or "reservation"; of CONDITION the query that is
    asked, "" of a demon monitor.
    """
    moment: int = 0
    """What the task has to reach (a Moment); 0: its end, however it comes."""
    module: str = ""
    """Whose resource, or handler, it is; of LOCKED, and of LOCK among what keeps a resource: who has or wants it. Of
    RESUME who suspended the task, of LISTENER who added the wiretap.
    """
    resource: str = ""
    seconds: float | None = None
    """Of DELAY: when it is over, on the journal's clock; after a point that has not come: how long after."""
    holds: bool | None = None
    """Of CONDITION: how the last test came out; None: there was none."""
    answered: int = 0
    """Of REPLY to a multi-query: how many have answered; *because* has the others."""
    more: int = 0
    """How many more of the same kind and moment are waited for, which are not told one by one; of RESOURCE how many
    others would do as well.
    """
    because: "tuple[WaitFor, ...]" = ()
    """What keeps that busy, in turn. Of RESOURCE and LOCK: who is in it (RUNNING), has it (LOCKED) or wants it first
    (LOCK), or that it has no slot now (HANDLER). Of LOCKED and of such a LOCK: for which message (RUNNING; TASK, if it
    is not handled any more). Of REPLY: where the query is (HANDLER, RESOURCE, RUNNING). Of RUNNING: what it waits for.
    """


class Waiter(msgspec.Struct, frozen=True, omit_defaults=True):
    """Somebody who waits, as central tells it: a task or message, one that a handler is at, or a whole module."""

    number: int = 0
    """The task or message; 0: what the module does outside of handlers."""
    name: str = ""
    module: str = ""
    """Where it is handled: the handler waits."""
    more: int = 0
    """How many more wait behind it."""
    seconds: float = 0.0
    """How long it has waited."""
    killed: str = ""
    """Why the task was killed; it waits for its end."""
    waits: tuple[WaitFor, ...] = ()
    end: WaitFor | None = None
    """What it waits for in the end, where that is something else."""


class CommonEnd(msgspec.Struct, frozen=True, omit_defaults=True):
    """Something that so many tasks wait for in the end."""

    tasks: int
    wait: WaitFor
