"""The task tree as text: one line a task, with guides, states, times and what each task waits for."""

from collections.abc import Iterator
from dataclasses import dataclass

import click

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.fates import HANDLED, WATCHING
from tca_tools.run.records import OVER, State
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut, cut_name, padded
from tca_wire.points import Interval

COLOURS: dict[str, str] = {
    State.HELD: "bright_black",
    State.QUEUED: "yellow",
    State.PLANNING: "magenta",
    State.PLANNED: "blue",
    State.HANDLING: "cyan",
    State.ACHIEVING: "cyan",
    WATCHING: "cyan",
    State.ACHIEVED: "green",
    State.RECOVERING: "bright_red",
    State.SUSPENDED: "yellow",
    State.ENDING: "bright_red",
    State.FAILED: "red",
    HANDLED: "yellow",
    State.KILLED: "red",
}
_WIDEST_NAME, _WIDEST_WITHOUT_END = 48, 64
"""Columns that guides and name may take: of a terminal, and where lines have no end."""
_SHORTEST_NAME = 20
"""Columns that guides must leave for a name; on a narrow terminal, two fifths of what there is."""
_LEAST_NOTE = 4
"""Columns: where there are fewer nothing is noted."""
_WIDE = 8
"""Levels whose guides have room."""
_STATE_WIDTH = max(map(len, State))
_TIMES_WIDTH = 13
_GAP = 2
"""Columns between two columns."""
_NOTE_WIDTH = 24
"""Columns of notes before which times give way while something goes on: what a task waits for says more."""


@dataclass(frozen=True, slots=True)
class _Columns:
    """What stands beside the names."""

    state_width: int
    has_times: bool
    """Whether there is room for when tasks were planned and achieved."""


@dataclass(frozen=True)
class Guides:
    """What is drawn before a task's name."""

    child: str = "├─ "
    last_child: str = "└─ "
    beside: str = "│  "
    empty: str = "   "


UNICODE, ASCII = Guides(), Guides("|- ", "`- ", "|  ", "   ")


def tree_lines(
    at: RunAt, rows: list[Row], *, guides: Guides = UNICODE, width: int | None = None, with_data: bool = False
) -> Iterator[str]:
    """The tree, line by line, below a line of headings; each cut to *width*."""
    if not rows:
        yield "(no task was sent)"
        return
    state_width = max(_STATE_WIDTH, *(len(row.task.standing) for row in rows if row.task))
    widest = _widest(width, state_width)
    before_names = prefixes(rows, guides, *_levels(widest))
    names = [(before, _name(row)) for row, (before, _) in zip(rows, before_names, strict=True)]
    name_width = min(max(columns_of(before + name) for before, name in names), widest)
    numbers = [row.task.id if row.task else 0 for row in rows]
    labels = [
        before + cut_name(name, number, name_width - columns_of(before))
        for number, (before, name) in zip(numbers, names, strict=True)
    ]
    beside = name_width + state_width + 3 * _GAP + 2 * _TIMES_WIDTH
    goes_on = any(row.task and row.task.state not in OVER for row in rows)
    columns = _Columns(state_width, width is None or beside + _NOTE_WIDTH * goes_on <= width)
    times = f"  {'planning':{_TIMES_WIDTH}}  achieving" if columns.has_times else ""
    yield click.style(cut(f"{padded('task', name_width)}  {'state':{state_width}}{times}", width), dim=True)
    for row, label, (_, below) in zip(rows, labels, before_names, strict=True):
        if row.task is None:
            yield click.style(cut(label, width), fg=COLOURS.get(row.state))
            continue
        yield _task_line(at, row.task, padded(label, name_width), columns, width)
        if with_data and (data := words.data(row.task)):
            yield click.style(cut(f"{below}{data}", width), dim=True)


def _name(row: Row) -> str:
    return words.called(row.task) if row.task else words.folded(row)


def _task_line(at: RunAt, task: TaskAt, label: str, columns: _Columns, width: int | None) -> str:
    state, states = task.standing, columns.state_width
    intervals = (Interval.PLANNING, Interval.ACHIEVING) if columns.has_times else ()
    spans = [f"{_times(task, interval):{_TIMES_WIDTH}}" for interval in intervals]
    found = words.note_of(at, task)
    rest, room = "  ".join([f"{state:{states}}", *spans]), _rest_of(width, label)
    left = None if room is None else room - len(rest) - _GAP  # for the note
    if left is None:
        rest = f"{rest}  {found.within(None, at.time)}".rstrip()
    elif left >= _LEAST_NOTE:
        rest = f"{rest}  {found.within(left, at.time)}".rstrip()
    else:
        rest = cut(rest, room)
    return f"{label}  {click.style(rest[:states], fg=COLOURS[state])}{rest[states:]}"


def _times(task: TaskAt, interval: Interval) -> str:
    if not (span := words.span(task, interval)):
        return ""
    start, end = span
    return f"{start:.2f}-" if end is None else f"{start:.2f}-{end:.2f}"


def _rest_of(width: int | None, label: str) -> int | None:
    return None if width is None else max(width - columns_of(label) - 2, 0)


def prefixes(rows: list[Row], guides: Guides, wide: int, levels: int) -> list[tuple[str, str]]:
    """What stands before each row's name, and before lines below it that belong to it.

    Down to *wide* levels guides are three columns wide, further down two; after so many *levels* indentation begins
    anew, behind the depth as a number.
    """
    found: list[tuple[str, str]] = []
    inner: list[str] = []  # for each row, what stands before its children's guides
    for row in rows:
        before = inner[row.parent] if row.parent >= 0 else ""
        if row.depth and row.depth % levels == 0:
            before = f"[{row.depth}] "
        child, beside = (guides.last_child, guides.empty) if row.is_last else (guides.child, guides.beside)
        if row.depth == 0:
            child = beside = ""
        if row.depth % levels > wide:
            child, beside = child[0] + child[2], beside[:2]
        beside = (" " * len(before) if before.startswith("[") else before) + beside
        inner.append(beside)
        found.append((before + child, beside + guides.empty))
    return found


def _widest(width: int | None, state_width: int) -> int:
    """Columns that guides and name may take at most: on a narrow terminal what the state leaves, but half of all."""
    if width is None:
        return _WIDEST_WITHOUT_END
    return max(min(max(_WIDEST_NAME, width - 60), max(width - _GAP - state_width, width // 2)), 1)


def _levels(name_width: int) -> tuple[int, int]:
    """How many levels have wide guides, and how many leave room for a name."""
    room = name_width - min(_SHORTEST_NAME, 2 * name_width // 5)
    wide = min(max(room - 2 * _WIDE, 1), _WIDE)
    return wide, max(wide + (room - 3 * wide) // 2, 2)
