"""The words that headers and facts share: classes, outcomes, conditions and the like."""

from enum import IntEnum, StrEnum
from typing import Self


class _WithTraits(StrEnum):
    """Words with traits: an annotated attribute is True for the members that name it."""

    def __new__(cls, word: str, *traits: str) -> Self:
        """Create a word with its traits as attributes, True or False."""
        assert set(traits) <= cls.__annotations__.keys(), f"{word}: unknown trait"
        member = str.__new__(cls, word)
        member._value_ = word
        for trait in cls.__annotations__:
            setattr(member, trait, trait in traits)
        return member


class MessageClass(_WithTraits):
    """The classes of messages, with their traits (TCA 8.5, message classes)."""

    is_task: bool
    """It becomes a node of the task tree."""
    is_goal: bool
    """It is planned and expands into other tasks; other tasks only act."""
    is_monitor: bool
    """Central itself carries it out."""
    has_reply: bool
    """Its handlers answer the sender."""
    fans_out: bool
    """Every handler gets a copy."""
    keeps_value: bool
    """Central keeps the newest value: it is set, not sent."""
    may_react: bool
    """A wiretap, a monitor or a kill may send it."""
    has_condition: bool
    """It is a monitor that asks a query; other monitors are fired by modules."""
    is_interval_monitor: bool
    """It is a monitor that watches over its siblings: it is not ordered with them."""
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
        "is_interval_monitor",
    )
    DEMON_MONITOR = "demon monitor", "is_task", "is_monitor", "is_interval_monitor"
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
        """Whether it is a task that a handler carries out without subtasks."""
        return self.is_task and not self.is_goal and not self.is_monitor


class Role(_WithTraits):
    """The reason why central created a message; "" for a module's message."""

    is_of_monitor: bool
    """A monitor sends it."""
    runs_while_suspended: bool
    """It is not suspended with the task above it: it leaves things safe."""
    survives: bool
    """It is not killed with the task above it."""

    NONE = ""
    EXCEPTION = "exception handler", "survives"  # handles the failure of another task
    LISTENER = "listener"  # of a wiretap
    TERMINATION = "termination", "runs_while_suspended", "survives"  # sent after a kill
    CONDITION = "condition", "is_of_monitor"
    ACTION = "action", "is_of_monitor"
    SET_UP = "set up", "is_of_monitor"
    CANCEL = "cancel", "is_of_monitor", "runs_while_suspended", "survives"


class Outcome(StrEnum):
    """The outcome of a message or task.

    Attributes:
        DONE: it was done; for a goal, with all its subtasks.
        RESOLVED: it failed, and an exception handler resolved the failure.
        FAILED: it failed, and the failure was not dealt with.
        KILLED: it was killed, or cancelled at a client's request.
    """

    DONE = "done"
    RESOLVED = "done after a failure"
    FAILED = "failed"
    KILLED = "killed"

    @property
    def lets_successors_continue(self) -> bool:
        """Whether the successors continue as planned."""
        return self in (Outcome.DONE, Outcome.RESOLVED)


class Refusal(StrEnum):
    """The reason why central refused a request.

    Attributes:
        PROTOCOL: the request is not allowed here, for example before the hello.
        FORMAT: another module declared the message with another format or class.
        UNKNOWN: there is no such message, task or resource.
        CYCLE: the constraints could never be met.
        TOO_LATE: the point has been reached already.
        OVERLOAD: a bounded queue or central's memory is full.
        DEADLOCK: the waiter would wait for itself for ever.
        FORBIDDEN: the permissions do not allow it.
        SHUT_OUT: the key or user of this connection is no longer allowed.
    """

    PROTOCOL = "protocol"
    FORMAT = "format"
    UNKNOWN = "unknown"
    CYCLE = "cycle"
    TOO_LATE = "too late"
    OVERLOAD = "overload"
    DEADLOCK = "deadlock"
    FORBIDDEN = "forbidden"
    SHUT_OUT = "shut out"


