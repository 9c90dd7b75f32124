"""Which tasks the tree shows at a moment: what lives with what it is under, and of what is over the newest.

Nothing recurses; a moment costs what is shown, however many tasks there are.
"""

from bisect import bisect_left
from collections.abc import Iterable
from typing import NamedTuple

from tca_tools.replay.recording import Living, Recording
from tca_tools.run.at_time import RunAt
from tca_tools.tasktree_viz.outline import SHOWN_AT_MOST
from tca_wire.points import ROOT, TaskId

MOST_ROWS = 3000
"""Of a tree that is larger even so, the rest is cut off."""
_ENDS, _LIVING = 2, 12
"""Of many siblings so many are shown at either end, and so many that live."""


class Row(NamedTuple):
    """A line of the tree: a task, or several that are left out."""

    task: int
    """Its number (0: it stands for others)."""
    parent: int
    guides: str
    """What is drawn before its name."""
    folded: int = 0
    """How many it stands for; of a task: how many under it are not shown."""


class Outline:
    """What the user has opened and closed, and the rows that come of that."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._living = Living(recording.run)
        self._opened: dict[int, bool] = {}
        self._is_small = True
        self._selected = 0

    @property
    def living(self) -> int:
        """How many tasks live at the moment of the last rows."""
        return self._living.number

    def toggle(self, task: int, *, is_open: bool) -> None:
        """Open a task that is closed, close one that is open."""
        self._opened[task] = not is_open

    def rows(self, at: RunAt, selected: int = 0) -> list[Row]:
        """The rows at a moment; what the *selected* task is under is open."""
        self._living.move(at.moment)
        self._is_small = len(at.tasks) <= SHOWN_AT_MOST
        needed = set(self._above(selected, at)) - {selected}
        self._selected = selected
        rows: list[Row] = []
        waiting = list(reversed(self._below(at, ROOT, "", needed)))
        while waiting and len(rows) < MOST_ROWS:
            row = waiting.pop()
            if row.task:
                shown = self._below(at, row.task, _under(row.guides), needed) if self._is_open(row.task, needed) else []
                hidden = self._hidden(at, row.task) if not shown else 0
                row = row._replace(folded=hidden)
                waiting += reversed(shown)
            rows.append(row)
        if waiting:
            rows.append(Row(0, ROOT, "", len(waiting)))
        return rows

    def _hidden(self, at: RunAt, task: int) -> int:
        """How many tasks are under one that is closed: all of them, if it is over."""
        lives = task in self._living.below.get(self._recording.run.tasks[task].parent, ())
        return len(at.children(task)) if lives else self._recording.sizes[task] - 1

    def _above(self, task: int, at: RunAt) -> Iterable[int]:
        """The task and all that it is under."""
        while task and task in at.tasks:
            yield task
            task = self._recording.run.tasks[task].parent

    def _is_open(self, task: int, needed: set[int]) -> bool:
        if (chosen := self._opened.get(task)) is not None:
            return chosen
        return (
            self._is_small
            or task in needed
            or task in self._living.below.get(self._recording.run.tasks[task].parent, ())
        )

    def _below(self, at: RunAt, parent: int, indent: str, needed: set[int]) -> list[Row]:
        """The rows right under a task."""
        children = at.children(parent)
        shown = sorted(self._shown(children, parent, needed))
        rows: list[Row] = []
        is_deep = len(indent) > 3 * 12
        start = f"[{self._recording.depths[parent] + 1}] " if is_deep else indent
        before = 0
        for place in [*shown, len(children)]:
            if place > before:
                rows.append(Row(0, parent, start + ("├─ " if place < len(children) else "└─ "), place - before))
            if place < len(children):
                is_last = place == len(children) - 1
                rows.append(Row(int(children[place]), parent, start + ("└─ " if is_last else "├─ ")))
            before = place + 1
        return rows if parent != ROOT else [row._replace(guides="") for row in rows]

    def _shown(self, children: list[TaskId], parent: int, needed: set[int]) -> set[int]:
        """The places of the children that are shown."""
        count = len(children)
        if count <= 2 * _ENDS + _LIVING:
            return set(range(count))
        living = list(self._living.below.get(parent, ()))
        chosen = living if len(living) <= _LIVING else [*living[: _LIVING // 2], *living[-_LIVING // 2 :]]
        places = {bisect_left(children, child) for child in chosen}
        wanted = needed | ({self._selected} if self._selected else set())
        places |= {bisect_left(children, task) for task in wanted if self._is_there(task, parent, children)}
        return places | set(range(_ENDS)) | set(range(count - _ENDS, count))

    def _is_there(self, task: int, parent: int, children: list[TaskId]) -> bool:
        """Whether a task is among the children that had been sent."""
        return self._recording.run.tasks[task].parent == parent and task <= children[-1]


def _under(guides: str) -> str:
    """What stands before the children of a row with these guides."""
    if guides.startswith("["):
        return guides.replace("├─ ", "│  ").replace("└─ ", "   ")
    return guides.replace("├─ ", "│  ").replace("└─ ", "   ") or " "
