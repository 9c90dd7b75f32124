"""Tasks: the nodes of the tree, and the parts that only some of them have.

What every task needs stands in a chain of classes, one a concern: ``Queued`` and ``Delivery``
(deliveries.py), then ``Node``, ``Ordered`` and ``Task``. What few need stands in parts, which are
made when they are first needed.
"""

from collections.abc import Iterator
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
"""Name, text and data of a failure that was raised on a task."""

TaskOutcome = tuple[Outcome, str, str, bytes]
"""The outcome of a task, the name and text of its failure, and the failure's data or the result."""

_ACTION = 1  # which part of a monitor


class Node(Delivery):
    """A place in the tree: what is above it, and what is below."""

    __slots__ = (
        "children",
        "depth",
        "is_watcher",
        "last_child",
        "parent",
        "sequence",
        "unplanned",
        "watchers",
    )

    def __init__(
        self, task_id: TaskId, message: MessageType, body: bytes, sender: Connection | None
    ) -> None:
        Delivery.__init__(self, task_id, message, body, sender)
        self.parent: Task | None = None  #: None: the root
        self.depth = 0  #: number of tasks from the top of the tree, it included
        self.is_watcher = (
            False  #: a monitor that its parent does not wait for: it ends when all else there has
        )
        self.children: dict[int, Task] | None = None  #: those that have not ended, oldest first
        self.watchers: dict[int, Task] | None = None  #: those of them that are watchers
        self.unplanned = 0  #: number of children that are not planned yet
        self.last_child: Task | None = (
            None  #: the one that constraint flags of the next child refer to
        )
        self.sequence: dict[int, Task] | None = (
            None  #: its children but those aside, once the newest was killed
        )


class Ordered(Node):
    """A node that has moments, and constraints that hold them."""

    __slots__ = ("delayed", "followers", "held", "leaders", "reached", "waiters")

    def __init__(
        self, task_id: TaskId, message: MessageType, body: bytes, sender: Connection | None
    ) -> None:
        Node.__init__(self, task_id, message, body, sender)
        self.reached = 0  #: moments reached, as bits
        self.delayed = False  #: its planning starts when its achieving does (DELAY_PLANNING)
        self.held = 0  #: unmet constraints per moment, packed (holds.py)
        self.followers: list[tuple[int, Task, int, float]] | None = (
            None  #: (moment, task, its moment, delay) that wait
        )
        self.leaders: list[tuple[int, int, int]] | None = (
            None  #: (moment, task id, its moment) that this one waits for
        )
        self.waiters: dict[Stored, int] | None = (
            None  #: waits for it -> the moment of each; oldest first
        )