class Dropping(StrEnum):
    """The reason why a message was dropped, where programs need it."""

    OTHER = ""
    GIVEN_UP = "given up"  # its sender has stopped waiting
    DEADLOCK = "deadlock"  # its sender would have waited for itself
    OVERLOAD = "overload"  # the queue of its handler was full
    DISPLACED = "displaced"  # a newer message took its place (the handler's ``pending=``)


class Condition(StrEnum):
    """The event at which a wiretap sends its listener (TCA 8.5: msgTap.c).

    *Before* holds the start of the tapped task's interval until the same interval of the listener
    has ended. *When planned* and *when achieved* hold the end of the tapped task's interval. *When
    success* and *when failure* hold the end of the task, because their listener is its child. The
    other conditions hold nothing.
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
    """The tasks that a kill ends (TCA 8.5: KillTaskTree, KillSubTaskTree; TDL: TERMINATE).

    Attributes:
        TASK: the task with all its descendants.
        DESCENDANTS: all descendants of the task, not the task itself.
        SIBLINGS: all other children of its parent, with their descendants.
    """

    TASK = "task"
    DESCENDANTS = "descendants"
    SIBLINGS = "siblings"


class Due(StrEnum):
    """The kinds of central's timers."""

    RELEASE = "release"  # a constraint's delay is over
    DEADLINE = "deadline"  # a task's point should have been reached
    ATTEMPT = "attempt"  # the attempt of a task with a retry policy should have ended
    KILL = "kill"  # a planned kill is due
    TEST = "test"  # a polling monitor tests its condition
    MONITOR_OVER = "watched"  # the duration of a monitor is over
    LOOK = "look"  # check blocked handlers for deadlocks
    GRACE = "grace"  # after a restart: connections that have not come back are lost
    HUNG = "hung"  # a handler without a waiting sender should have returned
    CLAIM = "claim"  # the timeout of a wait for a lock or reservation


class Party(StrEnum):
    """The party that takes a transition of a life cycle.

    Attributes:
        CLIENT: a module that wants something of a task.
        SERVER: the task's handler.
        BOTH: client or server.
        CENTRAL: central itself.
    """

    CLIENT = "client"
    SERVER = "server"
    BOTH = "both"
    CENTRAL = "central"


class Busy(StrEnum):
    """The fate of a task whose handler is busy with another task."""

    QUEUE = "queue"  # it waits in the queue
    PREEMPT = "preempt"  # the newest task runs: the others are cancelled
    REJECT = "reject"  # it is rejected


class Permission(StrEnum):
    """The actions that a permissions file may allow, each for names that match its patterns."""

    SEND = "send"  # send messages, set variables, fire monitors
    HANDLE = "handle"  # handle messages, get variables
    TAP = "tap"  # tap messages, attach exception handlers to all, await and inspect foreign tasks
    LOCK = "lock"  # lock resources, as "module.resource"
    KILL = "kill"  # kill, suspend, retry, fail, constrain and extend foreign tasks
    ADMINISTER = "administer"  # commands of the command line: "unlock", "detach", "status", ...


CENTRAL = "central"
"""The sender of central's own messages, and the author of its own actions."""

DISK_FULL = 75
"""The exit code of a central that ran out of disk space.

Its run continues when central is started again and there is space.
"""

LONGEST_TIME = 3.2e8
"""Seconds, ten years: no delay or deadline is longer."""


class Limit(IntEnum):
    """Bounds of the protocol, in bytes, in characters of texts, or in items."""

    PACKET = 16 << 20
    BODY = 8 << 20
    LARGE = 255 << 20  # bytes of one segment of large data: the default --memory has room for it
    HEADER = 1 << 20
    TOGETHER = 1 << 20  # bytes of a packet to central with several items
    NAME = 128
    TEXT = 16_384
    ITEMS = 500  # in a packet to central: all others wait while it is handled
    LIST = 1000  # entries of a list in a header
    ATTEMPTS = 1000  # of a task with a retry policy
    PARTS = 2000  # entries of all lists in the headers of a packet to central


def is_name(text: str) -> bool:
    """Return whether a text may name a message, module, resource, pool or failure.

    A name is short, printable and not blank: it can't steer a terminal.
    """
    return 0 < len(text) <= Limit.NAME and text.isprintable() and not text.isspace()
