"""The order of a Sender's children: the constraints that the next child needs.

A block (``sequence``, ``parallel``) is one element of the block around it. The inner block starts
with its *first* tasks, and ends when its *last* tasks have ended. A task that central refuses later
counts as never sent.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from tca_module.checks import PLAN_AHEAD, block, check
from tca_module.session.sent_tasks import SentId
from tca_wire.constraints import Constraint, Flags, plan_ahead, sequential_achievement
from tca_wire.points import THIS, TaskId


class _Block:
    """A block of children, and the tasks after which its next element comes."""

    def __init__(
        self, outer: "_Block | None", plan_ahead: int | None = None, *, is_parallel: bool = False
    ) -> None:
        #: The tasks that are achieved before the next element.
        self.after: list[TaskId] = outer.after[:] if outer else []
        self.first: list[TaskId] = []
        self.last: list[TaskId] = []
        self.delays_planning: bool = plan_ahead == 0 or bool(outer and outer.delays_planning)
        self._planned_after = outer.next_planned_after() if outer else []
        # The first tasks of each of the newest elements; at most *plan_ahead* elements.
        self._starts: deque[list[TaskId]] = deque(maxlen=plan_ahead or 0)
        self._is_parallel = is_parallel

    def next_planned_after(self) -> list[TaskId]:
        """Return the tasks whose achievement must start before the next element is planned."""
        is_full = self._starts and len(self._starts) == self._starts.maxlen
        return self._planned_after + (self._starts[0] if is_full else [])

    def add(self, first: list[TaskId], last: list[TaskId], *, sequential: bool) -> None:
        """Add an element: a task, or a block."""
        if self._is_parallel:
            self.first += first
            self.last += last
        else:
            self.after = self.last = last if sequential else self.after + last
            self.first = self.first or first
            self._starts.append(first)


def _replace_refused(tasks: Iterable[TaskId]) -> Iterator[TaskId]:
    """Yield the tasks. In place of a refused task, yield the tasks that it had to come after."""
    for task in tasks:
        if isinstance(task, SentId) and task.request.has_failed:
            yield from _replace_refused(task.request.after)
        else:
            yield task


class SiblingOrder:
    """The order among the children of one Sender."""

    def __init__(self, *, is_shared: bool) -> None:
        # Whether other Senders may send under the same parent, and may have sent the last sibling.
        self._is_shared = is_shared
        self._epoch = ""
        self.forget()

    def forget(self) -> None:
        """Forget all children: central was restarted."""
        self._newest: TaskId | None = None
        self._blocks: list[_Block] = [_Block(None)]

    def place(
        self, epoch: str, *, is_goal: bool, sequential: bool
    ) -> tuple[Flags, list[Constraint]]:
        """Return the flags and constraints of the next child.

        If *epoch* is not that of the last child, central was restarted and has forgotten the
        earlier children.
        """
        if self._epoch and self._epoch != epoch:
            self.forget()
        self._epoch = epoch
        block = self._blocks[-1]
        block.after = list(_replace_refused(block.after))
        flags, constraints = Flags.NONE, []
        if sequential:
            if self._follows_last_sibling(block):
                flags = Flags.SEQ_ACH
            else:
                constraints = [sequential_achievement(before, THIS) for before in block.after]
        if is_goal:  # commands are not planned
            constraints += [
                plan_ahead(before, THIS) for before in _replace_refused(block.next_planned_after())
            ]
            flags |= Flags.DELAY_PLANNING if block.delays_planning else Flags.NONE
        return flags, constraints

    def _follows_last_sibling(self, block: _Block) -> bool:
        """Whether the next child comes after its previous sibling only.

        If so, a flag replaces the constraints, and central need not check them for cycles.
        """
        if len(self._blocks) == 1:
            return block.after in ([], [self._newest])
        return not self._is_shared and block.after == [self._newest]

    def add(self, child: TaskId, *, sequential: bool) -> None:
        """Add a child that was sent."""
        self._newest = child
        if isinstance(child, SentId):
            child.request.after = self._blocks[-1].after[:]
        # Outside of blocks the next child follows the last sibling only, as TCA's flags do.
        self._blocks[-1].add([child], [child], sequential=sequential or len(self._blocks) == 1)

    @block
    def sequence(self, plan_ahead: int | None = None) -> Iterator[None]:
        """Start a block of children that are achieved one after the other."""
        check("sequence()", PLAN_AHEAD, plan_ahead=plan_ahead)
        with self._inside(_Block(self._blocks[-1], plan_ahead)):
            yield

    @block
    def parallel(self) -> Iterator[None]:
        """Start a block of children without order among them."""
        with self._inside(_Block(self._blocks[-1], is_parallel=True)):
            yield

    @contextmanager
    def _inside(self, inner: _Block) -> Iterator[None]:
        """Add children to *inner* for the time of the ``with`` block."""
        self._blocks.append(inner)
        try:
            yield
        finally:
            if inner in self._blocks:  # else central was restarted within the block
                self._blocks.remove(inner)
                if inner.first:
                    self._blocks[-1].add(inner.first, inner.last, sequential=True)