class Task(Ordered):
    """A task from arrival to end. How far it is follows from ``reached``, ``returned`` and
    ``killed``.
    """

    is_task = True

    __slots__ = (
        "clients",
        "is_goal",
        "keeping",
        "killed",
        "plans",
        "recovery",
        "requested",
        "result",
        "retrying",
        "returned",
        "serial",
        "size",
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
        self.state = message.initial  #: of its life cycle; the last one is told when it has ended
        self.serial = 0  #: number of changes of that
        self.requested = (
            False  #: all conditions of its start are met: it was given to the resources
        )
        self.suspended = False
        self.retrying = False  #: is to be handled once more, when all under it has ended
        self.returned = False  #: its handler has returned, or will never be called
        self.killed = ""  #: why it was killed, and by whom
        self.result = b""  #: its handler's result
        self.size = TASK_BYTES + len(body)  #: bytes that it counts for in the budget
        self.recovery: Recovery | None = None
        self.tapping: Tapping | None = None
        self.plans: Plans | None = None
        self.watch: Watch | None = None  #: of a monitor
        self.clients: Clients | None = None
        self.keeping: Keeping | None = None

    def __repr__(self) -> str:
        return f"task {self.id} '{self.message.name}'"

    @property
    def has_parts(self) -> bool:
        """Whether it has any of the parts that few tasks need."""
        parts = (self.recovery, self.tapping, self.plans, self.watch, self.clients, self.keeping)
        return any(one is not None for one in parts)

    @property
    def attached(self) -> list[AttachedHandler]:
        """Its exception handlers, newest last."""
        return self.recovery.attached if self.recovery is not None else []

    @property
    def taps(self) -> list[Wiretap]:
        """Its own wiretaps, oldest first."""
        return self.tapping.taps if self.tapping is not None else []

    @property
    def failure(self) -> Failure | None:
        """The failure that was raised on it last."""
        return self.recovery.failure if self.recovery is not None else None

    @property
    def is_dealt_with(self) -> bool:
        """Whether an exception handler took care of that failure."""
        return self.recovery is not None and self.recovery.is_dealt_with

    @property
    def is_guest(self) -> bool:
        """Whether it is a monitor that others have put under its parent: it outlives the retry of
        that.
        """
        return self.watch is not None and self.watch.is_guest

    @property
    def ignores_parent(self) -> bool:
        """Whether it may start before its parent does: central has made it."""
        return bool(self.role)

    @property
    def is_unheard(self) -> bool:
        """Whether exception handlers of it have just ended: it may fail again for what they say."""
        return self.recovery is not None and self.recovery.unheard > 0

    @property
    def may_be_handled_again(self) -> bool:
        """Whether all has ended that a retry waits for: handler, children but guests, exception
        handlers that asked.
        """
        recovery, children = self.recovery, len(self.children or ())
        if recovery is None:
            return not (self.is_running or children)
        return (
            not (self.is_running or recovery.askers or recovery.unheard)
            and children == recovery.guests
        )

    @property
    def watches_alone(self) -> bool:
        """Whether its handler has returned and only watchers are left under it."""
        if self.is_unheard:
            return False
        return self.returned and len(self.children or ()) == len(self.watchers or ()) > 0

    @property
    def is_running(self) -> bool:
        """Whether a handler has it."""
        return self.slot is not None

    @property
    def handler(self) -> Handler | None:
        """The handler that has it; None if none has."""
        return self.slot.module.handlers.get(self.message.name) if self.slot is not None else None

    def recoveries(self) -> "list[Task]":
        """The exception handlers that it is, or is under, nearest first."""
        found, exception = [], Role.EXCEPTION
        task: Task | None = self
        while task is not None:
            if task.role is exception:
                found.append(task)
            task = task.parent
        return found

    def lineage(self) -> Iterator["Task"]:
        """This task, its parent and so on; the root left out."""
        task: Task | None = self
        while task is not None and task.id != ROOT:
            yield task
            task = task.parent

    def above(self, number: int) -> "Task | None":
        """The task of that number, if it is this one or above it. Stops at an older task: its
        parent is older still.
        """
        task: Task | None = self
        while task is not None and task.id > number:
            task = task.parent
        return task if task is not None and ROOT < task.id == number else None


# --- parts ----------------------------------------------------------------------------------------


class Recovery(Stored):
    """The failure of a task, and what is done about it; and the exception handlers attached to the
    task.
    """

    __slots__ = (
        "askers",
        "attached",
        "attempts",
        "failure",
        "guests",
        "handler",
        "invocations",
        "is_dealt_with",
        "unheard",
    )

    def __init__(self) -> None:
        self.attached: list[AttachedHandler] = []  #: newest last
        self.invocations: dict[
            int, int
        ] = {}  #: how often each exception handler that holds here was called
        self.failure: Failure | None = None  #: the one raised last
        self.is_dealt_with = False  #: an exception handler took care of it
        self.handler: Task | None = None  #: the exception handler that decides
        self.attempts = 1  #: how often the task is being or has been handled
        self.askers: dict[
            Task, None
        ] = {}  #: the exception handlers that want it retried, and have not ended
        self.guests = 0  #: number of monitors under it that outlive its retry: see Watch
        self.unheard = 0  #: number of its exception handlers that have just ended: it may fail again for what they say

    @staticmethod
    def of(task: Task) -> "Recovery":
        """The one of a task."""
        if task.recovery is None:
            task.recovery = Recovery()
        return task.recovery


class Tapping(Stored):
    """The wiretaps of a task, and those of its message as far as they concern it."""

    __slots__ = ("fired", "is_firing", "listeners", "taps")

    def __init__(self) -> None:
        self.taps: list[Wiretap] = []  #: its own, oldest first
        self.fired: dict[
            int, bool
        ] = {}  #: wiretaps fired before a moment of it -> whether the listener was handled
        self.is_firing = False  #: wiretaps are about to be fired: it does not go on meanwhile
        self.listeners: list[Task] = []  #: that are killed with it

    @staticmethod
    def of(task: Task) -> "Tapping":
        """The one of a task."""
        if task.tapping is None:
            task.tapping = Tapping()
        return task.tapping


class Plans(Stored):
    """What lies ahead of a task."""

    __slots__ = ("farewells", "pending")

    def __init__(self) -> None:
        self.pending: dict[
            Stored, Timer | Task
        ] = {}  #: planned events -> the timer, or the task at which each waits
        self.farewells: list[tuple[MessageType, bytes]] = []  #: to be sent when it is killed

    @staticmethod
    def of(task: Task) -> "Plans":
        """Those of a task."""
        if task.plans is None:
            task.plans = Plans()
        return task.plans


class ClientRequest(NamedTuple):
    """A transition that a client has taken of a task."""

    name: str
    source: str  #: the state in which the task was
    serial: int  #: that it got, and that the handler was told
    module: str  #: the client's
    text: str
    body: bytes  #: the new goal, if it is for one
    is_told: bool  #: the handler decides


class Clients(Stored):
    """What clients of a task want, and what they were shown."""

    __slots__ = ("asked", "newest", "progress")

    def __init__(self) -> None:
        self.asked: list[
            ClientRequest
        ] = []  #: transitions of clients since the handler's last one, oldest first
        self.newest = 0  #: the serial number of the newest of these
        self.progress = b""  #: the newest intermediate result

    @staticmethod
    def of(task: Task) -> "Clients":
        """Those of a task."""
        if task.clients is None:
            task.clients = Clients()
        return task.clients


class Keeping(Stored):
    """What is remembered of a task, or record, and of those under it."""

    __slots__ = ("by", "records")

    def __init__(self) -> None:
        self.by: dict[Module, None] = {}  #: the modules that want it remembered
        self.records: dict[
            int, KeptTask
        ] = {}  #: of ended tasks that hang under it, oldest end first

    @staticmethod
    def of(place: "Task | KeptTask") -> "Keeping":
        """The one of a task, living or ended."""
        if place.keeping is None:
            assert isinstance(place, Task)
            place.keeping = Keeping()
        return place.keeping


class KeptTask(Stored):
    """The record of an ended task that is kept."""

    __slots__ = ("body", "id", "keeping", "message", "outcome", "parent", "role")

    def __init__(self, task: Task, outcome: TaskOutcome, keeping: Keeping) -> None:
        self.id, self.message, self.role, self.body, self.outcome = (
            task.id,
            task.message,
            task.role,
            task.body,
            outcome,
        )
        self.parent: Task | KeptTask | None = task.parent  #: its parent, living or kept
        self.keeping = keeping
        for child in keeping.records.values():
            child.parent = self

    @property
    def size(self) -> int:
        """Bytes that it holds of what modules sent."""
        return len(self.body) + len(self.outcome[2]) + len(self.outcome[3])

    @property
    def siblings(self) -> "dict[int, KeptTask]":
        """The records under its parent."""
        assert self.parent is not None
        return Keeping.of(self.parent).records

    def lineage(self) -> "Iterator[Task | KeptTask]":
        """This record and its ancestors, without the root."""
        one: Task | KeptTask | None = self
        while one is not None and one.id != ROOT:
            yield one
            one = one.parent


class Watch(Stored):
    """A monitor from its birth to its end."""

    __slots__ = (
        "activations",
        "began",
        "condition",
        "count",
        "fires",
        "holds",
        "is_guest",
        "is_over",
        "options",
        "parts",
        "since",
        "task",
        "timers",
        "waits_for",
    )

    def __init__(
        self,
        task: Task,
        options: WatchOptions,
        parts: list[MessageType | None],
        is_guest: bool = False,
    ) -> None:
        self.task = task
        self.options = options
        self.parts = parts  #: condition and action; of a demon: set-up, action and cancel
        self.is_guest = (
            is_guest  #: others than its parent's handler put it there (watching/watches.py)
        )
        self.began: float | None = None  #: when it began to watch
        self.since = 0.0  #: from when its periods are counted
        self.activations = 0  #: how often it is to test because it was fired
        self.condition: Delivery | None = None  #: the test under way
        self.holds: bool | None = None  #: how the last test came out
        self.count = 0  #: how often its condition held, or it was fired
        self.fires = 0  #: how many actions it has sent
        self.timers: dict[Due, Timer] = {}
        self.waits_for: Task | None = None  #: whose point is its end
        self.is_over = False

    @property
    def is_on(self) -> bool:
        """Whether it watches now."""
        return self.began is not None and not self.is_over

    @property
    def header(self) -> Watching:
        """The context of its messages: the monitor, and what it is fired with."""
        action = None if self.task.message.message_class.has_condition else self.parts[_ACTION]
        return Watching(involved(self.task), action.name if action is not None else "")


# --- about tasks ----------------------------------------------------------------------------------


class Verdict(NamedTuple):
    """Why a task is killed."""

    why: str
    by: str = CENTRAL  #: the module that wants it, or central
    origin: int = 0  #: the delivery whose handler asked for it (0: none)
    failed: TaskId = ROOT  #: the task whose failure nobody handled, if it is for that


def involved(delivery: Delivery) -> Involved:
    """A message as others are told of it; task 0 if it is none, or the root."""
    if not isinstance(delivery, Task):
        return Involved(ROOT, delivery.message.name)
    return Involved(delivery.id, delivery.message.name if delivery.id else "")


def place_of(one: AttachedHandler | Wiretap) -> Task | MessageType:
    """The task or message that something is attached to."""
    assert isinstance(one.place, Task | MessageType)
    return one.place


def held_bytes(asked: list[ClientRequest]) -> int:
    """Bytes that requests of clients hold."""
    return sum(DELIVERY_BYTES + len(one.body) for one in asked)
