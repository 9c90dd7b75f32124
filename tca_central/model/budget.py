"""The budget: the bytes that central may hold of what modules send, split into parts that do not
take from each other.

Each part is counted where something comes and goes, so that to know what is left costs nothing.
What a module asks for beyond a part is refused, and who sends informs loses them; answers, outcomes
and records give way, the oldest first. Nothing is asked of requests that free something, or only
tell: they get in whatever is full.
"""

from tca_central.model.stored import Stored

MEMORY = 512 << 20
"""Bytes, unless somebody says otherwise."""

LEAST_MEMORY = 16 << 20

TAP_DEPTH, TASK_DEPTH = 8, 20_000
"""Listeners of wiretaps in one chain of causes, and tasks above one another, unless an option says
otherwise.
"""

# About what an object costs beside the bytes that it holds.
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
    """The limits, and counts that have no other place."""

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
        self.collected = 0  #: bytes of the failures with which multi-queries under way may end
        self.awaited = 0  #: bytes of waits until messages are handled
        self.refused = 0  #: how much was refused or dropped because a part is spent

    def share(self, total: int) -> None:
        """Split so many bytes."""
        self.total = total
        self.messages = total // 2  #: messages in queues and with handlers, tasks, and constraints
        self.declared = total // 16  #: what is declared, attached, claimed and waited for; timers
        self.answers = total // 8  #: answers that are kept in case their requests are repeated
        self.outcomes = total // 16  #: failures and results of ended tasks
        self.kept = total // 16  #: records of ended tasks that modules keep
        self.variables = total // 16  #: values
        self.unread = total // 8  #: what was sent, and not read yet
