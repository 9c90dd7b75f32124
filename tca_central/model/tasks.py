"""Tasks: the nodes of the tree, and the parts that only some tasks have.

Each class of the chain adds one concern: ``Queued`` and ``Delivery`` (deliveries.py), then
``Node``, ``Ordered`` and ``Task``. Parts such as ``Recovery`` are created on first use. Most tasks
have no parts, which saves much memory where there are hundreds of thousands of tasks.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import msgspec

from tca_central.model.budget import DELIVERY_BYTES, TASK_BYTES
from tca_central.model.clock import Clock, Timer
from tca_central.model.deliveries import (
    AttachedHandler,
    Connection,
    Context,
    Delivery,
    Handler,
    MessageType,
    Module,
    Wiretap,
)
from tca_central.model.stored import Stored
from tca_wire.packets.large import held_size
from tca_wire.packets.parts import Involved, RetryPolicy, Watching, WatchOptions
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
        self.parent: Task | None = None  #: None for the root
        #: 1 for a top-level task, 2 for its children, and so on; 0 for the root.
        self.depth = 0
        #: Whether this is a monitor that its parent does not wait for. Such a monitor is ended when
        #: the parent's handler has returned and only such monitors are left under the parent.
        self.is_background = False
        #: By id: the children that have not ended, oldest first.
        self.children: dict[int, Task] | None = None
        #: By id: the children that are background monitors.
        self.background_monitors: dict[int, Task] | None = None
        self.unplanned = 0  #: number of children whose planning has not ended
        #: The newest child in the sequence: ``Flags`` put the next child behind it.
        self.last_child: Task | None = None
        #: By id: the living children to which flags may refer. Built when a ``last_child`` is
        #: killed for the first time, to find the child before it; None until then.
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
        #: The points that constraints hold until this task reaches a moment:
        #: (this task's moment, follower, the follower's moment, delay)
        self.followers: list[tuple[int, Task, int, float]] | None = None
        #: The points that this task waits for: (this task's moment, leader's id, leader's moment)
        self.leaders: list[tuple[int, int, int]] | None = None
        #: By waiter, oldest first: the moment of this task at which the waiter acts. It answers a
        #: connection, kills a task or ends a monitor.
        self.waiters: dict[Stored, int] | None = None


class Task(Ordered):
    """A task from its arrival to its end.

    The progress of a task is not stored as one value. The progress follows from ``reached``,
    ``returned`` and ``killed``.
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
        #: The task's state in its life cycle. Observers get the final state after the task's end.
        self.state = message.initial_state
        self.serial = 0  #: number of changes of ``state``
        #: Whether the task was passed on for delivery, because its start conditions were met. It is
        #: then in ``Agenda.startable``, in a queue, or with a handler.
        self.start_granted = False
        self.suspended = False
        self.retry_pending = False  #: whether it is handled again when all under it has ended
        self.returned = False  #: whether its handler has returned, or will never be called
        self.killed = ""  #: why it was killed and by which module; "" if it was not
        self.result = b""  #: the result of its handler
        self.size = TASK_BYTES + held_size(body)  #: bytes that it counts for in the budget
        self.recovery: Recovery | None = None
        self.tapping: Tapping | None = None
        self.scheduled: Scheduled | None = None
        self.watch: Watch | None = None  #: set for monitors only
        self.clients: Clients | None = None
        self.retention: Retention | None = None
        if message.format.retry is not None:
            Recovery.of(self).policy = Policy(self, message.format.retry)

    @property
    def has_parts(self) -> bool:
        """Whether the task has any of the optional parts."""
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
        """The failure that was raised on the task last; None if there was none."""
        return self.recovery.failure if self.recovery is not None else None

    @property
    def is_dealt_with(self) -> bool:
        """Whether an exception handler has resolved ``failure``."""
        return self.recovery is not None and self.recovery.is_dealt_with

    @property
    def is_foreign_monitor(self) -> bool:
        """Whether this is a monitor that was not sent by its parent's handling.

        A retry of the parent does not end such a monitor.
        """
        return self.watch is not None and self.watch.is_foreign_monitor

    @property
    def ignores_parent(self) -> bool:
        """Whether the task may start before its parent. Only tasks that central makes may."""
        return bool(self.role)

    @property
    def has_unprocessed_decisions(self) -> bool:
        """Whether exception handlers of this task have ended with decisions not processed yet.

        The task may fail again until central has processed these decisions.
        """
        return self.recovery is not None and self.recovery.unprocessed_decisions > 0

    @property
    def may_be_handled_again(self) -> bool:
        """Whether a retry may start.

        The retry waits for the current handler, and for all children except foreign monitors. It
        also waits for the exception handlers that asked for it, and for unprocessed decisions.
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
        """Whether only background monitors are left under a task whose handler has returned.

        False while a decision of an exception handler is unprocessed.
        """
        if self.has_unprocessed_decisions:
            return False
        return self.returned and len(self.children or ()) == len(self.background_monitors or ()) > 0

    @property
    def is_running(self) -> bool:
        """Whether a handler has the task."""
        return self.slot is not None

    @property
    def handler(self) -> Handler | None:
        """The handler that has the task; None if no handler has it."""
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

    @property
    def ending(self) -> str:
        """The transition by which its handler ends the task; "" for the usual one."""
        return self.clients.ending if self.clients is not None else ""

    @property
    def end_state(self) -> str:
        """The final state of an ended task, if its life cycle has several; else ""."""
        return self.state if self.message.life_cycle.has_many_ends else ""

    def find_above(self, number: int) -> "Task | None":
        """Return the task with the id *number* if it is this task or an ancestor; else None.

        A parent always has a lower id than its children, so the walk stops at the first lower id.
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
        "policy",
        "retry_requesters",
        "unprocessed_decisions",
    )

    def __init__(self) -> None:
        self.attached: list[AttachedHandler] = []  #: newest last
        #: By attachment id: how often that exception handler was called for this task.
        self.invocations: dict[int, int] = {}
        self.failure: Failure | None = None  #: the failure raised last
        self.is_dealt_with = False  #: whether an exception handler has resolved ``failure``
        #: The exception handler that is to decide about the failure.
        self.exception_handler: Task | None = None
        self.attempts = 1  #: number of handlings of the task so far, including the present one
        #: Exception handlers that want a retry and have not ended.
        self.retry_requesters: dict[Task, None] = {}
        self.policy: Policy | None = None
        #: Number of foreign monitors under the task. A retry does not end them.
        self.foreign_monitors = 0
        #: Number of exception handlers of the task that have ended, and whose decisions are not
        #: processed yet. Until then the task must not end, because it may still fail again.
        self.unprocessed_decisions = 0

    @staticmethod
    def of(task: Task) -> "Recovery":
        """Return the task's ``Recovery``, creating it on first use."""
        if task.recovery is None:
            task.recovery = Recovery()
        return task.recovery


