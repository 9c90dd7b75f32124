"""Tasks: the nodes of the tree, and the parts that only some of them have.

Each class of the chain adds one concern: ``Queued`` and ``Delivery`` (deliveries.py), then
``Node``, ``Ordered`` and ``Task``. Parts such as ``Recovery`` are created on first use: most tasks
have none, and there may be hundreds of thousands of tasks.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from tca_central.model.budget import DELIVERY_BYTES, TASK_BYTES
from tca_central.model.clock import Timer
from tca_central.model.deliveries import (
    AttachedHandler,
    Connection,
    Delivery,
    Handler,
    MessageType,
    Module,
    Wiretap,
)
from tca_central.model.stored import Stored
from tca_wire.packets.parts import Involved, Watching, WatchOptions
from tca_wire.points import ROOT, TaskId
from tca_wire.vocabulary import CENTRAL, Due, Outcome, Role

Failure = tuple[str, str, bytes]
"""The name, text and data of a failure that was raised on a task."""

TaskOutcome = tuple[Outcome, str, str, bytes]
"""Outcome, failure name, failure text, and the failure's data or the task's result."""

_ACTION = 1  # index of the action among a monitor's parts


class Node(Delivery):
    """A place in the tree: its parent and its living children."""

    __slots__ = (
        "background_monitors",
        "children",
        "depth",
        "is_background",
        "last_child",
        "parent",
        "sequence",
        "unplanned",
    )

    def __init__(
        self, task_id: TaskId, message: MessageType, body: bytes, sender: Connection | None
    ) -> None:
        Delivery.__init__(self, task_id, message, body, sender)
        self.parent: Task | None = None  #: none: it is the root
        self.depth = 0  #: number of tasks from the top of the tree to this one, both included
        #: A monitor that its parent does not wait for. It is ended when the parent's handler has
        #: returned and only such monitors are left under it.
        self.is_background = False
        #: By id: the children that have not ended, oldest first.
        self.children: dict[int, Task] | None = None
        #: By id: the children that are background monitors.
        self.background_monitors: dict[int, Task] | None = None
        self.unplanned = 0  #: number of children whose planning has not ended
        #: The child behind which the next child is put by its constraint flags.
        self.last_child: Task | None = None
        #: By id: the children from which ``last_child`` is chosen. Built when it was killed, and
        #: the child before it takes its place; None until then.
        self.sequence: dict[int, Task] | None = None


class Ordered(Node):
    """A node with moments, and with constraints that hold them."""

    __slots__ = ("followers", "held", "leaders", "planning_delayed", "reached", "waiters")

    def __init__(
        self, task_id: TaskId, message: MessageType, body: bytes, sender: Connection | None
    ) -> None:
        Node.__init__(self, task_id, message, body, sender)
        self.reached = 0  #: the moments reached, as bits
        #: Whether planning starts only when achieving does (DELAY_PLANNING).
        self.planning_delayed = False
        self.held = 0  #: number of unmet constraints per moment, packed into one integer (holds.py)
        #: The points that constraints hold until a moment of this task:
        #: (its own moment, follower, the follower's moment, delay)
        self.followers: list[tuple[int, Task, int, float]] | None = None
        #: What this task waits for: (its own moment, id of the leader, the leader's moment)
        self.leaders: list[tuple[int, int, int]] | None = None
        #: By waiter, oldest first: the moment at which a connection is answered, a task is killed
        #: or a monitor is ended.
        self.waiters: dict[Stored, int] | None = None


class Task(Ordered):
    """A task from its arrival to its end.

    Its progress is not stored as one value: it follows from ``reached``, ``returned`` and
    ``killed``.
    """

    is_task = True

    __slots__ = (
        "clients",
        "is_goal",
        "killed",
        "recovery",
        "result",
        "retention",
        "retry_pending",
        "returned",
        "scheduled",
        "serial",
        "size",
        "start_granted",
        "state",
        "suspended",
        "tapping",
        "watch",
    )

    id: TaskId

    def __init__(
        self, task_id: TaskId, message: MessageType, body: bytes, sender: Connection | None
    ) -> None:
        Ordered.__init__(self, task_id, message, body, sender)
        self.is_goal = message.is_goal
        #: Of its life cycle; observers learn the final one when the task has ended.
        self.state = message.initial_state
        self.serial = 0  #: number of changes of that state
        #: Whether it was passed on for delivery, because its start conditions were met. It is in
        #: ``Agenda.startable``, in a queue, or with a handler.
        self.start_granted = False
        self.suspended = False
        self.retry_pending = False  #: it is handled again once everything under it has ended
        self.returned = False  #: whether its handler has returned, or will never be called
        self.killed = ""  #: why it was killed and by which module; "" if it was not
        self.result = b""  #: the result of its handler
        self.size = TASK_BYTES + len(body)  #: bytes that it counts for in the budget
        self.recovery: Recovery | None = None
        self.tapping: Tapping | None = None
        self.scheduled: Scheduled | None = None
        self.watch: Watch | None = None  #: of a monitor only
        self.clients: Clients | None = None
        self.retention: Retention | None = None

    def __repr__(self) -> str:
        return f"task {self.id} '{self.message.name}'"

    @property
    def has_parts(self) -> bool:
        """Whether it has any of the optional parts."""
        first_three = self.recovery or self.tapping or self.scheduled
        return bool(first_three or self.watch or self.clients or self.retention)

    @property
    def attached(self) -> list[AttachedHandler]:
        """The exception handlers attached to this task, newest last."""
        return self.recovery.attached if self.recovery is not None else []

    @property
    def taps(self) -> list[Wiretap]:
        """The wiretaps of this task alone, oldest first."""
        return self.tapping.taps if self.tapping is not None else []

    @property
    def failure(self) -> Failure | None:
        """The failure that was raised on it last."""
        return self.recovery.failure if self.recovery is not None else None

    @property
    def is_dealt_with(self) -> bool:
        """Whether an exception handler has resolved that failure."""
        return self.recovery is not None and self.recovery.is_dealt_with

    @property
    def is_foreign_monitor(self) -> bool:
        """Whether it is a monitor that was not sent by the handling of its parent.

        A retry of the parent does not end it.
        """
        return self.watch is not None and self.watch.is_foreign_monitor

    @property
    def ignores_parent(self) -> bool:
        """Whether it may start before its parent, as tasks that central makes may."""
        return bool(self.role)

    @property
    def has_unprocessed_decisions(self) -> bool:
        """Whether central has yet to process decisions of its exception handlers that have ended.

        Until then it may fail again.
        """
        return self.recovery is not None and self.recovery.unprocessed_decisions > 0

    @property
    def may_be_handled_again(self) -> bool:
        """Whether a retry may start.

        It waits for the current handler, for all children but foreign monitors, and for the
        exception handlers that asked for the retry.
        """
        recovery, children = self.recovery, len(self.children or ())
        if recovery is None:
            return not (self.is_running or children)
        return (
            not (self.is_running or recovery.retry_requesters or recovery.unprocessed_decisions)
            and children == recovery.foreign_monitors
        )

    @property
    def has_only_background_left(self) -> bool:
        """Whether its handler has returned and only background monitors are left under it."""
        if self.has_unprocessed_decisions:
            return False
        return self.returned and len(self.children or ()) == len(self.background_monitors or ()) > 0

    @property
    def is_running(self) -> bool:
        """Whether a handler has it."""
        return self.slot is not None

    @property
    def handler(self) -> Handler | None:
        """The handler that has it; None if no handler does."""
        return self.slot.module.handlers.get(self.message.name) if self.slot is not None else None

    def exception_handlers_up(self) -> "list[Task]":
        """Return the exception handlers among this task and its ancestors, nearest first."""
        found, exception = [], Role.EXCEPTION
        task: Task | None = self
        while task is not None:
            if task.role is exception:
                found.append(task)
            task = task.parent
        return found

    def lineage(self) -> Iterator["Task"]:
        """Yield this task and its ancestors, without the root."""
        task: Task | None = self
        while task is not None and task.id != ROOT:
            yield task
            task = task.parent

    def find_above(self, number: int) -> "Task | None":
        """Return the task with that id if it is this task or an ancestor; else None.

        The walk stops at the first older task, because a parent is always older than its children.
        """
        task: Task | None = self
        while task is not None and task.id > number:
            task = task.parent
        return task if task is not None and ROOT < task.id == number else None


# --- parts ----------------------------------------------------------------------------------------


class Recovery(Stored):
    """A task's failure, its retries, and the exception handlers attached to it."""

    __slots__ = (
        "attached",
        "attempts",
        "exception_handler",
        "failure",
        "foreign_monitors",
        "invocations",
        "is_dealt_with",
        "retry_requesters",
        "unprocessed_decisions",
    )

    def __init__(self) -> None:
        self.attached: list[AttachedHandler] = []  #: newest last
        #: By attachment id: how often that exception handler was called for this task.
        self.invocations: dict[int, int] = {}
        self.failure: Failure | None = None  #: the one raised last
        self.is_dealt_with = False  #: whether an exception handler has resolved it
        #: The exception handler that is to decide about the failure.
        self.exception_handler: Task | None = None
        self.attempts = 1  #: number of times that the task has been handled, with the present one
        #: Exception handlers that want a retry and have not ended.
        self.retry_requesters: dict[Task, None] = {}
        #: Number of foreign monitors under the task: a retry does not end them.
        self.foreign_monitors = 0
        #: Number of exception handlers of the task that have ended, and whose decisions are not
        #: processed yet. Until then the task may not end: it may fail again.
        self.unprocessed_decisions = 0

    @staticmethod
    def of(task: Task) -> "Recovery":
        """Return the task's ``Recovery``, creating it on first use."""
        if task.recovery is None:
            task.recovery = Recovery()
        return task.recovery


