"""The task tree as text: one line a task, with guides, states, times and what each task waits for."""

from collections.abc import Iterator
from dataclasses import dataclass

import click

from tca_tools.records import State
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.outline import Row
from tca_tools.terminal import columns_of, cut, padded
from tca_tools.then import TaskThen, Then
from tca_wire.points import Interval

COLOURS = {
    State.HELD: "bright_black",
    State.QUEUED: "yellow",
    State.PLANNING: "magenta",
    State.PLANNED: "blue",
    State.HANDLING: "cyan",
    State.ACHIEVING: "cyan",
    State.ACHIEVED: "green",
    State.RECOVERING: "bright_red",
    State.SUSPENDED: "yellow",
    State.ENDING: "bright_red",
    State.FAILED: "red",
    State.KILLED: "red",
}
_WIDEST_NAME, _WIDEST_WITHOUT_END = 48, 64
"""Columns that guides and name may take: of a terminal, and where lines have no end."""
_SHORTEST_NAME = 20
"""Columns that guides must leave for a name."""
_SHORTEST_NOTE = 12
"""Columns of a note that must be left to say for how long it is so, too."""
_WIDE = 8
"""Levels whose guides have room."""
_STATE_WIDTH = max(map(len, State))
_TIMES_WIDTH = 13


@dataclass(frozen=True)
class Guides:
    """What is drawn before a task's name."""

    child: str = "├─ "
    last_child: str = "└─ "
    beside: str = "│  "
    empty: str = "   "


UNICODE, ASCII = Guides(), Guides("|- ", "`- ", "|  ", "   ")


def tree_lines(
    then: Then, rows: list[Row], *, guides: Guides = UNICODE, width: int | None = None, with_data: bool = False
) -> Iterator[str]:
    """The tree, line by line, below a line of headings; each cut to *width*."""
    if not rows:
        yield "(no task was sent)"
        return
    widest = _WIDEST_WITHOUT_END if width is None else max(_WIDEST_NAME, width - 60)
    prefixes = _prefixes(rows, guides, _levels(widest))
    labels = [before + _name(row) for row, (before, _) in zip(rows, prefixes, strict=True)]
    name_width = min(max(map(columns_of, labels)), widest)
    heading = f"{'task':{name_width}}  {'state':{_STATE_WIDTH}}  {'planning':{_TIMES_WIDTH}}  achieving"
    yield click.style(cut(heading, width), dim=True)
    for row, label, (_, below) in zip(rows, labels, prefixes, strict=True):
        if row.task is None:
            yield click.style(cut(label, width), fg=COLOURS[row.state])
            continue
        yield _task_line(then, row.task, padded(label, name_width), width)
        if with_data and (data := words.data(row.task)):
            yield click.style(cut(f"{below}{data}", width), dim=True)


def _name(row: Row) -> str:
    return words.called(row.task) if row.task else words.folded(row)


def _task_line(then: Then, task: TaskThen, label: str, width: int | None) -> str:
    state = task.state
    spans = [f"{_times(task, interval):{_TIMES_WIDTH}}" for interval in (Interval.PLANNING, Interval.ACHIEVING)]
    note, since = words.note_since(then, task)
    lasted = "" if since is None else words.lasting(then.time - since)
    rest = "  ".join([f"{state:{_STATE_WIDTH}}", *spans, note]).rstrip()
    room = _rest_of(width, label)
    if room is not None and room - len(lasted) > len(rest) - len(note) + _SHORTEST_NOTE:
        rest, lasted = cut(rest, room - len(lasted)) + lasted, ""  # how long is the last to be cut
    rest = cut(rest + lasted, room)
    return f"{label}  {click.style(rest[:_STATE_WIDTH], fg=COLOURS[state])}{rest[_STATE_WIDTH:]}"


def _times(task: TaskThen, interval: Interval) -> str:
    if not (span := words.span(task, interval)):
        return ""
    start, end = span
    return f"{start:.2f}-" if end is None else f"{start:.2f}-{end:.2f}"


def _rest_of(width: int | None, label: str) -> int | None:
    return None if width is None else max(width - columns_of(label) - 2, 0)


def _prefixes(rows: list[Row], guides: Guides, levels: int) -> list[tuple[str, str]]:
    """What stands before each row's name, and before lines below it that belong to it.

    Down to _WIDE levels guides are three columns wide, further down two; after so many *levels* indentation begins
    anew, behind the depth as a number.
    """
    prefixes: list[tuple[str, str]] = []
    inner: list[str] = []  # for each row, what stands before its children's guides
    for row in rows:
        before = inner[row.parent] if row.parent >= 0 else ""
        if row.depth and row.depth % levels == 0:
            before = f"[{row.depth}] "
        child, beside = (guides.last_child, guides.empty) if row.is_last else (guides.child, guides.beside)
        if row.depth == 0:
            child = beside = ""
        if row.depth % levels > _WIDE:
            child, beside = child[0] + child[2], beside[:2]
        beside = (" " * len(before) if before.startswith("[") else before) + beside
        inner.append(beside)
        prefixes.append((before + child, beside + guides.empty))
    return prefixes


def _levels(name_width: int) -> int:
    """How many levels leave room for a name."""
    return max(_WIDE, _WIDE + (name_width - _SHORTEST_NAME - 3 * _WIDE) // 2)
