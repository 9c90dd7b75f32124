"""What something waits for, as data: the kinds of waits, and one wait as people are told of it.

Central (for `tca status` and the texts of errors) and the tools (for all that explains a run) use the same kinds.
The words stand in text/waits_in_words.py and, for the browser, in the page.
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
    RUNNING = "running"  # no wait: its handler runs


class WaitFor(msgspec.Struct, frozen=True, omit_defaults=True):
    """One thing that is waited for, as people are told of it. Fields that do not apply have their defaults."""

    kind: WaitKind
    number: int = 0
    """The task, message or claim that is waited for."""
    name: str = ""
    """What that is called: "move leg"; of HANDLER the message that nobody handles."""
    moment: int = 0
    """What the task has to reach (a Moment)."""
    module: str = ""
    """Whose resource it is; who has the lock, or suspended the task."""
    resource: str = ""
    seconds: float | None = None
    """Of DELAY: when it is over, on the journal's clock; after a point that has not come: how long after."""
    more: int = 0
    """How many more of the same kind and moment are waited for, which are not told one by one."""
    because: "tuple[WaitFor, ...]" = ()
    """What keeps that busy, in turn: who is in the resource, who has the lock, where the query is."""
