"""Choose the rows of a tree: every task, or, in a large tree, the important ones and folded runs.

No function recurses: a tree may be a million levels deep.
"""

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from sys import maxsize

from tca_tools.journal.at_time import TaskAt
from tca_tools.journal.fates import HANDLED
from tca_tools.journal.records import TaskState
from tca_tools.journal.selection import Forest
from tca_wire.points import ROOT, TaskId

SHOWN_AT_MOST = 300
"""A larger tree is folded, if folding is allowed."""
BESIDE_AT_MOST = 12
"""If a task has more children, runs of children in the same state are folded."""
_KEPT = 2
"""The number of tasks that remain at each end of a folded run."""
_FEWER = (16, 8, 4, 2, 1)
"""The numbers of siblings to leave at each end, tried in turn until the rows are few enough."""
_WORST_FIRST = (TaskState.FAILED, HANDLED, TaskState.KILLED, TaskState.RESOLVED, TaskState.ACHIEVED)


@dataclass(slots=True)
class Row:
    """A task, or a number of folded tasks. Rows are in depth-first order."""

    task: TaskAt | None
    """None: the row stands for folded tasks."""
    parent: int
    """The number of its parent's row (-1: it is under the root)."""
    depth: int
    folded: int = 0
    """The number of folded tasks."""
    states: Counter[str] = field(default_factory=Counter)
    """The number of folded tasks in each state."""
    is_rest: bool = False
    """Whether it stands for all further rows."""
    is_last: bool = False
    """Whether it is its parent's last child."""
    number: int = -1
    """Its place among all rows."""

    @property
    def state(self) -> str:
        """The common state of the folded tasks.

        If they have several states, but all have ended, it is the worst of these states; else "".
        """
        if len(self.states) == 1:
            return next(iter(self.states))
        if self.states.keys() <= {*_WORST_FIRST}:
            return next((one for one in _WORST_FIRST if one in self.states), "")
        return ""


def outline(
    at: Forest,
    shown_at_most: int = SHOWN_AT_MOST,
    beside_at_most: int = BESIDE_AT_MOST,
    budget: int | None = None,
) -> list[Row]:
    """Return the rows of the tree, folded if it is large.

    Subtrees in which all tasks were achieved, or killed with their parent, are folded. The deepest
    are folded first, until about *budget* tasks are shown.

    Args:
        at: the tree.
        shown_at_most: a tree of more tasks is folded.
        beside_at_most: if a task has more children, runs of children in one state are folded.
        budget: the number of tasks to show in a folded tree; None: *shown_at_most*.
    """
    notable = _notable(at)
    shown = set[int](at.tasks)
    if len(at.tasks) > shown_at_most:
        shown = _choose(at, notable, budget or shown_at_most, beside_at_most)

    def below(row: Row) -> list[Row]:
        rows: list[Row] = []
        for is_shown, children in groupby(_children(at, row), shown.__contains__):
            if is_shown:
                rows += [_row(at, row, child) for child in children]
            else:
                rows.append(_fold(at, Row(None, row.number, row.depth + 1), list(children)))
        return _fold_runs(at, rows, notable) if len(rows) > beside_at_most else rows

    return traverse(below)


def whole_outline(at: Forest) -> list[Row]:
    """Return a row for every task."""
    return traverse(lambda row: [_row(at, row, child) for child in _children(at, row)])


def _children(at: Forest, row: Row) -> Sequence[TaskId]:
    return at.children(row.task.id if row.task else ROOT)


def traverse(below: Callable[[Row], list[Row]], at_most: int = maxsize) -> list[Row]:
    """Return the rows of a tree in depth-first order.

    *below* returns the children of a row; it is called first with a row for the root.
    """
    rows: list[Row] = []
    stack = [Row(None, -1, -1)]
    while stack and len(rows) < at_most:
        row = stack.pop()
        if row.depth >= 0:
            row.number = len(rows)
            rows.append(row)
        if row.task or row.depth < 0:
            children = below(row)
            for last in children[-1:]:
                last.is_last = True
            stack += reversed(children)
    if stack:
        rows.append(Row(None, -1, 0, is_rest=True, is_last=True, number=len(rows)))
    return rows


def excerpt(at: Forest, rows: list[Row], at_most: int) -> list[Row]:
    """Return at most *at_most* rows.

    Of too many siblings, the first and the last remain, and notable tasks are preferred to others.
    If there are still too many rows, the last rows are folded.
    """
    if len(rows) <= at_most:
        return rows
    families: dict[int, list[Row]] = {}
    for row in rows:
        families.setdefault(row.parent, []).append(row)
    notable, places = _notable(at), {id(row): row.number for row in rows}

    def below(row: Row, beside: int) -> list[Row]:
        family = families.get(places.get(id(row), -1), [])
        for one in family:
            one.parent, one.is_last = row.number, False
        return _thin_out(at, family, notable, beside)

    for beside in _FEWER:
        rows = traverse(partial(below, beside=beside))
        if len(rows) <= at_most:
            break
    return _cut_off(rows, at_most)


