"""The task tree of a report: the rows of an outline, how they nest in a page, and which are unfolded."""

from dataclasses import dataclass

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import OVER, State
from tca_tools.run.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import Row, cut_off, outline
from tca_wire.points import Interval

SHOWN_AT_MOST = 800
_BESIDE_AT_MOST = 200
"""Of more tasks side by side, long runs of one state are folded."""
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
    """What it stands for, if for no one task: "+ 212 tasks achieved"."""


@dataclass(frozen=True)
class Tree:
    """The rows of a tree."""

    nodes: list[Node]
    closes: int
    """How many levels end after the last."""
    total: int
    shown: int


def tree(run: Run, shown_at_most: int = SHOWN_AT_MOST) -> Tree:
    """The rows: what failed, lives or was killed for a reason of its own, with all that it is under, then others."""
    at = RunAt(run)
    rows = cut_off(outline(at, shown_at_most, min(_BESIDE_AT_MOST, shown_at_most)), 2 * shown_at_most)
    opened = set(at.tasks) if len(at.tasks) <= _ALL_OPEN else _with_trouble(at)
    nodes: list[Node] = []
    level = 0
    for row, below in zip(rows, [*rows, None][1:], strict=True):
        node = _node(at, row, opened)
        node.is_parent = below is not None and below.parent == row.number and node.level < _DEEPEST
        node.closes = level - node.level
        level = node.level + node.is_parent
        nodes.append(node)
    return Tree(nodes, level, len(at.tasks), sum(row.task is not None for row in rows))


def _with_trouble(at: RunAt) -> set[int]:
    """Failed and living tasks, and all that they are under: these are unfolded."""
    found: set[int] = set()
    for number in reversed(list(at.tasks)):  # children come before their parents
        state = at.tasks[number].state
        if number in found or state is State.FAILED or state not in OVER:
            found |= {number, at.tasks[number].parent}
    return found


def _node(at: RunAt, row: Row, opened: set[int]) -> Node:
    node, task = Node(min(row.depth, _DEEPEST), row.depth), row.task
    if task is None:
        node.folded = words.folded(row)
        return node
    node.task, node.state, node.note, node.role = task, task.standing, words.note(at, task), words.role(task)
    node.is_open = task.id in opened
    spans = []
    for interval in (Interval.PLANNING, Interval.ACHIEVING):
        if span := words.span(task, interval):
            start, end = span
            spans.append(f"{interval} {start:.2f}-" + ("" if end is None else f"{end:.2f}"))
    node.spans = ", ".join(spans) + (" s" if spans else "")
    return node
