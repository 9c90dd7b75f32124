"""The tree of live tasks. Knows nothing of constraints, resources or messages' meaning.

Ended tasks are not here: they are in the journal.
"""

from collections.abc import Callable, Iterator

from tca_central.errors import RequestError
from tca_central.model.contexts import monitor_of
from tca_central.model.deliveries import Delivery, MessageType, Module, Wiretap
from tca_central.model.stored import Stored
from tca_central.model.tasks import ClientRequest, Clients, Failure, Recovery, Task, held_bytes
from tca_wire.packets.large import held_size
from tca_wire.points import ALL_MOMENTS, ROOT, START_HANDLING, STARTS, TaskId
from tca_wire.rules import RULES
from tca_wire.vocabulary import Refusal, Role


class TaskTree(Stored):
    """All live tasks by id, under a root that is always being achieved."""

    __slots__ = (
        "bytes",
        "crossing_leaders",
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
        self.bytes = 0  #: bytes of all tasks
        self.suspended: dict[int, tuple[float, str, bool]] = {}
        """By id, oldest first: the tasks on which suspend was called.

        Each value is the time, the module that suspended the task, and whether the task was created
        suspended.
        """
        #: Tasks from which constraints lead to tasks that are not siblings (cycles.py)
        self.crossing_leaders: dict[Task, None] = {}
        #: By killed task whose outcome is stored: the starts that it never reached.
        self.never_began: dict[int, int] = {}
        self.newest = 0  #: the highest id so far
        #: Last top-level task of each sending module.
        self.last_of_module: dict[Module | None, Task] = {}
        #: Living top-level tasks of each sending module.
        self.top_of_module: dict[Module | None, dict[int, Task]] = {}

    def task(self, task_id: TaskId) -> Task | None:
        """Return the live task of that id; None if it has ended.

        Raises RequestError if the id was never given.
        """
        task = self.tasks.get(task_id)
        if task is None and not ROOT < task_id <= self.newest:
            raise RequestError(Refusal.UNKNOWN, f"there is no task {{{task_id}}}")
        return task

    def last_sibling(self, parent: Task, sender: Module | None) -> Task | None:
        """Return the task to which the constraint flags of a new child refer; None if it has ended.

        Under the root each module has a sequence of its own, because modules do not know the tasks
        of other modules.
        """
        last = self.last_of_module.get(sender) if parent is self.root else parent.last_child
        return last if last is not None and last.reached != ALL_MOMENTS else None

    def attach(self, task: Task, parent: Task) -> None:
        """Add a new task under its parent."""
        task.parent, task.depth = parent, parent.depth + 1
        self.bytes += task.size
        if parent.children is None:
            parent.children = {}
        parent.children[task.id] = self.tasks[task.id] = task
        if task.is_background:
            if parent.background_monitors is None:
                parent.background_monitors = {}
            parent.background_monitors[task.id] = task
        if task.is_foreign_monitor:
            Recovery.of(parent).foreign_monitors += 1

    def become_last(self, task: Task, parent: Task, sender: Module | None) -> None:
        """Let flags of the next sibling refer to a task, unless the task is outside the sequence.

        This is separate from ``attach``, because a task may still be refused between the two.
        """
        if is_outside_sequence(task):
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
        """Add *size* bytes to the size of a task. *size* may be negative."""
        task.size += size
        if task.id in self.tasks:
            self.bytes += size

    def set_progress(self, task: Task, body: bytes) -> None:
        """Set the newest intermediate result."""
        clients = Clients.of(task)
        self.grow(task, held_size(body) - held_size(clients.progress))
        clients.progress = body

    def ask(self, task: Task, asked: ClientRequest) -> None:
        """Store a client's request."""
        clients = Clients.of(task)
        clients.asked.append(asked)
        clients.newest = asked.serial
        self.grow(task, held_bytes([asked]))

    def pop_client_requests(
        self, task: Task, is_over: Callable[[ClientRequest], bool] = lambda _: True
    ) -> list[ClientRequest]:
        """Remove and return the requests of clients for which *is_over* is true."""
        clients = task.clients
        if clients is None or not clients.asked:
            return []
        asked = [one for one in clients.asked if is_over(one)]
        clients.asked = [one for one in clients.asked if one not in asked]
        self.grow(task, -held_bytes(asked))
        return asked

    def set_failure(self, task: Task, failure: Failure | None) -> None:
        """Set or clear the failure of a task. A new failure is not resolved yet."""
        if failure is None and task.recovery is None:
            return
        recovery = Recovery.of(task)
        self.grow(task, failure_size(failure) - failure_size(recovery.failure))
        recovery.failure, recovery.is_dealt_with = failure, False

    def detach(self, task: Task) -> None:
        """Remove an ended task."""
        del self.tasks[task.id]
        self.bytes -= task.size
        if self.suspended:
            self.suspended.pop(task.id, None)
        if self.crossing_leaders:
            self.crossing_leaders.pop(task, None)
        parent = task.parent
        if parent is None or parent.children is None:
            return
        del parent.children[task.id]
        if parent.background_monitors and task.is_background:
            del parent.background_monitors[task.id]
        if task.is_foreign_monitor:
            Recovery.of(parent).foreign_monitors -= 1
        if parent is self.root:
            self._detach_top(task, sending_module(task))
            return
        if parent.sequence is not None:
            parent.sequence.pop(task.id, None)
        if parent.last_child is task:
            parent.last_child = _newest_child(parent) if task.killed and parent.children else None

    def _detach_top(self, task: Task, sender: Module | None) -> None:
        """Remove an ended top-level task.

        If the task was killed, flags now refer to the newest living task of the same module.
        """
        others = self.top_of_module.get(sender)
        if others is None or others.pop(task.id, None) is None:
            return  # it was outside the sequence
        if self.last_of_module.get(sender) is task:
            del self.last_of_module[sender]
            if task.killed and others:
                self.last_of_module[sender] = _newest(others)
        if not others:
            del self.top_of_module[sender]

    def forget_module(self, sender: Module) -> None:
        """Forget the sequence of a disconnected module. A later module has its own sequence."""
        self.last_of_module.pop(sender, None)

    @staticmethod
    def subtree(task: Task, *, doomed: bool = False) -> Iterator[Task]:
        """Yield *task* and its descendants, parents first.

        With *doomed*, only the descendants that are killed with *task*. The tree must not change
        during the walk.
        """
        stack = [task]
        while stack:
            node = stack.pop()
            yield node
            if node.children:
                stack.extend(
                    child
                    for child in reversed(node.children.values())
                    if not (doomed and child.role.survives)
                )


def failure_size(failure: Failure | None) -> int:
    """Return the bytes that a failure holds."""
    return 0 if failure is None else len(failure[1]) + held_size(failure[2])


def taps_of(delivery: Delivery) -> list[Wiretap]:
    """Return the wiretaps of a task and of its message.

    A listener has none, nor has a message of a monitor that listens. Otherwise wiretaps could call
    each other for ever.
    """
    taps = delivery.message.taps
    if isinstance(delivery, Task) and delivery.tapping is not None and delivery.tapping.taps:
        taps = delivery.tapping.taps + taps
    if not taps:
        return taps
    sent_for = monitor_of(delivery).task.role if delivery.role.is_of_monitor else delivery.role
    return [] if sent_for is Role.LISTENER else taps


def first_moments(task: Task) -> int:
    """Return the moments that a task reaches at its delivery.

    A task that is handled again has reached its other starts already. Only its handling starts
    again.
    """
    if task.reached & START_HANDLING:
        return START_HANDLING
    return STARTS if task.planning_delayed else RULES[task.message.is_goal].delivery


def to_be_fired(task: Task, moments: int) -> list[Wiretap]:
    """Return the wiretaps to fire before *moments*.

    A wiretap whose listener had no handler fires again once the listener has one.
    """
    fired = task.tapping.fired if task.tapping is not None else {}
    return [
        tap
        for tap in taps_of(task)
        if tap.held_moment & moments
        and (tap.id not in fired or (not fired[tap.id] and tap.listener.handlers))
    ]


def is_outside_sequence(task: Task) -> bool:
    """Whether a task is outside the sequence of its siblings, so that flags never refer to it."""
    return bool(task.role) or task.message.is_interval_monitor


def _newest_child(parent: Task) -> Task | None:
    """Return the newest child left. Flags refer to this child after the last child was killed."""
    if parent.sequence is None:
        children = (parent.children or {}).items()
        parent.sequence = {
            number: child for number, child in children if not is_outside_sequence(child)
        }
    return _newest(parent.sequence) if parent.sequence else None


def _newest(siblings: dict[int, Task]) -> Task:
    """Return the newest sibling.

    ``popitem`` also frees the places of later siblings that were deleted. ``reversed`` would walk
    over these places each time.
    """
    number, task = siblings.popitem()
    siblings[number] = task
    return task


def sending_module(task: Task) -> Module | None:
    """Return the module that sent a task; None for central.

    The module may have disconnected. A later module of the same name does not count as this one.
    """
    return task.sender.module if task.sender else None
