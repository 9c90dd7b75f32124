"""The words that headers and facts share: classes, outcomes, conditions and the like. Knows nothing of their use."""

from enum import IntEnum, StrEnum
from functools import cached_property


class MessageClass(StrEnum):
    """How a message is routed and whether it becomes a task (semantics: TCA 8.5, message classes)."""

    INFORM = "inform"
    QUERY = "query"
    BROADCAST = "broadcast"
    MULTI_QUERY = "multi-query"
    GOAL = "goal"
    COMMAND = "command"
    EXCEPTION = "exception handler"
    POINT_MONITOR = "point monitor"
    POLLING_MONITOR = "polling monitor"
    DEMON_MONITOR = "demon monitor"
    VARIABLE = "variable"

    @cached_property
    def is_task(self) -> bool:
        """Whether such a message becomes a node of the task tree."""
        return self in _TASKS

    @cached_property
    def is_goal(self) -> bool:
        """Whether such a task expands into others and is planned; other tasks only act."""
        return self in _GOALS

    @cached_property
    def is_monitor(self) -> bool:
        """Whether central itself carries such a task out."""
        return self in _MONITORS

    @cached_property
    def has_reply(self) -> bool:
        """Whether the sender of such a message is answered by its handlers."""
        return self in (MessageClass.QUERY, MessageClass.MULTI_QUERY)


_GOALS = frozenset((MessageClass.GOAL, MessageClass.EXCEPTION))
_MONITORS = frozenset((MessageClass.POINT_MONITOR, MessageClass.POLLING_MONITOR, MessageClass.DEMON_MONITOR))
_TASKS = _GOALS | _MONITORS | {MessageClass.COMMAND}


class Role(StrEnum):
    """Why central made a message itself; "" for what a module sent."""

    NONE = ""
    EXCEPTION = "exception handler"  # handles the failure of another task
    LISTENER = "listener"  # of a wiretap
    TERMINATION = "termination"  # leaves things safe after a kill
    CONDITION = "condition"  # of a monitor
    ACTION = "action"
    SET_UP = "set up"
    CANCEL = "cancel"

    @cached_property
    def is_of_monitor(self) -> bool:
        """Whether a monitor sends such messages."""
        return self in _OF_MONITORS

    @cached_property
    def leaves_safe(self) -> bool:
        """Whether it brings things to a safe end: it is not suspended with the task above it."""
        return self in _SAFE

    @cached_property
    def survives(self) -> bool:
        """Whether it is not killed with the task above it."""
        return self in _SURVIVORS


_OF_MONITORS = frozenset((Role.CONDITION, Role.ACTION, Role.SET_UP, Role.CANCEL))
_SAFE = frozenset((Role.TERMINATION, Role.CANCEL))
_SURVIVORS = _SAFE | {Role.EXCEPTION}


class Outcome(StrEnum):
    """How a message or task ended."""

    DONE = "done"
    FAILED = "failed"
    KILLED = "killed"


class Refusal(StrEnum):
    """Why central refused a request."""

    PROTOCOL = "protocol"  # illegal here: unknown version, not said hello, no such moment, ...
    FORMAT = "format"  # the format or class of a message is not the one that others use
    UNKNOWN = "unknown"  # no such message, task or resource
    CYCLE = "cycle"  # the constraints could never be met
    TOO_LATE = "too late"  # the point has been reached already
    OVERLOAD = "overload"  # a bounded queue is full
    DEADLOCK = "deadlock"  # whoever waits would wait for himself, for ever


class Condition(StrEnum):
    """When a wiretap sends its listener (TCA 8.5: msgTap.c). *Before* holds the tapped task's interval back until the
    listener's has ended, *when* holds its end; *while* and *after* hold nothing.
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

    @cached_property
    def is_of_handling(self) -> bool:
        """Whether it is met each time that its message is handled, and so again when that is retried."""
        return self in _OF_HANDLING


_OF_HANDLING = frozenset((
    Condition.BEFORE_HANDLING, Condition.WHILE_HANDLING, Condition.AFTER_HANDLED, Condition.AFTER_SUCCESS,
    Condition.AFTER_FAILURE, Condition.WHEN_SUCCESS, Condition.WHEN_FAILURE,
))  # fmt: skip


class Scope(StrEnum):
    """What a kill ends (TCA 8.5: KillTaskTree, KillSubTaskTree; TDL: TERMINATE)."""

    TASK = "task"  # with everything under it
    DESCENDANTS = "descendants"  # everything under it, not the task itself
    SIBLINGS = "siblings"  # all other children of its parent, with everything under them


CENTRAL = "central"
"""The sender of what central makes itself, and who did what it does for reasons of its own."""

LONGEST_TIME = 3.2e8
"""Seconds, ten years: nothing can be asked for later than this."""


class Limit(IntEnum):
    """Bounds of the protocol, in bytes or items."""

    PACKET = 16 << 20
    BODY = 8 << 20
    NAME = 128
