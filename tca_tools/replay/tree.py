"""The tasks that the tree pane shows at an instant: open tasks with their ancestors, and others.

The cost depends on the tasks that are shown and their siblings, not on all tasks.
"""

from collections.abc import Sequence

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.selection import lineage
from tca_tools.tasktree_viz.outline import SHOWN_AT_MOST, Row, traverse
from tca_wire.points import ROOT, Moment, TaskId

MOST_ROWS = 3000
"""The most rows; more are left out."""
_ENDS, _OPEN = 2, 12
"""The number of siblings that are shown at either end, and the most open ones between them."""


def rows_at(at: RunAt, selected: int, opened: dict[int, bool]) -> list[Row]:
    """Return the rows of the tree at an instant.

    Args:
        at: The run at the instant.
        selected: The selected task, whose ancestors are unfolded.
        opened: By task, whether the user has unfolded (True) or folded it.
    """
    above = set(lineage(at.run, TaskId(selected))) if selected in at.tasks else set()
    is_small = len(at.tasks) <= SHOWN_AT_MOST

    def below(row: Row) -> list[Row]:
        task = row.task.id if row.task else ROOT
        is_open = task == ROOT or opened.get(
            task, is_small or task in above - {selected} or _is_open(at, task)
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

    return traverse(below, MOST_ROWS)


def _is_open(at: RunAt, task: TaskId) -> bool:
    return at.run.tasks[task].time_of(Moment.END_ACHIEVING) > at.instant


def _shown(at: RunAt, children: Sequence[TaskId], above: set[TaskId]) -> list[int]:
    """Return the places of the children that are shown."""
    count = len(children)
    if count <= 2 * _ENDS + _OPEN:
        return list(range(count))
    open_places = [place for place, child in enumerate(children) if _is_open(at, child)]
    if len(open_places) > _OPEN:
        open_places = [*open_places[: _OPEN // 2], *open_places[-_OPEN // 2 :]]
    wanted = (place for place, child in enumerate(children) if child in above)
    return sorted({*range(_ENDS), *open_places, *wanted, *range(count - _ENDS, count)})
