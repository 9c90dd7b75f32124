"""The budget: the bytes that central may hold for modules, split into separate parts.

The bytes of each part are counted when something is added or removed, so that the space left is
always known. If a part is full, requests that need more of this part are refused and informs are
dropped. Three parts are never full: if stored answers, outcomes or retained records hold too much,
the oldest are forgotten. Requests that free something, or only report, are always accepted.
"""

from tca_central.model.stored import Stored

MEMORY = 512 << 20
"""The default of --memory: the bytes that central may hold for modules."""

LEAST_MEMORY = 16 << 20
"""The least number of bytes that --memory accepts."""

TAP_DEPTH, TASK_DEPTH = 8, 20_000
"""Default limits: listeners of wiretaps in one chain of causes, and depth of the task tree."""

# The approximate size of each object in bytes, without the texts and data in the object.
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
AWAITED_BYTES = 200  # one message that a connection waits for (``PresenceWait``)
ANSWER_BYTES = 300


class Budget(Stored):
    """The limits of all parts, and those counts of used bytes that no other object has."""

    __slots__ = (
        "answers",
        "collector_bytes",
        "declared",
        "keeps_inputs",
        "messages",
        "outcomes",
        "presence_bytes",
        "records",
        "refused",
        "tap_depth",
        "task_depth",
        "total",
        "unread",
        "variables",
    )

    def __init__(self, total: int = MEMORY) -> None:
        self.split(total)
        self.tap_depth, self.task_depth = TAP_DEPTH, TASK_DEPTH
        self.keeps_inputs = True  #: whether the run can continue after a restart
        self.collector_bytes = 0  #: bytes of failures that multi-queries in progress hold
        self.presence_bytes = 0  #: bytes of waits for handlers (``PresenceWait``)
        self.refused = 0  #: number of requests refused, and informs dropped, for a full part

    def split(self, total: int) -> None:
        """Split *total* bytes among the parts."""
        self.total = total
        self.messages = total // 2  #: queued and handled messages, tasks, and constraints
        self.declared = total // 16  #: declarations, attachments, claims, waits and timers
        self.answers = total // 8  #: stored answers
        self.outcomes = total // 16  #: failures and results of ended tasks
        self.records = total // 16  #: records of ended tasks that modules retain
        self.variables = total // 16  #: values of variables
        self.unread = total // 8  #: messages sent and not read yet
