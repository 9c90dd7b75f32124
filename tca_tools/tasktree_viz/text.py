"""The task tree as text, one line a task with guides, state, times and waits; a task's story."""

from collections.abc import Iterator
from dataclasses import dataclass
from textwrap import wrap

import click

from tca_tools.explain.story import story
from tca_tools.explain.wait_words import in_the_end
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import standing
from tca_tools.journal.records import Task, TaskState
from tca_tools.journal.selection import lineage
from tca_tools.journal.whole_run import Run
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.looks import LOOKS
from tca_tools.tasktree_viz.outline import Row
from tca_tools.tasktree_viz.words import failure_line
from tca_tools.terminal import columns_of, cut, cut_name, padded
from tca_wire.points import Interval, TaskId
from tca_wire.text.printable import printable

COLOURS = {standing: colour for standing, (_, colour) in LOOKS.items()}
_WIDEST_NAME, _WIDEST_WITHOUT_END = 48, 64
"""Columns of guides and name, at most: on a terminal, and without a limit of the line."""
_SHORTEST_NAME = 20
"""Columns that guides leave for a name; on a narrow terminal, two fifths of the width."""
_LEAST_NOTE = 4
"""Columns: in fewer, no note is shown."""
_WIDE = 8
"""Levels with wide guides, at most."""
_STATE_WIDTH = max(len(state) for state in TaskState if state is not TaskState.RESOLVED)
_TIMES_WIDTH = 13
_GAP = 2
"""Columns between two columns."""
_NOTE_WIDTH = 36
"""Times are left out if notes would have fewer columns than this: a reason says more than times."""
_WIDTH_OF_FILE = 120
_NARROWEST, _NARROW = 20, 50
"""Columns: no line is cut to fewer than the first number. If a line has fewer than the second, a
duration stands after its text.
"""
_TIMES_OF_STORY = 22
_LEAST_WORDS = 8
"""Columns for the words of a story, at least."""


@dataclass(frozen=True)
class Guides:
    """The lines before a task's name."""

    child: str = "├─ "
    last_child: str = "└─ "
    beside: str = "│  "
    empty: str = "   "


UNICODE, ASCII = Guides(), Guides("|- ", "`- ", "|  ", "   ")


def tree_lines(
    at: RunAt,
    rows: list[Row],
    *,
    guides: Guides = UNICODE,
    width: int | None = None,
    with_data: bool = False,
) -> Iterator[str]:
    """Yield the tree line by line below a line of headings.

    Args:
        at: the run at an instant.
        rows: the rows of the tree.
        guides: the characters that connect a task with its children.
        width: the columns of a line; None: no limit.
        with_data: whether to show each task's data and result.
    """
    if not rows:
        yield "(no task was sent)"
        return
    states = max(_STATE_WIDTH, *(len(row.task.standing) for row in rows if row.task))
    widest = _widest_name(width, states)
    before_names = prefixes(rows, guides, *_levels(widest))
    names = list(map(words.label, rows))
    pairs = zip(before_names, names, strict=True)
    name_width = min(max(columns_of(before + name) for (before, _), name in pairs), widest)
    notes = [words.note_of(at, row.task) if row.task else None for row in rows]
    whole_notes = (note.within(None, at.time) for note in notes if note)
    longest = max(map(columns_of, whole_notes), default=0)
    beside = name_width + states + _GAP
    if longest:
        beside += min(longest, _NOTE_WIDTH) + _GAP
    times = _time_columns(rows, None if width is None else width - beside)
    headings = [padded("task", name_width), f"{'state':{states}}"]
    headings += [f"{one:{wide}}" for one, wide in times.items()]
    yield click.style(cut("  ".join(headings).rstrip(), width), dim=True)
    for row, name, note, (before, below) in zip(rows, names, notes, before_names, strict=True):
        number, left = row.task.id if row.task else 0, name_width - columns_of(before)
        label = before + cut_name(name, number, left)
        if row.task is None or note is None:
            yield click.style(cut(label, width), fg=COLOURS.get(row.state))
            continue
        cells = [f"{row.task.standing:{states}}"]
        cells += [f"{words.times(row.task, one):{wide}}" for one, wide in times.items()]
        room = None if width is None else max(width - name_width - _GAP, 0)
        rest = _with_note(note, at.time, "  ".join(cells), room)
        state = click.style(rest[:states], fg=COLOURS[row.task.standing])
        yield f"{padded(label, name_width)}  {state}{rest[states:]}"
        if with_data and (data := words.data(row.task)):
            yield click.style(cut(f"{below}{data}", width), dim=True)


def _time_columns(rows: list[Row], room: int | None) -> dict[Interval, int]:
    """Return the columns of times with their widths.

    Without enough room, the times of planning are left out, then those of achieving.
    """
    tasks = [row.task for row in rows if row.task]
    columns = {
        one: max([_TIMES_WIDTH, *(len(words.times(task, one)) for task in tasks)])
        for one in (Interval.PLANNING, Interval.ACHIEVING)
    }
    while room is not None and columns and sum(columns.values()) + len(columns) * _GAP > room:
        del columns[next(iter(columns))]
    return columns


