"""The task tree of a report: which tasks are shown, which are unfolded, how rows nest. Nothing here recurses."""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass

from tca_tools.analysis.summary import is_over
from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import State, Task
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.why.coping import STANDINGS, standing
from tca_wire.points import ROOT, Interval, TaskId

SHOWN_AT_MOST = 800
_EACH_AT_MOST = 120
"""How many failed, killed and living tasks are surely shown, of each."""
_BESIDE_AT_MOST = 200
"""How many children of one task are shown."""
_DEEPEST = 40
"""Deeper tasks nest no further: browsers don't."""
_ALL_OPEN = 60
"""A tree of no more tasks is shown unfolded."""


@dataclass(slots=True)
class Node:
    """A task, or several that are not shown."""

    level: int
    """How deep it nests in the page."""
    depth: int
    closes: int = 0
    """How many levels end before it."""
    task: TaskAt | None = None
    state: str = ""
    spans: str = ""
    note: str = ""
    role: str = ""
    is_parent: bool = False
    is_open: bool = False
    folded: str = ""
    """What it stands for, if for no one task: "212 tasks: 200 achieved, 12 killed"."""


@dataclass(frozen=True)
class Tree:
    """The rows of a tree."""

    nodes: list[Node]
    closes: int
    """How many levels end after the last."""
    total: int
    shown: int


def tree(run: Run, shown_at_most: int = SHOWN_AT_MOST) -> Tree:
    """The rows: failed, living and killed tasks with all that is above them first, then others from the top down."""
    at = RunAt(run)
    shown = _choose(run, shown_at_most)
    bad = _with_trouble(run)
    opens_all = len(run.tasks) <= _ALL_OPEN
    nodes: list[Node] = []
    level = 0
    for depth, task, hidden in _walk(run, shown):
        node = Node(min(depth, _DEEPEST), depth)
        node.closes = level - node.level
        level = node.level
        if task is None:
            node.folded = _counted(run, hidden)
        else:
            _describe(at, task, node)
            node.is_parent = bool(task.children) and node.level < _DEEPEST
            node.is_open = opens_all or task.id in bad
        level += node.is_parent
        nodes.append(node)
    return Tree(nodes, level, len(run.tasks), len(shown))


def _choose(run: Run, at_most: int) -> set[int]:
    if len(run.tasks) <= at_most:
        return set(run.tasks)
    shown: set[int] = set()
    counts: Counter[str] = Counter()
    for task in run.tasks.values():
        kind = str(task.state) if is_over(task) else "living"
        if task.state is not State.ACHIEVED and counts[kind] < _EACH_AT_MOST:
            counts[kind] += 1
            _show(run, shown, task, at_most)
    level = deque([ROOT])
    while level and len(shown) < at_most:
        children = run.children(level.popleft())[: min(_BESIDE_AT_MOST, at_most - len(shown))]
        shown.update(children)
        level.extend(children)
    return shown


def _show(run: Run, shown: set[int], task: Task, at_most: int) -> None:
    """Show a task with all that it is under, if there is room for that."""
    lineage = [task.id]
    while (above := run.tasks[lineage[-1]].parent) != ROOT and above not in shown and len(lineage) < at_most:
        lineage.append(above)
    if len(shown) + len(lineage) <= at_most:
        shown.update(lineage)


def _with_trouble(run: Run) -> set[int]:
    """Failed and living tasks, and all that they are under: these are unfolded."""
    found: set[int] = set()
    for task in reversed(run.tasks.values()):  # children come before their parents
        if task.id in found or task.state is State.FAILED or not is_over(task):
            found |= {task.id, task.parent}
    return found


def _walk(run: Run, shown: set[int]) -> Iterator[tuple[int, Task | None, list[TaskId]]]:
    """Each shown task with its depth, a task before what is under it; and for its other children one row, with them."""
    waiting: list[tuple[int, Task | None, list[TaskId]]] = list(_below(run, shown, ROOT, 0))[::-1]
    while waiting:
        depth, task, hidden = waiting.pop()
        yield depth, task, hidden
        if task is not None:
            waiting += list(_below(run, shown, task.id, depth + 1))[::-1]


def _below(run: Run, shown: set[int], parent: int, depth: int) -> Iterator[tuple[int, Task | None, list[TaskId]]]:
    hidden: list[TaskId] = []
    for child in run.children(parent):
        if child not in shown:
            hidden.append(child)
            continue
        if hidden:
            yield depth, None, hidden
            hidden = []
        yield depth, run.tasks[child], []
    if hidden:
        yield depth, None, hidden


def _counted(run: Run, hidden: list[TaskId]) -> str:
    """How many tasks are hidden, with all under them, and in which states."""
    below = list(hidden)
    counts: Counter[str] = Counter()
    for number in below:  # grows while it is walked
        counts[standing(run, run.tasks[number], run.tasks[number].state)] += 1
        below += run.tasks[number].children
    total = f"{len(below):,} task{'s' * (len(below) != 1)}"
    return f"{total}: " + ", ".join(f"{counts[one]:,} {one}" for one in STANDINGS if counts[one])


def _describe(at: RunAt, record: Task, node: Node) -> None:
    task = at.tasks[record.id]
    node.task, node.state, node.note, node.role = task, task.standing, words.note(at, task), words.role(task)
    spans = []
    for interval in (Interval.PLANNING, Interval.ACHIEVING):
        if span := words.span(task, interval):
            start, end = span
            spans.append(f"{interval} {start:.2f}-" + ("" if end is None else f"{end:.2f}"))
    node.spans = ", ".join(spans) + (" s" if spans else "")
