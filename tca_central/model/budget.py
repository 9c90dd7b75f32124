"""The budget: the bytes that central may hold for modules, split into separate parts.

Each part is counted when something is added or removed, so that the space left is always known. If
a part is full, requests that need more of it are refused and informs are dropped. Answers, outcomes
and records are forgotten instead, the oldest first. Requests that free something, or only report,
are always accepted.
"""

from tca_central.model.stored import Stored

MEMORY = 512 << 20
"""Bytes, unless --memory says otherwise."""

LEAST_MEMORY = 16 << 20
"""Bytes: the least that --memory accepts."""

TAP_DEPTH, TASK_DEPTH = 8, 20_000
"""Default limits: listeners of wiretaps in one chain of causes, and depth of the task tree."""

# The approximate size of each object, without the bytes that it holds.
DELIVERY_BYTES = 500
TASK_BYTES = 1000
EDGE_BYTES = 200  # a constraint
TYPE_BYTES = 2000  # a declared message
HANDLER_BYTES = 500
RESOURCE_BYTES = 1500
ATTACHED_BYTES = 800  # an exception handler or wiretap
CLAIM_BYTES = 1000
TIMER_BYTES = 500
WAIT_BYTES = 500
AWAITED_BYTES = 200  # a message in a wait until it is handled
ANSWER_BYTES = 300


class Budget(Stored):
    """The limits, and the counts that no other object has."""

    __slots__ = (
        "answers",
        "awaited",
        "collected",
        "declared",
        "kept",
        "messages",
        "outcomes",
        "refused",
        "tap_depth",
        "task_depth",
        "total",
        "unread",
        "variables",
    )

    def __init__(self, total: int = MEMORY) -> None:
        self.share(total)
        self.tap_depth, self.task_depth = TAP_DEPTH, TASK_DEPTH
        self.collected = 0  #: bytes of failures that multi-queries in progress hold
        self.awaited = 0  #: bytes of waits until messages are handled
        self.refused = 0  #: number of refusals and drops because a part is full

    def share(self, total: int) -> None:
        """Split *total* bytes among the parts."""
        self.total = total
        self.messages = total // 2  #: queued and handled messages, tasks, and constraints
        self.declared = total // 16  #: declarations, attachments, claims, waits and timers
        self.answers = total // 8  #: stored answers
        self.outcomes = total // 16  #: failures and results of ended tasks
        self.kept = total // 16  #: records of ended tasks that modules retain
        self.variables = total // 16  #: values of variables
        self.unread = total // 8  #: messages sent and not read yet