class Tapping(Stored):
    """The wiretaps of one task, and which wiretaps, its own or its message's, have fired for it."""

    __slots__ = ("fired", "is_firing", "listeners", "taps")

    def __init__(self) -> None:
        self.taps: list[Wiretap] = []  #: of this task alone, oldest first
        #: By id of each wiretap that fired before a moment of the task: whether its listener had a
        #: handler.
        self.fired: dict[int, bool] = {}
        #: Whether wiretaps are about to fire: until then the task reaches no moment.
        self.is_firing = False
        self.listeners: list[Task] = []  #: listeners that are killed with the task

    def fire_again(self, taps: Iterable[int]) -> None:
        """Have wiretaps, given by their ids, fire once more."""
        for tap in taps:
            self.fired.pop(tap, None)

    @staticmethod
    def of(task: Task) -> "Tapping":
        """Return the task's ``Tapping``, creating it on first use."""
        if task.tapping is None:
            task.tapping = Tapping()
        return task.tapping


class Scheduled(Stored):
    """Events that are scheduled for a task: timers, kills, and messages for its termination."""

    __slots__ = ("pending", "termination_messages")

    def __init__(self) -> None:
        #: By scheduled event: the timer, or the task whose moment it waits for.
        self.pending: dict[Stored, Timer | Task] = {}
        #: Messages to send when the task is killed, with their data.
        self.termination_messages: list[tuple[MessageType, bytes]] = []

    @staticmethod
    def of(task: Task) -> "Scheduled":
        """Return the task's ``Scheduled``, creating it on first use."""
        if task.scheduled is None:
            task.scheduled = Scheduled()
        return task.scheduled


