"""The tree of live tasks: parents, children, lineage. Knows nothing of constraints, resources or messages' meaning.

Only tasks that have not ended are here; what has ended lives on in the journal.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from tca_central.errors import RequestError
from tca_central.model.budget import DELIVERY_BYTES, TASK_BYTES
from tca_central.model.deliveries import AttachedHandler, Connection, Delivery, MessageType, Module, Wiretap
from tca_central.model.stored import Stored
from tca_wire.points import ALL_MOMENTS, ROOT, START_HANDLING, STARTS, TaskId
from tca_wire.vocabulary import CENTRAL, Outcome, Refusal, Role


class ClientRequest(NamedTuple):
    """A transition that a client has taken of a task."""

    name: str
    source: str  #: the state in which the task was
    serial: int  #: that it got, and that the handler was told
    module: str  #: the client's
    text: str
    body: bytes  #: the new goal, if it is for one
    is_told: bool  #: the handler decides


class Rare(Stored):
    """Attributes that few tasks need: most tasks do without this object."""

    __slots__ = (
        "asked",
        "attached",
        "attempts",
        "client_serial",
        "ended_followers",
        "farewells",
        "fired",
        "guests",
        "invocations",
        "is_guest",
        "is_resolved",
        "is_tapped",
        "is_void",
        "kept",
        "kept_by",
        "listeners",
        "pending",
        "progress",
        "recovering",
        "retry_askers",
        "retry_targets",
        "taps",
        "unheard",
        "watch",
    )  # fmt: skip

    def __init__(self) -> None:
        self.attached: list[AttachedHandler] = []  #: its exception handlers, newest last
        self.asked: list[ClientRequest] = []  #: transitions of clients since the handler's last one, oldest first
        self.client_serial = 0  #: of the newest of these
        self.progress = b""  #: its newest intermediate result
        self.invocations: dict[int, int] = {}  #: how often each exception handler that holds here was called
        self.attempts = 1  #: how often it is being or has been handled
        self.recovering: Task | None = None  #: the exception handler that decides on it
        self.taps: list[Wiretap] = []  #: its own wiretaps, oldest first
        self.fired: dict[int, bool] = {}  #: wiretaps fired before a moment of it -> whether the listener was handled
        self.is_tapped = False  #: wiretaps are about to be fired: it does not go on meanwhile
        self.listeners: list[Task] = []  #: that are killed with it
        self.watch: Any = None  #: of a monitor: its state
        self.is_void = False  #: of an exception handler: it decides nothing any more (it has reissued, or was killed)
        self.is_resolved = False  #: of an exception handler: if it ends well its failure has been dealt with
        self.unheard = 0  #: number of its exception handlers that have just ended: it may fail again for what they say
        self.farewells: list[tuple[MessageType, bytes]] = []  #: to be sent when it is killed
        self.pending: dict[Any, Any] = {}  #: planned events -> the timer, or the task at which each waits
        self.ended_followers = 0  #: number of its followers that were killed while they waited, and have ended
        self.retry_askers: dict[Task, None] = {}  #: the exception handlers that want it retried, and have not ended
        self.retry_targets: list[Task] = []  #: of an exception handler: the tasks that it wants retried
        self.is_guest = False  #: of a monitor: others than its parent's handler put it there (watching/watches.py)
        self.guests = 0  #: number of such children
        self.kept_by: dict[Module, None] = {}  #: the modules that want it remembered
        self.kept: dict[int, KeptTask] = {}  #: records of ended tasks that hang under it, oldest end first


class Task(Delivery):
    """A node of the task tree, from arrival to end. Its state follows from ``reached``, ``returned`` and ``killed``."""

    is_task = True

    __slots__ = ("children", "delayed", "depth", "failure", "followers", "held", "ignores_parent",
                 "is_dealt_with", "is_goal", "is_watcher", "killed", "last_child",
                 "leaders", "parent", "rare", "reached", "requested", "result", "retrying",
                 "returned", "serial", "size", "state", "survives", "suspended", "unplanned", "waiters",
                 "watchers")  # fmt: skip

    id: TaskId

    def __init__(self, task_id: TaskId, message: MessageType, body: bytes, sender: Connection | None) -> None:
        Delivery.__init__(self, task_id, message, body, sender)
        self.is_goal = message.is_goal
        self.state = message.initial  #: of its life cycle; the last one is told when it has ended
        self.serial = 0  #: number of changes of that
        self.ignores_parent = False  #: may start before its parent does
        self.is_watcher = False  #: a monitor that its parent does not wait for: it ends when all else there has
        self.watchers: dict[int, Task] | None = None  #: such children
        self.survives = False  #: is not killed when something above it is
        self.delayed = False  #: its planning starts when its achieving does (DELAY_PLANNING)
        self.parent: Task | None = None  #: None: the root
        self.depth = 0  #: number of tasks from the top of the tree, it included
        self.children: dict[int, Task] | None = None  #: those that have not ended, oldest first
        self.last_child: Task | None = None  #: the one that constraint flags of the next child refer to
        self.unplanned = 0  #: number of children that are not planned yet
        self.reached = 0  #: moments reached, as bits
        self.held = 0  #: unmet constraints per moment, packed (holds.py)
        self.followers: list[tuple[int, Task, int, float]] | None = None  #: (moment, task, its moment, delay) that wait
        self.leaders: list[tuple[int, int, int]] | None = None  #: (moment, task id, its moment) that this one waits for
        self.requested = False  #: all conditions of its start are met: it was given to the resources
        self.suspended = False
        self.retrying = False  #: is to be handled once more, when all under it has ended
        self.returned = False  #: its handler has returned, or will never be called
        self.killed = ""  #: why it was killed, and by whom
        self.failure: tuple[str, str, bytes] | None = None  #: name, text and data of the failure raised on it
        self.is_dealt_with = False  #: an exception handler took care of that failure
        self.result = b""  #: its handler's result
        self.waiters: dict[Any, int] | None = None  #: waits for it -> the moment of each; oldest first
        self.rare: Rare | None = None
        self.size = TASK_BYTES + len(body)  #: bytes that it counts for in the budget

    def __repr__(self) -> str:
        return f"task {self.id} '{self.message.name}'"

    @property
    def more(self) -> Rare:
        """The rarely needed attributes; made when first asked for."""
        if self.rare is None:
            self.rare = Rare()
        return self.rare

    @property
    def is_guest(self) -> bool:
        """Whether it is a monitor that others have put under its parent: it outlives the retry of that."""
        return self.rare is not None and self.rare.is_guest

    @property
    def may_be_handled_again(self) -> bool:
        """Whether all has ended that a retry waits for: handler, children but guests, exception handlers that asked."""
        rare, children = self.rare, len(self.children or ())
        if rare is None:
            return not (self.is_running or children)
        return not (self.is_running or rare.retry_askers or rare.unheard) and children == rare.guests

    @property
    def watches_alone(self) -> bool:
        """Whether its handler has returned and only watchers are left under it."""
        if self.rare is not None and self.rare.unheard:
            return False
        return self.returned and len(self.children or ()) == len(self.watchers or ()) > 0

    def recoveries(self) -> "list[Task]":
        """The exception handlers that it is, or is under, nearest first."""
        found, exception = [], Role.EXCEPTION
        task: Task | None = self
        while task is not None:
            if task.role is exception:
                found.append(task)
            task = task.parent
        return found

    @property
    def is_running(self) -> bool:
        """Whether a handler has it."""
        return self.slot is not None

    def lineage(self) -> Iterator["Task"]:
        """This task, its parent and so on; the root left out."""
        task: Task | None = self
        while task is not None and task.id != ROOT:
            yield task
            task = task.parent

    def above(self, number: int) -> "Task | None":
        """The task of that number, if it is this one or above it. Stops at an older task: its parent is older still."""
        task: Task | None = self
        while task is not None and task.id > number:
            task = task.parent
        return task if task is not None and ROOT < task.id == number else None


class Verdict(NamedTuple):
    """Why a task is killed."""

    why: str
    by: str = CENTRAL  #: the module that wants it, or central
    origin: int = 0  #: the delivery whose handler asked for it (0: none)
    failed: TaskId = ROOT  #: the task whose failure nobody handled, if it is for that


class KeptTask(Stored):
    """The record of an ended task that is kept."""

    __slots__ = ("body", "id", "kept", "kept_by", "message", "outcome", "parent", "role")

    def __init__(self, task: Task, outcome: tuple[Outcome, str, str, bytes], rare: Rare) -> None:
        self.id, self.message, self.role, self.body, self.outcome = task.id, task.message, task.role, task.body, outcome
        self.parent: Task | KeptTask | None = task.parent  #: its parent, living or kept
        self.kept_by = rare.kept_by
        self.kept = rare.kept  #: the records under it
        for child in self.kept.values():
            child.parent = self

    @property
    def size(self) -> int:
        """Bytes that it holds of what modules sent."""
        return len(self.body) + len(self.outcome[2]) + len(self.outcome[3])

    @property
    def siblings(self) -> dict[int, "KeptTask"]:
        """The records under its parent."""
        assert self.parent is not None
        return self.parent.more.kept if isinstance(self.parent, Task) else self.parent.kept

    def lineage(self) -> Iterator["Task | KeptTask"]:
        """This record and its ancestors, without the root."""
        one: Task | KeptTask | None = self
        while one is not None and one.id != ROOT:
            yield one
            one = one.parent


class TaskTree(Stored):
    """All live tasks by id, under a root that is always being achieved."""

    __slots__ = ("across", "bytes", "last_of_module", "never_began", "newest", "root", "suspended", "tasks",
                 "top_of_module")  # fmt: skip

    def __init__(self, root_message: MessageType) -> None:
        self.root = Task(ROOT, root_message, b"", None)
        self.root.reached = STARTS
        self.tasks: dict[int, Task] = {}
        self.bytes = 0  #: that all tasks hold
        self.suspended: dict[int, tuple[float, str, bool]] = {}
        """The tasks that were suspended themselves, oldest first: since when, by whom, and whether from birth on."""
        self.across: dict[Task, None] = {}  #: from which edges have led to others than siblings (cycles.py)
        self.never_began: dict[int, int] = {}  #: of killed tasks whose outcome is known: the starts that never were
        self.newest = 0  #: the highest id given so far
        self.last_of_module: dict[Module | None, Task] = {}  #: last top-level task per sending module
        self.top_of_module: dict[Module | None, dict[int, Task]] = {}  #: living top-level tasks per sending module

    def task(self, task_id: TaskId) -> Task | None:
        """The live task of that id; None if it has ended. Raises RequestError if there has never been one."""
        task = self.tasks.get(task_id)
        if task is None and not ROOT < task_id <= self.newest:
            raise RequestError(Refusal.UNKNOWN, f"there is no task {task_id}")
        return task

    def last_sibling(self, parent: Task, sender: Module | None) -> Task | None:
        """The task that flags of a new child refer to. Under the root each module has its own sequence."""
        last = self.last_of_module.get(sender) if parent is self.root else parent.last_child
        return last if last is not None and last.reached != ALL_MOMENTS else None

    def attach(self, task: Task, parent: Task) -> None:
        """Hang a new task under its parent."""
        task.parent, task.depth = parent, parent.depth + 1
        self.bytes += task.size
        if parent.children is None:
            parent.children = {}
        parent.children[task.id] = self.tasks[task.id] = task
        if task.is_watcher:
            if parent.watchers is None:
                parent.watchers = {}
            parent.watchers[task.id] = task
        if task.rare is not None and task.rare.is_guest:
            parent.more.guests += 1

    def become_last(self, task: Task, parent: Task, sender: Module | None) -> None:
        """A task is there for good: from now on flags refer to it, if a module sent it."""
        if is_aside(task):
            return
        if parent is self.root:
            self.last_of_module[sender] = task
            if sender not in self.top_of_module:
                self.top_of_module[sender] = {}
            self.top_of_module[sender][task.id] = task
        else:
            parent.last_child = task

    def grow(self, task: Task, size: int) -> None:
        """A task holds so much more, or less."""
        task.size += size
        if task.id in self.tasks:
            self.bytes += size

    def set_progress(self, task: Task, body: bytes) -> None:
        """The newest intermediate result."""
        self.grow(task, len(body) - len(task.more.progress))
        task.more.progress = body

    def ask(self, task: Task, asked: ClientRequest) -> None:
        """Remember what a client has asked for."""
        task.more.asked.append(asked)
        task.more.client_serial = asked.serial
        self.grow(task, DELIVERY_BYTES + len(asked.body))

    def forget_asked(
        self, task: Task, is_over: Callable[[ClientRequest], bool] = lambda _: True
    ) -> list[ClientRequest]:  # fmt: skip
        """What clients have asked for, which is remembered no longer: all that *is over*."""
        if task.rare is None or not task.rare.asked:
            return []
        asked = [one for one in task.rare.asked if is_over(one)]
        task.rare.asked = [one for one in task.rare.asked if one not in asked]
        self.grow(task, -sum(DELIVERY_BYTES + len(one.body) for one in asked))
        return asked

    def set_failure(self, task: Task, failure: tuple[str, str, bytes] | None) -> None:
        """The failure that was raised on a task last; nobody has dealt with it."""
        self.grow(task, failure_size(failure) - failure_size(task.failure))
        task.failure, task.is_dealt_with = failure, False

    def detach(self, task: Task) -> None:
        """Take an ended task out."""
        del self.tasks[task.id]
        self.bytes -= task.size
        if self.suspended:
            self.suspended.pop(task.id, None)
        if self.across:
            self.across.pop(task, None)
        parent = task.parent
        if parent is None or parent.children is None:
            return
        del parent.children[task.id]
        if parent.watchers and task.is_watcher:
            del parent.watchers[task.id]
        if task.rare is not None and task.rare.is_guest:
            parent.more.guests -= 1
        if parent is self.root:
            self._detach_top(task, sending_module(task))
            return
        if parent.last_child is task:
            parent.last_child = _newest_child(parent.children) if task.killed and parent.children else None

    def _detach_top(self, task: Task, sender: Module | None) -> None:
        """After a killed top-level task flags refer to the living one that the same module sent before it."""
        others = self.top_of_module.get(sender)
        if others is None or others.pop(task.id, None) is None:
            return  # it stood aside
        if self.last_of_module.get(sender) is task:
            del self.last_of_module[sender]
            if task.killed and others:
                self.last_of_module[sender] = _newest(others)
        if not others:
            del self.top_of_module[sender]

    def forget_module(self, sender: Module) -> None:
        """A module is gone; its next namesake starts a sequence of its own."""
        self.last_of_module.pop(sender, None)

    @staticmethod
    def subtree(task: Task, *, doomed: bool = False) -> Iterator[Task]:
        """*task* and all below it, or only what dies with it if *doomed*, parents first. The tree must not change."""
        stack = [task]
        while stack:
            node = stack.pop()
            yield node
            if node.children:
                stack.extend(one for one in reversed(node.children.values()) if not (doomed and one.survives))


def failure_size(failure: tuple[str, str, bytes] | None) -> int:
    """Bytes that a failure holds."""
    return 0 if failure is None else len(failure[1]) + len(failure[2])


def taps_of(delivery: Delivery) -> list[Wiretap]:
    """The wiretaps of a task and of its message; none for a listener of a wiretap."""
    taps = delivery.message.taps
    if isinstance(delivery, Task) and delivery.rare is not None and delivery.rare.taps:
        taps = delivery.rare.taps + taps
    if not taps:
        return taps
    sent_for = delivery.context.task.role if delivery.role.is_of_monitor else delivery.role
    return [] if sent_for is Role.LISTENER else taps


def first_moments(task: Task) -> int:
    """The moments that a task reaches when it is given to a handler; given to another one later, it is handled anew."""
    if task.reached & START_HANDLING:
        return START_HANDLING
    return STARTS if task.delayed else task.message.rules.delivery


def to_be_fired(task: Task, moments: int) -> list[Wiretap]:
    """The wiretaps still to be fired before *moments*; again those whose listener had no handler and now has."""
    fired = task.rare.fired if task.rare else {}
    return [
        tap
        for tap in taps_of(task)
        if tap.before & moments and (tap.id not in fired or (not fired[tap.id] and tap.listener.handlers))
    ]


def is_aside(task: Task) -> bool:
    """Whether it stands beside the sequence of its siblings: constraint flags never refer to it."""
    return bool(task.role) or task.message.is_aside


def _newest_child(children: dict[int, Task]) -> Task | None:
    """After a killed last child flags refer to the sibling before it, not to nothing."""
    _newest(children)
    return next((one for one in reversed(children.values()) if not is_aside(one)), None)


def _newest(siblings: dict[int, Task]) -> Task:
    """The one that came last of those that are left."""
    number, task = siblings.popitem()  # which clears the places of all that came later and have ended
    siblings[number] = task
    return task


def sending_module(task: Task) -> Module | None:
    """The module that sent a task, which may have gone; None for central. A namesake that comes later is another."""
    return task.sender.module if task.sender else None