class Policy(Stored):
    """A task's retry policy at work."""

    __slots__ = ("declared", "replacement", "task", "timer")

    def __init__(self, task: Task, declared: RetryPolicy) -> None:
        self.task, self.declared = task, declared
        #: The context of the fallback. Set when the last attempt has failed, until the fallback is
        #: sent.
        self.replacement: Context | None = None
        self.timer: Timer | None = None  #: when the running attempt takes too long

    @staticmethod
    def of(task: Task) -> "Policy | None":
        """Return the task's retry policy; None without any."""
        return task.recovery.policy if task.recovery is not None else None

    @staticmethod
    def is_replaced(task: Task) -> bool:
        """Whether the fallback of a task's policy is to be sent in place of its next attempt."""
        policy = Policy.of(task)
        return policy is not None and policy.replacement is not None

    @property
    def has_attempts_left(self) -> bool:
        """Whether the policy allows another attempt."""
        return Recovery.of(self.task).attempts < self.declared.attempts

    @property
    def pause(self) -> float:
        """The seconds from the failure of the present attempt to the next attempt."""
        pause, longest = self.declared.pause, self.declared.longest_pause
        for _ in range(Recovery.of(self.task).attempts - 1):
            if pause >= longest:
                break
            pause *= self.declared.backoff
        return min(pause, longest)

    def allow_no_retry(self) -> None:
        """Have the present attempt be the last."""
        self.declared = msgspec.structs.replace(self.declared, attempts=0)

    def begin_attempt(self, clock: Clock) -> None:
        """Start the timer of an attempt: a handler has the task."""
        if self.declared.attempt_timeout:
            clock.cancel(self.timer)  # of a handler that has left
            self.timer = clock.after(self.declared.attempt_timeout, Due.ATTEMPT, self)


