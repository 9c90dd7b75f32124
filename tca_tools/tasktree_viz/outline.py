"""Which tasks of a tree are shown, in which order: every task, or what says little in a large tree
folded up.

Nothing here recurses: a tree may be a million deep.
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
"""A tree of more tasks is folded, if it may be."""
BESIDE_AT_MOST = 12
"""Of more tasks side by side, runs of tasks in the same state are folded."""
_KEPT = 2
"""How many tasks of such a run stay at either end."""
_FEWER = (16, 8, 4, 2, 1)
"""So many of those side by side stay at either end, where there are too many rows."""
_WORST_FIRST = (TaskState.FAILED, HANDLED, TaskState.KILLED, TaskState.RESOLVED, TaskState.ACHIEVED)


@dataclass(slots=True)
class Row:
    """One task, or folded ones in its place, in the order of reading (a task before what is under
    it).
    """

    task: TaskAt | None
    parent: int
    """The number of its parent's row (-1: it is under the root)."""
    depth: int
    folded: int = 0
    """How many tasks it stands for, if for no one task."""
    states: Counter[str] = field(default_factory=Counter)
    """How many of those stand how."""
    is_rest: bool = False
    """Whether it stands for all that comes after it."""
    is_last: bool = False
    """Whether it is its parent's last."""
    number: int = -1
    """Its place among all rows."""

    @property
    def state(self) -> str:
        """Of folded ones their state, if all have one; the worst of those that are over, if all
        are; else "".
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
    """The rows of the tree. One of more than *shown_at_most* tasks is folded: subtrees in which all
    was achieved, or killed with what they are under, those deep down first, until about *budget*
    tasks are shown (None: as many).
    """
    loud = _loud(at)
    shown = set[int](at.tasks)
    if len(at.tasks) > shown_at_most:
        shown = _choose(at, loud, budget or shown_at_most, beside_at_most)

    def below(row: Row) -> list[Row]:
        rows: list[Row] = []
        for is_shown, some in groupby(_children(at, row), shown.__contains__):
            if is_shown:
                rows += [_row(at, row, child) for child in some]
            else:
                rows.append(_fold(at, Row(None, row.number, row.depth + 1), list(some)))
        return _squeezed(at, rows, loud) if len(rows) > beside_at_most else rows

    return walked(below)


def whole_outline(at: Forest) -> list[Row]:
    """A row for every task."""
    return walked(lambda row: [_row(at, row, child) for child in _children(at, row)])


def _children(at: Forest, row: Row) -> Sequence[TaskId]:
    return at.children(row.task.id if row.task else ROOT)


def walked(below: Callable[[Row], list[Row]], at_most: int = maxsize) -> list[Row]:
    """The rows of a tree in order, of which *below* tells those right under one; first those under
    the root.
    """
    rows: list[Row] = []
    waiting = [Row(None, -1, -1)]  # a stack: the last goes first
    while waiting and len(rows) < at_most:
        row = waiting.pop()
        if row.depth >= 0:
            row.number = len(rows)
            rows.append(row)
        if row.task or row.depth < 0:
            children = below(row)
            for last in children[-1:]:
                last.is_last = True
            waiting += reversed(children)
    if waiting:
        rows.append(Row(None, -1, 0, is_rest=True, is_last=True, number=len(rows)))
    return rows


def excerpt(at: Forest, rows: list[Row], at_most: int) -> list[Row]:
    """At most so many rows. Of too many side by side the first and last are kept of those that
    failed, go on or were killed for a reason of their own, then of others. If there are too many
    even so, the last ones are folded.
    """
    if len(rows) <= at_most:
        return rows
    families: dict[int, list[Row]] = {}
    for row in rows:
        families.setdefault(row.parent, []).append(row)
    loud, places = _loud(at), {id(row): row.number for row in rows}

    def below(row: Row, beside: int) -> list[Row]:
        family = families.get(places.get(id(row), -1), [])
        for one in family:
            one.parent, one.is_last = row.number, False
        return _kept(at, family, loud, beside)

    for beside in _FEWER:
        rows = walked(partial(below, beside=beside))
        if len(rows) <= at_most:
            break
    return _cut_off(rows, at_most)


def _kept(at: Forest, family: list[Row], loud: set[int], beside: int) -> list[Row]:
    """The rows of a family, or so many of them at either end, and others for those between."""
    places = list(range(len(family)))
    if len(family) > 2 * beside + 1:
        tasks = [row.task.id if row.task else None for row in family]
        first = [place for place in places if tasks[place] in loud]
        others = [place for place in places if tasks[place] not in loud]
        rest = max(beside - len(first) // 2, 0)
        places = sorted(_both_ends(first, beside) + _both_ends(others, rest))
    rows: list[Row] = []
    for before, place in zip([-1, *places], [*places, len(family)], strict=True):
        if between := family[before + 1 : place]:
            rows.append(_folded(at, between))
        rows += family[place : place + 1]
    return rows


def _both_ends(some: list[int], count: int) -> list[int]:
    return some if len(some) <= 2 * count else [*some[:count], *some[len(some) - count :]]


def _cut_off(rows: list[Row], at_most: int) -> list[Row]:
    """The first rows and, in place of the others, one that says how many tasks they are."""
    if len(rows) <= at_most:
        return rows
    rest = sum(row.folded or 1 for row in rows[at_most:])
    return [
        *rows[:at_most],
        Row(None, -1, 0, folded=rest, is_rest=True, is_last=True, number=at_most),
    ]


def _folded(at: Forest, rows: list[Row]) -> Row:
    """One row in place of some."""
    states = sum((row.states for row in rows), Counter[str]())
    one = Row(None, rows[0].parent, rows[0].depth, sum(row.folded for row in rows), states)
    return _fold(at, one, [row.task.id for row in rows if row.task])


def _row(at: Forest, parent: Row, task: TaskId) -> Row:
    return Row(at.tasks[task], parent.number, parent.depth + 1)


def _fold(at: Forest, into: Row, tasks: Sequence[TaskId]) -> Row:
    """Let a row stand for these tasks, too, and for all that is under them."""
    below = [*tasks]
    for number in below:  # grows while it is walked
        below += at.children(number)
    into.folded += len(below)
    into.states.update(at.tasks[number].standing for number in below)
    return into


def _loud(at: Forest) -> set[int]:
    """The tasks that are shown in any case: those that go on, that failed, or were killed for a
    reason of their own, and all that they are under.
    """
    loud = {int(ROOT)}
    for number in sorted(at.tasks, reverse=True):  # children have larger numbers than their parents
        if number in loud or not (
            at.tasks[number].state is TaskState.ACHIEVED or _went_along(at, at.tasks[number])
        ):
            loud.update((number, at.tasks[number].parent))
    return loud


def _went_along(at: Forest, task: TaskAt) -> bool:
    """Whether a task was killed with what it is under."""
    above = at.tasks.get(task.parent)
    if above is None or not task.state is above.state is TaskState.KILLED:
        return False
    return task.why_killed == above.why_killed


def _choose(at: Forest, loud: set[int], budget: int, beside_at_most: int) -> set[int]:
    """The tasks to show: those that are in any case, then others from the top down, of many alike
    side by side the first and the last.
    """
    shown, samples = set(loud), set[int]()
    level = deque([ROOT])
    while level and len(shown) <= budget:
        above = level.popleft()
        children = at.children(above)
        is_crowded = len(children) > beside_at_most
        nearest = (_ends(at, children) if is_crowded else children)[: budget + 1 - len(shown)]
        shown.update(nearest)
        samples.update(nearest if is_crowded and above != ROOT else ())
        level.extend(child for child in children if child in shown)
    return shown - {
        one for one in samples - loud if at.children(one) and shown.isdisjoint(at.children(one))
    }


def _ends(at: Forest, tasks: Sequence[TaskId]) -> list[TaskId]:
    """The first and the last of each run of tasks in one state."""
    found: list[TaskId] = []
    for _, run in groupby(tasks, lambda number: at.tasks[number].state):
        alike = list(run)
        found += alike if len(alike) <= 2 * _KEPT else [*alike[:_KEPT], *alike[-_KEPT:]]
    return found


def _squeezed(at: Forest, rows: list[Row], loud: set[int]) -> list[Row]:
    """The rows with long runs of one state folded, but for the ends of each run."""
    squeezed: list[Row] = []
    for state, run in groupby(rows, lambda row: _state_to_fold(row, loud)):
        alike = list(run)
        last = len(alike) - _KEPT if alike[-1].task else len(alike)
        middle = alike[_KEPT:last]
        if state is not None and len(middle) >= _KEPT:
            alike[_KEPT:last] = [_folded(at, middle)]
        squeezed += alike
    return squeezed


def _state_to_fold(row: Row, loud: set[int]) -> str | None:
    """The state of a row, if nothing worth seeing would be lost by folding it."""
    if not row.task:
        return row.state
    is_quiet = row.task.id not in loud or not row.task.children
    return row.task.state if is_quiet and row.task.state is not TaskState.FAILED else None