class ClientRequest(NamedTuple):
    """A change of a task's state that a client has requested."""

    name: str
    source: str  #: the state of the task before
    serial: int  #: the serial number of the change, as it was sent to the handler
    module: str  #: the client's
    text: str
    body: bytes  #: the new goal of an update
    needs_decision: bool  #: the handler decides about it


class Clients(Stored):
    """The requests of clients for a task, and its newest intermediate result."""

    __slots__ = ("asked", "newest", "progress")

    def __init__(self) -> None:
        #: Requests since the handler's last change of state, oldest first.
        self.asked: list[ClientRequest] = []
        self.newest = 0  #: the serial number of the newest request
        self.progress = b""  #: the newest intermediate result

    @staticmethod
    def of(task: Task) -> "Clients":
        """Return the task's ``Clients``, creating it on first use."""
        if task.clients is None:
            task.clients = Clients()
        return task.clients


class Retention(Stored):
    """The modules that retain a task (or record), and the records under it."""

    __slots__ = ("by", "records")

    def __init__(self) -> None:
        self.by: dict[Module, None] = {}  #: the modules that want it retained
        #: By id: records of ended children, in the order of their ends.
        self.records: dict[int, TaskRecord] = {}

    @staticmethod
    def of(place: "Task | TaskRecord") -> "Retention":
        """Return the ``Retention`` of a task or record, creating it on first use."""
        if place.retention is None:
            assert isinstance(place, Task)
            place.retention = Retention()
        return place.retention


