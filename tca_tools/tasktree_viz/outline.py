"""Which tasks of a tree are shown, in which order: every task, or what says little in a large tree folded up.

Nothing here recurses: a tree may be a million deep.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby

from tca_tools.run.at_time import TaskAt
from tca_tools.run.records import State
from tca_tools.run.selection import Forest
from tca_wire.points import ROOT, TaskId

SHOWN_AT_MOST = 300
"""A tree of more tasks is folded, if it may be."""
BESIDE_AT_MOST = 12
"""Of more tasks side by side, runs of tasks in the same state are folded."""
_KEPT = 2
"""How many tasks of such a run stay at either end."""
_States = Mapping[int, State]


@dataclass(slots=True)
class Row:
    """One task, or achieved ones in its place, in the order of reading (a task before what is under it)."""

    task: TaskAt | None
    parent: int
    """The number of its parent's row (-1: it is under the root)."""
    depth: int
    folded: int = 0
    """How many tasks it stands for, if for no one task."""
    killed: int = 0
    """How many of those were killed, if others were achieved."""
    state: State = State.ACHIEVED
    """What state those are in."""
    is_rest: bool = False
    """Whether it stands for all that comes behind."""
    is_last: bool = False
    """Whether it is its parent's last."""
    number: int = -1
    """Its place among all rows."""


def outline(
    at: Forest, shown_at_most: int = SHOWN_AT_MOST, beside_at_most: int = BESIDE_AT_MOST, budget: int | None = None
) -> list[Row]:
    """The rows of the tree. One of more than *shown_at_most* tasks is folded: subtrees in which all was achieved, or
    killed with what they are under, those deep down first, until about *budget* tasks are shown (None: as many).
    """
    states = {number: task.state for number, task in at.tasks.items()}
    loud = _loud(at, states)
    if len(at.tasks) <= shown_at_most:
        return _rows(at, None, loud, _Sizes(at, states), beside_at_most)
    shown = _choose(at, states, loud, budget or shown_at_most, beside_at_most)
    return _rows(at, shown, loud, _Sizes(at, states), beside_at_most)


def whole_outline(at: Forest) -> list[Row]:
    """A row for every task."""
    return _rows(at, None, set(), _Sizes(at, {}), len(at.tasks))


def cut_off(rows: list[Row], at_most: int) -> list[Row]:
    """The first rows and, in place of the others, one that says how many tasks they are."""
    if len(rows) <= at_most:
        return rows
    rest = sum(row.folded or 1 for row in rows[at_most:])
    return [*rows[:at_most], Row(None, -1, 0, folded=rest, is_rest=True, is_last=True, number=at_most)]


def _loud(at: Forest, states: _States) -> set[int]:
    """The tasks that are shown in any case: those that go on, that failed, or were killed for a reason of their own,
    and all that they are under.
    """
    loud = {int(ROOT)}
    for task_id in sorted(at.tasks, reverse=True):  # children have larger ids than their parents
        if task_id in loud or not (states[task_id] is State.ACHIEVED or _went_along(at, states, task_id)):
            loud.update((task_id, at.tasks[task_id].parent))
    return loud


def _went_along(at: Forest, states: _States, task_id: int) -> bool:
    """Whether a task was killed with what it is under."""
    task = at.tasks[task_id]
    were_killed = states[task_id] is State.KILLED and states.get(task.parent) is State.KILLED
    return were_killed and task.why_killed == at.tasks[task.parent].why_killed


def _choose(at: Forest, states: _States, loud: set[int], budget: int, beside_at_most: int) -> set[int]:
    """The tasks to show: those that are in any case, then others from the top down, of many alike side by side the
    first and the last.
    """
    shown, samples = set(loud), set[int]()
    level = deque([ROOT])
    while level and len(shown) <= budget:
        above = level.popleft()
        children = at.children(above)
        is_crowded = len(children) > beside_at_most
        nearest = (_ends(states, children) if is_crowded else children)[: budget + 1 - len(shown)]
        shown.update(nearest)
        samples.update(nearest if is_crowded and above != ROOT else ())
        level.extend(child for child in children if child in shown)
    return shown - {one for one in samples - loud if _is_empty(at, one, shown)}