def _with_note(note: words.TaskNote, time: float, cells: str, room: int | None) -> str:
    """Return the state and times of a task, with as much of its note as fits."""
    left = None if room is None else room - len(cells) - _GAP
    if left is not None and left < _LEAST_NOTE:
        return cut(cells, room)
    return f"{cells}  {note.within(left, time)}".rstrip()


def prefixes(rows: list[Row], guides: Guides, wide: int, levels: int) -> list[tuple[str, str]]:
    """Return two prefixes for each row: that of its name, and that of further lines of the row.

    Guides are three columns wide down to level *wide*, and two columns below that level. After
    every *levels* levels, the indentation starts again with the depth as a number.
    """
    found: list[tuple[str, str]] = []
    inner: list[str] = []  # for each row, the prefix of its children's guides
    for row in rows:
        before = inner[row.parent] if row.parent >= 0 else ""
        if row.depth and row.depth % levels == 0:
            before = f"[{row.depth}] "
        child, beside = guides.child, guides.beside
        if row.is_last:
            child, beside = guides.last_child, guides.empty
        if row.depth == 0:
            child = beside = ""
        if row.depth % levels > wide:
            child, beside = child[0] + child[2], beside[:2]
        beside = (" " * len(before) if before.startswith("[") else before) + beside
        inner.append(beside)
        found.append((before + child, beside + guides.empty))
    return found


def _widest_name(width: int | None, state_width: int) -> int:
    """Return the greatest width of guides and name, in columns.

    A narrow terminal leaves room for the state, but gives the name at least half of the line.
    """
    if width is None:
        return _WIDEST_WITHOUT_END
    room = max(width - _GAP - state_width, width // 2)
    return max(min(max(_WIDEST_NAME, width - 60), room), 1)


def _levels(name_width: int) -> tuple[int, int]:
    """Return the number of levels with wide guides, and of levels that leave room for a name."""
    room = name_width - min(_SHORTEST_NAME, 2 * name_width // 5)
    wide = min(max(room - 2 * _WIDE, 1), _WIDE)
    return wide, max(wide + (room - 3 * wide) // 2, 2)


# --- the story of one message, or of a task with its state and the chain of its failure -----------


def story_lines(run: Run, number: int, width: int | None = None) -> Iterator[str]:
    """Yield the story of a message up to the run's time, line by line, wrapped to *width*."""
    width = max(width or _WIDTH_OF_FILE, _NARROWEST)
    message = run.messages[number]
    if isinstance(message, Task):
        yield from _task_lines(run, message, width)
    else:
        kind = str(message.message_class)
        yield f"{cut(printable(str(message)), width - len(kind) - 2)}: {kind}"
    yield ""
    for sentence in story(run, number, run.time):
        seconds = "" if sentence.seconds is None else f"{sentence.seconds:.3f} s"
        start, text = f"{sentence.time:9.3f} {seconds:>11}  ".ljust(_TIMES_OF_STORY), sentence.text
        if width < _NARROW:
            start = f"{sentence.time:9.3f}  "
            text += f", {seconds}" if seconds else ""
        if sentence.is_open:
            text += f", {run.time - sentence.time:.3f} s so far"
        yield from _wrapped(start, text, width)
    chain = failure_chain(run, TaskId(number)) if isinstance(message, Task) else []
    if chain:
        yield ""
        yield from _wrapped("", "its failure, step by step:", width)
    for link in chain:
        text = link.brief or link.text  # the task's own reason stands in its story
        if link.depth:
            text = failure_line(link.text)
        yield from _wrapped(f"{link.time:9.3f}  {'  ' * link.depth}", text, width)


def _task_lines(run: Run, task: Task, width: int) -> Iterator[str]:
    """Yield a task's state, its ancestors and the last cause of its wait."""
    above = list(reversed(lineage(run, TaskId(task.id))))[:-1]
    state = standing(run, task, task.state)
    name = cut(printable(str(task)), width - len(state) - 2)
    yield f"{name}: {click.style(state, fg=COLOURS[state])}"
    if above:
        names = [printable(run.describe(one)) for one in above]
        yield from _wrapped("under ", " > ".join(names), width)
    at = RunAt(run)
    if end := in_the_end(at, at.tasks[task.id]):
        yield from _wrapped("waits in the end ", str(end), width)


def _wrapped(start: str, text: str, width: int) -> Iterator[str]:
    """Yield *text* after *start*, wrapped; further lines, as of a traceback, are indented."""
    room = max(width - len(start), _LEAST_WORDS)
    for line in text.splitlines() or [""]:
        indent = " " * (len(line) - len(line.lstrip()))
        words_of_line = printable(line.strip())
        # wide characters take two columns
        has_wide = columns_of(words_of_line) > len(words_of_line)
        columns = room // 2 if has_wide else room
        pieces = wrap(words_of_line, columns, initial_indent=indent, subsequent_indent=indent)
        for piece in pieces or [""]:
            yield (start + piece).rstrip()
            start = " " * len(start)
