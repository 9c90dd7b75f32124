"""The task tree of a report: the rows, their nesting in the page, and the unfolded tasks."""

from dataclasses import dataclass

from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.records import OVER, TaskState
from tca_tools.journal.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import Row, excerpt, outline
from tca_wire.points import Interval

SHOWN_AT_MOST = 800
_BESIDE_AT_MOST = 200
"""Among more siblings than this, successive siblings of one state are folded."""
DEEPEST = 40
"""The greatest depth of nesting, which browsers limit."""
_ALL_OPEN = 60
"""The most tasks of a tree that is shown unfolded."""


@dataclass(frozen=True)
class Tree:
    """The rows of a tree."""

    at: RunAt
    below: dict[int, list[Row]]
    """By number of a row: the rows that nest in it; -1 has the top rows."""
    opened: set[int]
    """The tasks that are shown unfolded."""
    shown: int
    """The number of tasks with a row."""


def tree(run: Run, shown_at_most: int = SHOWN_AT_MOST) -> Tree:
    """Return the rows of a report's tree.

    Failed and open tasks, and those killed for a reason of their own, come first, with their
    ancestors; others follow while there is room.
    """
    at = RunAt(run)
    whole = outline(at, shown_at_most, min(_BESIDE_AT_MOST, shown_at_most))
    rows = excerpt(at, whole, 2 * shown_at_most)
    opened = set(at.tasks) if len(at.tasks) <= _ALL_OPEN else _with_trouble(at)
    below: dict[int, list[Row]] = {}
    nests_in = {-1: -1}
    for row in rows:
        place = nests_in[row.parent]
        below.setdefault(place, []).append(row)
        nests_in[row.number] = row.number if row.depth < DEEPEST else place
    return Tree(at, below, opened, sum(row.task is not None for row in rows))


def _with_trouble(at: RunAt) -> set[int]:
    """Return the failed and open tasks with their ancestors, which are unfolded."""
    found: set[int] = set()
    for number in reversed(list(at.tasks)):  # children come before their parents
        state = at.tasks[number].state
        if number in found or state is TaskState.FAILED or state not in OVER:
            found |= {number, at.tasks[number].parent}
    return found


def spans(task: TaskAt) -> str:
    """Return ``planning 1.00-1.50, achieving 1.50- s``."""
    intervals = (Interval.PLANNING, Interval.ACHIEVING)
    parts = [f"{one} {times}" for one in intervals if (times := words.times(task, one))]
    return ", ".join(parts) + " s" * bool(parts)