def _is_empty(at: Forest, task: int, shown: set[int]) -> bool:
    """Whether there is something under a task, and nothing of that is shown."""
    children = at.children(task)
    return bool(children) and not any(child in shown for child in children)


def _ends(states: _States, tasks: list[TaskId]) -> list[TaskId]:
    """The first and the last of each run of tasks in one state."""
    found: list[TaskId] = []
    for _, run in groupby(tasks, states.__getitem__):
        alike = list(run)
        found += alike if len(alike) <= 2 * _KEPT else [*alike[:_KEPT], *alike[-_KEPT:]]
    return found


class _Sizes:
    """How many tasks each subtree has, and how many of those were killed."""

    def __init__(self, at: Forest, states: _States) -> None:
        self.all = dict.fromkeys(at.tasks, 1)
        self.killed = {number: int(states.get(number) is State.KILLED) for number in at.tasks}
        for task_id in sorted(at.tasks, reverse=True):
            parent = at.tasks[task_id].parent
            if parent in self.all:  # not the root, and not above the part that is shown
                self.all[parent] += self.all[task_id]
                self.killed[parent] += self.killed[task_id]

    def fold(self, row: Row, into: Row) -> None:
        """Let a row stand for one more, or for as many as another."""
        into.folded += self.all[row.task.id] if row.task else row.folded
        into.killed += self.killed[row.task.id] if row.task else row.killed
        if into.killed:
            into.state = State.KILLED


def _rows(at: Forest, shown: set[int] | None, loud: set[int], sizes: _Sizes, beside_at_most: int) -> list[Row]:
    rows: list[Row] = []
    waiting = [Row(None, -1, -1)]  # a stack: the last goes first
    while waiting:
        row = waiting.pop()
        if row.depth >= 0:
            row.number = len(rows)
            rows.append(row)
        if row.task or row.depth < 0:
            below = _below(at, shown, sizes, row)
            below = _squeezed(below, loud, sizes) if len(below) > beside_at_most else below
            for last in below[-1:]:
                last.is_last = True
            waiting += reversed(below)
    return rows


def _below(at: Forest, shown: set[int] | None, sizes: _Sizes, row: Row) -> list[Row]:
    """The rows right under one; tasks that are not shown and stand side by side share one."""
    found: list[Row] = []
    for child in at.children(row.task.id if row.task else ROOT):
        if shown is None or child in shown:
            found.append(Row(at.tasks[child], row.number, row.depth + 1))
            continue
        if not found or found[-1].task is not None:
            found.append(Row(None, row.number, row.depth + 1))
        sizes.fold(Row(at.tasks[child], row.number, row.depth + 1), found[-1])
    return found


def _squeezed(rows: list[Row], loud: set[int], sizes: _Sizes) -> list[Row]:
    """The rows with long runs of one state folded, but for the ends of each run."""
    squeezed: list[Row] = []
    for state, run in groupby(rows, lambda row: _state_to_fold(row, loud)):
        alike = list(run)
        last = len(alike) - _KEPT if alike[-1].task else len(alike)
        middle = alike[_KEPT:last]
        if state is None or len(middle) < _KEPT:
            squeezed += alike
            continue
        one = Row(None, alike[0].parent, alike[0].depth, state=state)
        for row in middle:
            sizes.fold(row, one)
        squeezed += [*alike[:_KEPT], one, *alike[last:]]
    return squeezed


def _state_to_fold(row: Row, loud: set[int]) -> State | None:
    """The state of a row, if nothing worth seeing would be lost by folding it."""
    if not row.task:
        return row.state
    state = row.task.state
    is_quiet = row.task.id not in loud or not row.task.children
    return state if is_quiet and state is not State.FAILED else None
