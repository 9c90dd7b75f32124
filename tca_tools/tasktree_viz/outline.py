"""Which tasks of a tree are shown, in which order: every task, or the achieved parts of a large tree folded up.

Nothing here recurses: a tree may be a million deep.
"""

from collections import deque
from dataclasses import dataclass
from itertools import groupby

from tca_tools.records import State
from tca_tools.selection import Forest
from tca_tools.then import TaskThen
from tca_wire.points import ROOT

SHOWN_AT_MOST = 300
"""A tree of more tasks is folded, if it may be."""
BESIDE_AT_MOST = 12
"""Of more tasks side by side, runs of tasks in the same state are folded."""
_KEPT = 2
"""How many tasks of such a run stay at either end."""


@dataclass(slots=True)
class Row:
    """One task, or achieved ones in its place, in the order of reading (a task before what is under it)."""

    task: TaskThen | None
    parent: int
    """The number of its parent's row (-1: it is under the root)."""
    depth: int
    folded: int = 0
    """How many tasks it stands for, if for no one task."""
    state: State = State.ACHIEVED
    """What state those are in."""
    is_last: bool = False
    """Whether it is its parent's last."""
    number: int = -1
    """Its place among all rows."""


def outline(then: Forest, shown_at_most: int = SHOWN_AT_MOST, beside_at_most: int = BESIDE_AT_MOST) -> list[Row]:
    """The rows of the tree. Beyond *shown_at_most*, subtrees that are achieved are folded, those deep down first."""
    is_large = len(then.tasks) > shown_at_most
    return _rows(then, _choose(then, shown_at_most) if is_large else None, beside_at_most)


def whole_outline(then: Forest) -> list[Row]:
    """A row for every task."""
    return _rows(then, None, len(then.tasks))


def _choose(then: Forest, budget: int) -> set[int]:
    """The tasks to show: all that are not achieved with what they hang under, then achieved ones from the top down."""
    shown = {0}
    for task_id in sorted(then.tasks, reverse=True):  # children have larger ids than their parents
        task = then.tasks[task_id]
        if task_id in shown or task.state is not State.ACHIEVED:
            shown.update((task_id, task.parent))
    level = deque([ROOT])
    while level and len(shown) <= budget:
        children = then.children(level.popleft())
        shown.update(children[: budget + 1 - len(shown)])
        level.extend(child for child in children if child in shown)
    return shown


def _sizes(then: Forest) -> dict[int, int]:
    """How many tasks each subtree has."""
    sizes = dict.fromkeys(then.tasks, 1)
    for task_id in sorted(then.tasks, reverse=True):
        parent = then.tasks[task_id].parent
        if parent in sizes:  # not the root, and not above the part that is shown
            sizes[parent] += sizes[task_id]
    return sizes


def _rows(then: Forest, shown: set[int] | None, beside_at_most: int) -> list[Row]:
    sizes = _sizes(then)
    rows: list[Row] = []
    waiting = [Row(None, -1, -1)]  # a stack: the last goes first
    while waiting:
        row = waiting.pop()
        if row.depth >= 0:
            row.number = len(rows)
            rows.append(row)
        if row.task or row.depth < 0:
            below = _below(then, shown, sizes, row)
            below = _squeezed(below, sizes) if len(below) > beside_at_most else below
            for last in below[-1:]:
                last.is_last = True
            waiting += reversed(below)
    return rows


def _below(then: Forest, shown: set[int] | None, sizes: dict[int, int], row: Row) -> list[Row]:
    """The rows right under one; tasks that are not shown and stand side by side share one."""
    found: list[Row] = []
    for child in then.children(row.task.id if row.task else ROOT):
        if shown is None or child in shown:
            found.append(Row(then.tasks[child], row.number, row.depth + 1))
        elif found and found[-1].task is None:
            found[-1].folded += sizes[child]
        else:
            found.append(Row(None, row.number, row.depth + 1, folded=sizes[child]))
    return found


def _squeezed(rows: list[Row], sizes: dict[int, int]) -> list[Row]:
    """The rows with long runs of one state folded, but for the ends of each run."""
    squeezed: list[Row] = []
    for state, run in groupby(rows, _state_to_fold):
        alike = list(run)
        last = len(alike) - _KEPT if alike[-1].task else len(alike)
        middle = alike[_KEPT:last]
        if state is None or len(middle) < _KEPT:
            squeezed += alike
            continue
        folded = sum(sizes[row.task.id] if row.task else row.folded for row in middle)
        one = Row(None, alike[0].parent, alike[0].depth, folded=folded, state=state)
        squeezed += [*alike[:_KEPT], one, *alike[last:]]
    return squeezed


def _state_to_fold(row: Row) -> State | None:
    """The state of a row, if nothing worth seeing would be lost by folding it."""
    if not row.task:
        return row.state
    state = row.task.state
    return state if state is State.ACHIEVED or not (row.task.children or state is State.FAILED) else None