def _thin_out(at: Forest, family: list[Row], notable: set[int], beside: int) -> list[Row]:
    """Return the siblings of a family, at most *beside* from each end, and fold the others."""
    places = list(range(len(family)))
    if len(family) > 2 * beside + 1:
        tasks = [row.task.id if row.task else None for row in family]
        first = [place for place in places if tasks[place] in notable]
        others = [place for place in places if tasks[place] not in notable]
        rest = max(beside - len(first) // 2, 0)
        places = sorted(_both_ends(first, beside) + _both_ends(others, rest))
    rows: list[Row] = []
    for before, place in zip([-1, *places], [*places, len(family)], strict=True):
        if between := family[before + 1 : place]:
            rows.append(_merged(at, between))
        rows += family[place : place + 1]
    return rows


def _both_ends(places: list[int], count: int) -> list[int]:
    if len(places) <= 2 * count:
        return places
    return [*places[:count], *places[len(places) - count :]]


def _cut_off(rows: list[Row], at_most: int) -> list[Row]:
    """Return the first rows, and one row that counts the other tasks."""
    if len(rows) <= at_most:
        return rows
    rest = sum(row.folded or 1 for row in rows[at_most:])
    return [
        *rows[:at_most],
        Row(None, -1, 0, folded=rest, is_rest=True, is_last=True, number=at_most),
    ]


def _merged(at: Forest, rows: list[Row]) -> Row:
    """Return one row in place of several."""
    states = sum((row.states for row in rows), Counter[str]())
    merged = Row(None, rows[0].parent, rows[0].depth, sum(row.folded for row in rows), states)
    return _fold(at, merged, [row.task.id for row in rows if row.task])


def _row(at: Forest, parent: Row, task: TaskId) -> Row:
    return Row(at.tasks[task], parent.number, parent.depth + 1)


def _fold(at: Forest, into: Row, tasks: Sequence[TaskId]) -> Row:
    """Add tasks and all their descendants to a folded row."""
    below = [*tasks]
    for number in below:  # it grows during the loop
        below += at.children(number)
    into.folded += len(below)
    into.states.update(at.tasks[number].standing for number in below)
    return into


def _notable(at: Forest) -> set[int]:
    """Return the tasks that are never folded, with all their ancestors.

    They still run, have failed, or were killed for a reason of their own.
    """
    notable = {int(ROOT)}
    for number in sorted(at.tasks, reverse=True):  # children have larger numbers than their parents
        if number in notable or not (
            at.tasks[number].state is TaskState.ACHIEVED
            or _was_killed_with_parent(at, at.tasks[number])
        ):
            notable.update((number, at.tasks[number].parent))
    return notable


def _was_killed_with_parent(at: Forest, task: TaskAt) -> bool:
    above = at.tasks.get(task.parent)
    if above is None or not task.state is above.state is TaskState.KILLED:
        return False
    return task.why_killed == above.why_killed


def _choose(at: Forest, notable: set[int], budget: int, beside_at_most: int) -> set[int]:
    """Return the tasks to show: the notable ones, then others from the top down.

    Among many siblings in one state, the first and the last are chosen.
    """
    shown, samples = set(notable), set[int]()
    level = deque([ROOT])
    while level and len(shown) <= budget:
        above = level.popleft()
        children = at.children(above)
        is_crowded = len(children) > beside_at_most
        nearest = (_ends(at, children) if is_crowded else children)[: budget + 1 - len(shown)]
        shown.update(nearest)
        samples.update(nearest if is_crowded and above != ROOT else ())
        level.extend(child for child in children if child in shown)
    # a sample without shown children would look like a leaf, so it is folded with its children
    return shown - {
        one for one in samples - notable if at.children(one) and shown.isdisjoint(at.children(one))
    }


def _ends(at: Forest, tasks: Sequence[TaskId]) -> list[TaskId]:
    """Return the first and the last tasks of each run in one state."""
    found: list[TaskId] = []
    for _, run in groupby(tasks, lambda number: at.tasks[number].state):
        alike = list(run)
        found += alike if len(alike) <= 2 * _KEPT else [*alike[:_KEPT], *alike[-_KEPT:]]
    return found


def _fold_runs(at: Forest, rows: list[Row], notable: set[int]) -> list[Row]:
    """Return the rows with long runs of one state folded, except the ends of each run."""
    folded: list[Row] = []
    for state, run in groupby(rows, lambda row: _state_to_fold(row, notable)):
        alike = list(run)
        last = len(alike) - _KEPT if alike[-1].task else len(alike)
        middle = alike[_KEPT:last]
        if state is not None and len(middle) >= _KEPT:
            alike[_KEPT:last] = [_merged(at, middle)]
        folded += alike
    return folded


def _state_to_fold(row: Row, notable: set[int]) -> str | None:
    """Return the state of a row; None if the row must not be folded."""
    if not row.task:
        return row.state
    is_minor = row.task.id not in notable or not row.task.children
    return row.task.state if is_minor and row.task.state is not TaskState.FAILED else None
