"""Which tasks the tree shows at a moment: what lives with what it is under, and of what is over the
newest.

Nothing recurses; a moment costs what is shown and what stands beside that, however many tasks there
are.
"""

from collections.abc import Sequence

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.selection import lineage
from tca_tools.tasktree_viz.outline import SHOWN_AT_MOST, Row, walked
from tca_wire.points import ROOT, Moment, TaskId

MOST_ROWS = 3000
"""Of a tree that is larger even so, the rest is left out."""
_ENDS, _LIVING = 2, 12
"""Of many siblings so many are shown at either end, and so many that live."""


def rows_at(at: RunAt, selected: int, opened: dict[int, bool]) -> list[Row]:
    """The rows at a moment. What the *selected* task is under is open; *opened* tells what the user
    has opened (True) or closed.
    """
    above = set(lineage(at.run, TaskId(selected))) if selected in at.tasks else set()
    is_small = len(at.tasks) <= SHOWN_AT_MOST

    def below(row: Row) -> list[Row]:
        task = row.task.id if row.task else ROOT
        is_open = task == ROOT or opened.get(
            task, is_small or task in above - {selected} or _lives(at, task)
        )
        children = at.children(task)
        shown = _shown(at, children, above) if is_open else []
        rows: list[Row] = []
        for before, place in zip([-1, *shown], [*shown, len(children)], strict=True):
            if place - before > 1:
                rows.append(Row(None, row.number, row.depth + 1, folded=place - before - 1))
            if place < len(children):
                rows.append(Row(at.tasks[children[place]], row.number, row.depth + 1))
        return rows

    return walked(below, MOST_ROWS)


def _lives(at: RunAt, task: TaskId) -> bool:
    return at.run.tasks[task].time_of(Moment.END_ACHIEVING) > at.moment


def _shown(at: RunAt, children: Sequence[TaskId], above: set[TaskId]) -> list[int]:
    """The places of the children that are shown."""
    count = len(children)
    if count <= 2 * _ENDS + _LIVING:
        return list(range(count))
    living = [place for place, child in enumerate(children) if _lives(at, child)]
    if len(living) > _LIVING:
        living = [*living[: _LIVING // 2], *living[-_LIVING // 2 :]]
    wanted = (place for place, child in enumerate(children) if child in above)
    return sorted({*range(_ENDS), *living, *wanted, *range(count - _ENDS, count)})
