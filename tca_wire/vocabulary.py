"""The words that headers and facts share: classes, outcomes, conditions and the like. Knows nothing
of their use.
"""

from enum import IntEnum, StrEnum
from typing import Self


class _WithTraits(StrEnum):
    """Words with traits: the attributes that a class declares are True for the members that name
    them.
    """

    def __new__(cls, word: str, *traits: str) -> Self:
        """A word with its traits as attributes, True or False."""
        assert set(traits) <= cls.__annotations__.keys(), f"{word}: unknown trait"
        member = str.__new__(cls, word)
        member._value_ = word
        for trait in cls.__annotations__:
            setattr(member, trait, trait in traits)
        return member


class MessageClass(_WithTraits):
    """The routing of a message, and whether it becomes a task (TCA 8.5, message classes): one row
    each.
    """

    is_task: bool
    """It becomes a node of the task tree."""
    is_goal: bool
    """Such a task expands into others and is planned; other tasks only act."""
    is_monitor: bool
    """Central itself carries such a task out."""
    has_reply: bool
    """Its handlers answer the sender."""
    fans_out: bool
    """Every handler gets a copy."""
    keeps_value: bool
    """Central keeps the newest value: it is set, not sent."""
    may_react: bool
    """Central may send it for a wiretap, a monitor or a kill."""
    has_condition: bool
    """Such a monitor tests by asking a query; one without is fired from outside."""
    is_outside_sequence: bool
    """Such a monitor watches over its siblings: it is in no order with them."""
    handles_failures: bool
    """It is attached to tasks, not sent."""

    INFORM = "inform", "may_react"
    QUERY = "query", "has_reply"
    BROADCAST = "broadcast", "fans_out", "may_react"
    MULTI_QUERY = "multi-query", "fans_out", "has_reply"
    GOAL = "goal", "is_task", "is_goal", "may_react"
    COMMAND = "command", "is_task", "may_react"
    EXCEPTION = "exception handler", "is_task", "is_goal", "handles_failures"
    POINT_MONITOR = "point monitor", "is_task", "is_monitor", "has_condition"
    POLLING_MONITOR = (
        "polling monitor",
        "is_task",
        "is_monitor",
        "has_condition",
        "is_outside_sequence",
    )
    DEMON_MONITOR = "demon monitor", "is_task", "is_monitor", "is_outside_sequence"
    VARIABLE = "variable", "fans_out", "keeps_value"

    @property
    def asks_one(self) -> bool:
        """Whether it is a question to one handler."""
        return self.has_reply and not self.fans_out

    @property
    def asks_many(self) -> bool:
        """Whether it is a question to every handler."""
        return self.has_reply and self.fans_out

    @property
    def only_acts(self) -> bool:
        """Whether it is a task that a handler carries out, and that expands into no others."""
        return self.is_task and not self.is_goal and not self.is_monitor


class Role(_WithTraits):
    """Why central made a message itself; "" for what a module sent."""

    is_of_monitor: bool
    """A monitor sends such messages."""
    leaves_safe: bool
    """It brings things to a safe end: it is not suspended with the task above it."""
    survives: bool
    """It is not killed with the task above it."""

    NONE = ""
    EXCEPTION = "exception handler", "survives"  # handles the failure of another task
    LISTENER = "listener"  # of a wiretap
    TERMINATION = "termination", "leaves_safe", "survives"  # leaves things safe after a kill
    CONDITION = "condition", "is_of_monitor"
    ACTION = "action", "is_of_monitor"
    SET_UP = "set up", "is_of_monitor"
    CANCEL = "cancel", "is_of_monitor", "leaves_safe", "survives"


class Outcome(StrEnum):
    """The outcome of a message or task."""

    DONE = "done"
    RESOLVED = "done after a failure"  # an exception handler resolved its failure: it did not do what it should
    FAILED = "failed"
    KILLED = "killed"

    @property
    def lets_successors_continue(self) -> bool:
        """Whether what follows goes on as planned."""
        return self in (Outcome.DONE, Outcome.RESOLVED)


class Refusal(StrEnum):
    """Why central refused a request."""

    PROTOCOL = "protocol"  # illegal here: unknown version, not said hello, no such moment, ...
    FORMAT = "format"  # the format or class of a message is not the one that others use
    UNKNOWN = "unknown"  # no such message, task or resource
    CYCLE = "cycle"  # the constraints could never be met
    TOO_LATE = "too late"  # the point has been reached already
    OVERLOAD = "overload"  # a bounded queue is full
    DEADLOCK = "deadlock"  # whoever waits would wait for himself, for ever
    FORBIDDEN = "forbidden"  # whoever asks may not
    SHUT_OUT = "shut out"  # central lets this connection in no more: its key or user is not allowed


