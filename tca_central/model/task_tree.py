"""The tree of live tasks. Knows nothing of constraints, resources or messages' meaning.

Only tasks that have not ended are here; what has ended lives on in the journal.
"""

from collections.abc import Callable, Iterator

from tca_central.errors import RequestError
from tca_central.model.contexts import monitor_of
from tca_central.model.deliveries import Delivery, MessageType, Module, Wiretap
from tca_central.model.stored import Stored
from tca_central.model.tasks import ClientRequest, Clients, Failure, Recovery, Task, held_bytes
from tca_wire.points import ALL_MOMENTS, ROOT, START_HANDLING, STARTS, TaskId
from tca_wire.rules import RULES
from tca_wire.vocabulary import Refusal, Role


class TaskTree(Stored):
    """All live tasks by id, under a root that is always being achieved."""

    __slots__ = (
        "across",
        "bytes",
        "last_of_module",
        "never_began",
        "newest",
        "root",
        "suspended",
        "tasks",
        "top_of_module",
    )

    def __init__(self, root_message: MessageType) -> None:
        self.root = Task(ROOT, root_message, b"", None)
        self.root.reached = STARTS
        self.tasks: dict[int, Task] = {}
        self.bytes = 0  #: that all tasks hold
        self.suspended: dict[int, tuple[float, str, bool]] = {}
        """The tasks that were suspended themselves, oldest first: since when, by whom, and whether
        from birth on.
        """
        self.across: dict[
            Task, None
        ] = {}  #: from which edges have led to others than siblings (cycles.py)
        self.never_began: dict[
            int, int
        ] = {}  #: of killed tasks whose outcome is known: the starts that never were
        self.newest = 0  #: the highest id given so far
        self.last_of_module: dict[
            Module | None, Task
        ] = {}  #: last top-level task per sending module
        self.top_of_module: dict[
            Module | None, dict[int, Task]
        ] = {}  #: living top-level tasks per sending module

    def task(self, task_id: TaskId) -> Task | None:
        """The live task of that id; None if it has ended. Raises RequestError if there has never
        been one.
        """
        task = self.tasks.get(task_id)
        if task is None and not ROOT < task_id <= self.newest:
            raise RequestError(Refusal.UNKNOWN, f"there is no task {task_id}")
        return task

    def last_sibling(self, parent: Task, sender: Module | None) -> Task | None:
        """The task that flags of a new child refer to. Under the root each module has its own
        sequence.
        """
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
        if task.is_guest:
            Recovery.of(parent).guests += 1

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
            if parent.sequence is not None:
                parent.sequence[task.id] = task

    def grow(self, task: Task, size: int) -> None:
        """A task holds so much more, or less."""
        task.size += size
        if task.id in self.tasks:
            self.bytes += size

    def set_progress(self, task: Task, body: bytes) -> None:
        """The newest intermediate result."""
        clients = Clients.of(task)
        self.grow(task, len(body) - len(clients.progress))
        clients.progress = body

    def ask(self, task: Task, asked: ClientRequest) -> None:
        """Remember what a client has asked for."""
        clients = Clients.of(task)
        clients.asked.append(asked)
        clients.newest = asked.serial
        self.grow(task, held_bytes([asked]))

    def forget_asked(
        self, task: Task, is_over: Callable[[ClientRequest], bool] = lambda _: True
    ) -> list[ClientRequest]:
        """What clients have asked for, which is remembered no longer: all that *is over*."""
        clients = task.clients
        if clients is None or not clients.asked:
            return []
        asked = [one for one in clients.asked if is_over(one)]
        clients.asked = [one for one in clients.asked if one not in asked]
        self.grow(task, -held_bytes(asked))
        return asked

    def set_failure(self, task: Task, failure: Failure | None) -> None:
        """The failure that was raised on a task last; nobody has dealt with it."""
        if failure is None and task.recovery is None:
            return
        recovery = Recovery.of(task)
        self.grow(task, failure_size(failure) - failure_size(recovery.failure))
        recovery.failure, recovery.is_dealt_with = failure, False

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
        if task.is_guest:
            Recovery.of(parent).guests -= 1
        if parent is self.root:
            self._detach_top(task, sending_module(task))
            return
        if parent.sequence is not None:
            parent.sequence.pop(task.id, None)
        if parent.last_child is task:
            parent.last_child = _newest_child(parent) if task.killed and parent.children else None

    def _detach_top(self, task: Task, sender: Module | None) -> None:
        """After a killed top-level task flags refer to the living one that the same module sent
        before it.
        """
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
        """*task* and all below it, or only what dies with it if *doomed*, parents first. The tree
        must not change.
        """
        stack = [task]
        while stack:
            node = stack.pop()
            yield node
            if node.children:
                stack.extend(
                    one
                    for one in reversed(node.children.values())
                    if not (doomed and one.role.survives)
                )


def failure_size(failure: Failure | None) -> int:
    """Bytes that a failure holds."""
    return 0 if failure is None else len(failure[1]) + len(failure[2])


def taps_of(delivery: Delivery) -> list[Wiretap]:
    """The wiretaps of a task and of its message; none for a listener of a wiretap."""
    taps = delivery.message.taps
    if isinstance(delivery, Task) and delivery.tapping is not None and delivery.tapping.taps:
        taps = delivery.tapping.taps + taps
    if not taps:
        return taps
    sent_for = monitor_of(delivery).task.role if delivery.role.is_of_monitor else delivery.role
    return [] if sent_for is Role.LISTENER else taps


def first_moments(task: Task) -> int:
    """The moments that a task reaches when it is given to a handler; given to another one later, it
    is handled anew.
    """
    if task.reached & START_HANDLING:
        return START_HANDLING
    return STARTS if task.delayed else RULES[task.message.is_goal].delivery


def to_be_fired(task: Task, moments: int) -> list[Wiretap]:
    """The wiretaps still to be fired before *moments*; again those whose listener had no handler
    and now has.
    """
    fired = task.tapping.fired if task.tapping is not None else {}
    return [
        tap
        for tap in taps_of(task)
        if tap.before & moments
        and (tap.id not in fired or (not fired[tap.id] and tap.listener.handlers))
    ]


def is_aside(task: Task) -> bool:
    """Whether it stands beside the sequence of its siblings: constraint flags never refer to it."""
    return bool(task.role) or task.message.is_aside


def _newest_child(parent: Task) -> Task | None:
    """After a killed last child flags refer to the sibling before it, not to nothing."""
    if parent.sequence is None:
        children = (parent.children or {}).items()
        parent.sequence = {number: child for number, child in children if not is_aside(child)}
    return _newest(parent.sequence) if parent.sequence else None


def _newest(siblings: dict[int, Task]) -> Task:
    """The one that came last of those that are left."""
    number, task = (
        siblings.popitem()
    )  # which clears the places of all that came later and have ended
    siblings[number] = task
    return task


def sending_module(task: Task) -> Module | None:
    """The module that sent a task, which may have gone; None for central. A namesake that comes
    later is another.
    """
    return task.sender.module if task.sender else None
