"""The order of a Sender's children: the constraints that the next one needs, inside and outside of
blocks.

A block (``sequence``, ``parallel``) is one element of the block around it. Each element has *first*
tasks, with which it begins, and *last* tasks, whose ends are its end. Knows task ids only. One that
is refused afterwards is as if it had never been sent.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from tca_module.checks import PLAN_AHEAD, check
from tca_module.session.sent_tasks import SentId
from tca_wire.constraints import Constraint, Flags, plan_ahead, sequential_achievement
from tca_wire.points import THIS, TaskId


class _Block:
    """A block, and the tasks that its next element comes after."""

    def __init__(
        self, around: "_Block | None", ahead: int | None = None, *, is_parallel: bool = False
    ) -> None:
        self.after: list[TaskId] = (
            around.after[:] if around else []
        )  #: achieved before the next element is
        self.first: list[TaskId] = []
        self.last: list[TaskId] = []
        self.delays_planning: bool = ahead == 0 or bool(around and around.delays_planning)
        self._planned_after = around.next_planned_after() if around else []
        self._starts: deque[list[TaskId]] = deque(maxlen=ahead or 0)
        self._is_parallel = is_parallel

    def next_planned_after(self) -> list[TaskId]:
        """The tasks that must be being achieved before the next element is planned."""
        is_full = self._starts and len(self._starts) == self._starts.maxlen
        return self._planned_after + (self._starts[0] if is_full else [])

    def add(self, first: list[TaskId], last: list[TaskId], *, sequential: bool) -> None:
        """An element was made: a task, or a block."""
        if self._is_parallel:
            self.first += first
            self.last += last
        else:
            self.after = self.last = last if sequential else self.after + last
            self.first = self.first or first
            self._starts.append(first)


def _standing(tasks: Iterable[TaskId]) -> Iterator[TaskId]:
    """Those tasks; instead of one that was refused, those that it was to come after."""
    for task in tasks:
        if isinstance(task, SentId) and task.request.has_failed:
            yield from _standing(task.request.after)
        else:
            yield task


class SiblingOrder:
    """The order among the children of one Sender."""

    def __init__(self, *, is_shared: bool) -> None:
        self._is_shared = (
            is_shared  # others send there, too: central's "last sibling" may be theirs
        )
        self._epoch = ""
        self.forget()

    def forget(self) -> None:
        """Central has forgotten all tasks."""
        self._newest: TaskId | None = None
        self._blocks: list[_Block] = [_Block(None)]

    def place(
        self, epoch: str, *, is_goal: bool, sequential: bool
    ) -> tuple[Flags, list[Constraint]]:
        """The flags and constraints of the next child. A central of another *epoch* has forgotten
        those before.
        """
        if self._epoch and self._epoch != epoch:
            self.forget()
        self._epoch = epoch
        block = self._blocks[-1]
        block.after = list(_standing(block.after))
        flags, constraints = Flags.NONE, []
        if sequential:
            if self._follows_last_sibling(block):
                flags = Flags.SEQ_ACH
            else:
                constraints = [sequential_achievement(before, THIS) for before in block.after]
        if is_goal:  # a command is not planned
            constraints += [
                plan_ahead(behind, THIS) for behind in _standing(block.next_planned_after())
            ]
            flags |= Flags.DELAY_PLANNING if block.delays_planning else Flags.NONE
        return flags, constraints

    def _follows_last_sibling(self, block: _Block) -> bool:
        """Whether the flag says it all: it is shorter, and central need not look for circles."""
        if len(self._blocks) == 1:
            return block.after in ([], [self._newest])
        return not self._is_shared and block.after == [self._newest]

    def add(self, child: TaskId, *, sequential: bool) -> None:
        """A child was made."""
        self._newest = child
        if isinstance(child, SentId):
            child.request.after = self._blocks[-1].after[:]
        # Outside of blocks the next one follows the last sibling alone, as TCA's flags say.
        self._blocks[-1].add([child], [child], sequential=sequential or len(self._blocks) == 1)

    @contextmanager
    def sequence(self, ahead: int | None = None) -> Iterator[None]:
        """A block of children, each after the one before."""
        check("sequence()", PLAN_AHEAD, plan_ahead=ahead)
        with self._inside(_Block(self._blocks[-1], ahead)):
            yield

    @contextmanager
    def parallel(self) -> Iterator[None]:
        """A block of children without order among them."""
        with self._inside(_Block(self._blocks[-1], is_parallel=True)):
            yield

    @contextmanager
    def _inside(self, block: _Block) -> Iterator[None]:
        self._blocks.append(block)
        try:
            yield
        finally:
            if block in self._blocks:  # not if all was forgotten meanwhile
                self._blocks.remove(block)
                if block.first:
                    self._blocks[-1].add(block.first, block.last, sequential=True)