class Dropping(StrEnum):
    """The reason for a dropped message, where programs need it too."""

    OTHER = ""
    GIVEN_UP = "given up"  # its sender waits no longer
    DEADLOCK = "deadlock"  # its sender would have waited for ever
    OVERLOAD = "overload"  # too much waited for its handler
    DISPLACED = "displaced"  # a newer one took its place, as its handler has it (``pending=``)


class Condition(StrEnum):
    """The event at which a wiretap sends its listener (TCA 8.5: msgTap.c). *Before* holds the
    tapped task's interval back until the listener's has ended, *when* holds its end; *while* and
    *after* hold nothing.
    """

    WHEN_SENT = "when sent"
    BEFORE_HANDLING = "before handling"
    WHILE_HANDLING = "while handling"
    AFTER_HANDLED = "after handled"
    AFTER_REPLIED = "after replied"
    AFTER_SUCCESS = "after success"
    AFTER_FAILURE = "after failure"
    WHEN_SUCCESS = "when success"
    WHEN_FAILURE = "when failure"
    BEFORE_PLANNING = "before planning"
    WHILE_PLANNING = "while planning"
    AFTER_PLANNED = "after planned"
    WHEN_PLANNED = "when planned"
    BEFORE_ACHIEVING = "before achieving"
    WHILE_ACHIEVING = "while achieving"
    AFTER_ACHIEVED = "after achieved"
    WHEN_ACHIEVED = "when achieved"
    WHEN_KILLED = "when killed"


class Scope(StrEnum):
    """The tasks that a kill ends (TCA 8.5: KillTaskTree, KillSubTaskTree; TDL: TERMINATE)."""

    TASK = "task"  # with everything under it
    DESCENDANTS = "descendants"  # everything under it, not the task itself
    SIBLINGS = "siblings"  # all other children of its parent, with everything under them


class Due(StrEnum):
    """The kinds of central's timers."""

    RELEASE = "release"  # a constraint's delay is over
    DEADLINE = "deadline"  # a task's point should have been reached
    KILL = "kill"  # a task shall end
    TEST = "test"  # a polling monitor asks its condition
    WATCHED = "watched"  # a monitor has watched long enough
    LOOK = "look"  # check blocked handlers for deadlocks
    GRACE = "grace"  # who has not come back to a central that was away is lost
    HUNG = "hung"  # a handler that nobody waits for should have returned
    CLAIM = "claim"  # somebody has waited long enough for a lock or reservation


class Party(StrEnum):
    """Who takes a transition of a life cycle."""

    CLIENT = "client"  # whoever wants something of a task
    SERVER = "server"  # the task's handler
    BOTH = "both"  # either of them may
    CENTRAL = "central"


class Busy(StrEnum):
    """What becomes of a task whose handler is busy with another one."""

    QUEUE = "queue"  # it waits for its turn
    PREEMPT = "preempt"  # the newest goes on: the others are cancelled
    REJECT = "reject"  # it is rejected


class Permission(StrEnum):
    """What a permissions file may allow, each for names that match its patterns."""

    SEND = "send"  # messages, and to set variables, fire monitors
    HANDLE = "handle"  # messages, and to get variables
    TAP = "tap"  # messages, and to attach exception handlers to all of them, wait for and look at others' tasks
    LOCK = "lock"  # resources, as "module.resource"
    KILL = "kill"  # others' tasks of these messages; and to suspend, retry, fail, constrain and extend them
    ADMINISTER = "administer"  # what the command line does: "unlock", "detach", "status", ...


CENTRAL = "central"
"""The sender of central's own messages, and the author of its own actions."""

DISK_FULL = 75
"""The exit code of a central that could not write for lack of room: started again when there is
some, it continues.
"""

LONGEST_TIME = 3.2e8
"""Seconds, ten years: nothing can be asked for later than this."""


class Limit(IntEnum):
    """Bounds of the protocol, in bytes, in characters of texts, or in items."""

    PACKET = 16 << 20
    BODY = 8 << 20
    HEADER = 1 << 20
    TOGETHER = 1 << 20  # of a packet to central with several items
    NAME = 128
    TEXT = 16_384
    ITEMS = 500  # of a packet to central: so long must everybody else wait for it
    LIST = 1000  # the entries of a list in a header
    PARTS = 2000  # of a packet to central: the entries of all lists in its headers


def is_name(text: str) -> bool:
    """Whether a text may name a message, module, resource, pool or failure: it is short, and steers
    no terminal.
    """
    return 0 < len(text) <= Limit.NAME and text.isprintable() and not text.isspace()