class TaskRecord(Stored):
    """The record of an ended task that a module retains."""

    __slots__ = ("body", "id", "message", "outcome", "parent", "retention", "role")

    def __init__(self, task: Task, outcome: TaskOutcome, retention: Retention) -> None:
        self.id, self.message, self.role = task.id, task.message, task.role
        self.body, self.outcome = task.body, outcome
        self.parent: Task | TaskRecord | None = task.parent  #: a living task or a record
        self.retention = retention
        for child in retention.records.values():
            child.parent = self

    @property
    def size(self) -> int:
        """The bytes of modules' data that it holds."""
        return len(self.body) + len(self.outcome[2]) + len(self.outcome[3])

    @property
    def siblings(self) -> "dict[int, TaskRecord]":
        """The records under the same parent."""
        assert self.parent is not None
        return Retention.of(self.parent).records

    def lineage(self) -> "Iterator[Task | TaskRecord]":
        """Yield this record and its ancestors, without the root."""
        ancestor: Task | TaskRecord | None = self
        while ancestor is not None and ancestor.id != ROOT:
            yield ancestor
            ancestor = ancestor.parent


class Watch(Stored):
    """A monitor from its creation to its end."""

    __slots__ = (
        "actions_sent",
        "condition",
        "is_foreign_monitor",
        "is_over",
        "last_result",
        "options",
        "parts",
        "periods_from",
        "task",
        "tests_owed",
        "timers",
        "times_met",
        "waits_for",
        "watching_since",
    )

    def __init__(
        self,
        task: Task,
        options: WatchOptions,
        parts: list[MessageType | None],
        is_foreign_monitor: bool = False,
    ) -> None:
        self.task = task
        self.options = options
        #: Condition and action. Of a monitor that modules fire (*demon monitor*): set-up, action
        #: and cancel.
        self.parts = parts
        #: Whether something else than the handling of its parent has sent it (watches.py).
        self.is_foreign_monitor = is_foreign_monitor
        self.watching_since: float | None = None  #: when it began to watch
        self.periods_from = 0.0  #: the moment from which its periods count
        self.tests_owed = 0  #: number of tests still to make because it was fired
        self.condition: Delivery | None = None  #: the test under way
        self.last_result: bool | None = None  #: result of the last test
        self.times_met = 0  #: how often its condition held, or it was fired
        self.actions_sent = 0  #: number of actions sent
        self.timers: dict[Due, Timer] = {}
        self.waits_for: Task | None = None  #: the task whose moment ends it
        self.is_over = False

    @property
    def is_on(self) -> bool:
        """Whether it watches now."""
        return self.watching_since is not None and not self.is_over

    @property
    def header(self) -> Watching:
        """The context that its messages carry: the monitor, and the message that fires it."""
        action = None if self.task.message.message_class.has_condition else self.parts[_ACTION]
        return Watching(involved(self.task), action.name if action is not None else "")


# --- about tasks ----------------------------------------------------------------------------------


class Verdict(NamedTuple):
    """The reason why a task is killed."""

    why: str
    by: str = CENTRAL  #: the module that wants it, or central
    origin: int = 0  #: the delivery whose handler asked for it (0: none)
    failed: TaskId = ROOT  #: the task whose unhandled failure is the reason, if it is one


def involved(delivery: Delivery) -> Involved:
    """Describe a message for other modules; the id is 0 if it is no task, or the root."""
    if not isinstance(delivery, Task):
        return Involved(ROOT, delivery.message.name)
    return Involved(delivery.id, delivery.message.name if delivery.id else "")


def place_of(attachment: AttachedHandler | Wiretap) -> Task | MessageType:
    """Return the task or message type that an exception handler or wiretap is attached to."""
    assert isinstance(attachment.place, Task | MessageType)
    return attachment.place


def held_bytes(asked: list[ClientRequest]) -> int:
    """Return the bytes that clients' requests hold."""
    return sum(DELIVERY_BYTES + len(one.body) for one in asked)