class Tapping(Stored):
    """The wiretaps of one task, and the wiretaps that have fired for it.

    Wiretaps of the task's message fire for the task too.
    """

    __slots__ = ("fired", "is_firing", "listeners", "taps")

    def __init__(self) -> None:
        self.taps: list[Wiretap] = []  #: of this task alone, oldest first
        #: By id of a wiretap that has fired before a moment of the task: whether its listener had a
        #: handler.
        self.fired: dict[int, bool] = {}
        #: Whether wiretaps are about to fire. The task reaches no moment before they have fired.
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
        #: By scheduled event: the timer, or the task whose moment the event waits for.
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
    source: str  #: the state of the task before the change
    serial: int  #: the serial number of the change, as it was sent to the handler
    module: str  #: the name of the client
    text: str
    body: bytes  #: the new goal of an update
    needs_decision: bool  #: whether the handler decides about the request


class Clients(Stored):
    """The requests of clients for a task, and its newest intermediate result."""

    __slots__ = ("asked", "ending", "newest", "progress")

    def __init__(self) -> None:
        #: Requests since the handler's last change of state, oldest first.
        self.asked: list[ClientRequest] = []
        self.newest = 0  #: the serial number of the newest request
        self.progress = b""  #: the newest intermediate result
        self.ending = ""  #: the transition by which the handler that has returned ends the task

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
        self.by: dict[Module, None] = {}  #: the modules that want the task retained
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
    """The record of an ended task, retained for a module."""

    __slots__ = ("body", "end", "id", "message", "outcome", "parent", "retention", "role")

    def __init__(self, task: Task, outcome: TaskOutcome, retention: Retention) -> None:
        self.id, self.message, self.role = task.id, task.message, task.role
        self.body, self.outcome = task.body, outcome
        self.end = task.end_state  #: its final state, if its outcome does not tell
        self.parent: Task | TaskRecord | None = task.parent  #: a living task or a record
        self.retention = retention
        for child in retention.records.values():
            child.parent = self

    @property
    def size(self) -> int:
        """The number of bytes of data, result and failure text in the record."""
        return held_size(self.body) + len(self.outcome[2]) + held_size(self.outcome[3])

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
        #: The messages that the monitor sends: condition and action. A monitor that modules fire
        #: (*demon monitor*) sends other ones: set-up, action and cancel.
        self.parts = parts
        #: Whether the monitor was not sent by the handling of its parent (watches.py).
        self.is_foreign_monitor = is_foreign_monitor
        self.watching_since: float | None = None  #: when it began to watch; None: not yet
        self.periods_from = 0.0  #: the time from which its periods are counted
        self.tests_owed = 0  #: number of tests that modules have asked for, not yet made
        self.condition: Delivery | None = None  #: the query of the present test
        self.last_result: bool | None = None  #: result of the last test
        self.times_met = 0  #: how often its condition held, or it was fired
        self.actions_sent = 0  #: number of actions sent
        self.timers: dict[Due, Timer] = {}
        self.waits_for: Task | None = None  #: the task whose moment ends the monitor
        self.is_over = False

    @property
    def is_on(self) -> bool:
        """Whether it watches now."""
        return self.watching_since is not None and not self.is_over

    @property
    def header(self) -> Watching:
        """The context of its messages: the monitor, and the name of a demon monitor's action."""
        action = None if self.task.message.message_class.has_condition else self.parts[_ACTION]
        return Watching(involved(self.task), action.name if action is not None else "")


# --- about tasks ----------------------------------------------------------------------------------


class Verdict(NamedTuple):
    """The reason why a task is killed."""

    why: str
    by: str = CENTRAL  #: the module that wants the kill, or central
    origin: int = 0  #: the delivery whose handler asked for the kill (0: none)
    failed: TaskId = ROOT  #: if the reason is an unhandled failure: the failing task


def involved(delivery: Delivery) -> Involved:
    """Return a message's id and name for other modules.

    The id is 0 for the root, and for messages that are not tasks.
    """
    if not isinstance(delivery, Task):
        return Involved(ROOT, delivery.message.name)
    return Involved(delivery.id, delivery.message.name if delivery.id else "")


def place_of(attachment: AttachedHandler | Wiretap) -> Task | MessageType:
    """Return the task or message type that an exception handler or wiretap is attached to."""
    assert isinstance(attachment.place, Task | MessageType)
    return attachment.place


def held_bytes(asked: list[ClientRequest]) -> int:
    """Return the bytes that clients' requests hold."""
    return sum(DELIVERY_BYTES + held_size(one.body) for one in asked)
