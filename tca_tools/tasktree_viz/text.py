"""The task tree as text: one line a task, with guides, states, times and what each task waits for;
and a story.
"""

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
"""Columns that guides and name may take: of a terminal, and where lines have no end."""
_SHORTEST_NAME = 20
"""Columns that guides must leave for a name; on a narrow terminal, two fifths of what there is."""
_LEAST_NOTE = 4
"""Columns: where there are fewer nothing is noted."""
_WIDE = 8
"""Levels whose guides have room."""
_STATE_WIDTH = max(len(state) for state in TaskState if state is not TaskState.RESOLVED)
_TIMES_WIDTH = 13
_GAP = 2
"""Columns between two columns."""
_NOTE_WIDTH = 36
"""Columns of notes before which times give way: why a task waits or failed says more."""
_WIDTH_OF_FILE = 120
_NARROWEST, _NARROW = 20, 50
"""Columns: no line is cut shorter; in fewer how long something took stands behind it."""
_TIMES_OF_STORY = 22
_LEAST_WORDS = 8
"""Columns that are left for words."""


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
    """The tree, line by line, below a line of headings; each cut to *width*."""
    if not rows:
        yield "(no task was sent)"
        return
    states = max(_STATE_WIDTH, *(len(row.task.standing) for row in rows if row.task))
    widest = _widest(width, states)
    before_names = prefixes(rows, guides, *_levels(widest))
    names = list(map(words.label, rows))
    pairs = zip(before_names, names, strict=True)
    name_width = min(max(columns_of(before + name) for (before, _), name in pairs), widest)
    notes = [words.note_of(at, row.task) if row.task else None for row in rows]
    told = (note.within(None, at.time) for note in notes if note)
    longest = max(map(columns_of, told), default=0)
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
        yield f"{padded(label, name_width)}  {click.style(rest[:states], fg=COLOURS[row.task.standing])}{rest[states:]}"
        if with_data and (data := words.data(row.task)):
            yield click.style(cut(f"{below}{data}", width), dim=True)


def _time_columns(rows: list[Row], room: int | None) -> dict[Interval, int]:
    """The columns of times and how wide they are; where there is no room, those of the last
    interval, or none.
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
    """The state and times of a task, and as much of what is to be noted as there is room for."""
    left = None if room is None else room - len(cells) - _GAP
    if left is not None and left < _LEAST_NOTE:
        return cut(cells, room)
    return f"{cells}  {note.within(left, time)}".rstrip()


def prefixes(rows: list[Row], guides: Guides, wide: int, levels: int) -> list[tuple[str, str]]:
    """The prefix of each row's name, and that of the lines below that belong to it.

    Down to *wide* levels guides are three columns wide, further down two; after so many *levels*
    indentation begins anew, behind the depth as a number.
    """
    found: list[tuple[str, str]] = []
    inner: list[str] = []  # for each row, what stands before its children's guides
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


def _widest(width: int | None, state_width: int) -> int:
    """Columns that guides and name may take at most: on a narrow terminal what the state leaves,
    but half of all.
    """
    if width is None:
        return _WIDEST_WITHOUT_END
    room = max(width - _GAP - state_width, width // 2)
    return max(min(max(_WIDEST_NAME, width - 60), room), 1)


def _levels(name_width: int) -> tuple[int, int]:
    """How many levels have wide guides, and how many leave room for a name."""
    room = name_width - min(_SHORTEST_NAME, 2 * name_width // 5)
    wide = min(max(room - 2 * _WIDE, 1), _WIDE)
    return wide, max(wide + (room - 3 * wide) // 2, 2)


# --- the story of one message; of a task also where it stands, and the chain of its failure -------


def story_lines(run: Run, number: int, width: int | None = None) -> Iterator[str]:
    """The story as far as the past goes, line by line, wrapped to *width*."""
    width = max(width or _WIDTH_OF_FILE, _NARROWEST)
    message = run.messages[number]
    if isinstance(message, Task):
        yield from _task_lines(run, message, width)
    else:  # it has no place in the tree
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
        text = link.brief or link.text  # why it failed itself, its story tells
        if link.depth:
            text = failure_line(link.text)
        yield from _wrapped(f"{link.time:9.3f}  {'  ' * link.depth}", text, width)


def _task_lines(run: Run, task: Task, width: int) -> Iterator[str]:
    """Where a task stands, what it is under and what it waits for in the end."""
    above = list(reversed(lineage(run, TaskId(task.id))))[:-1]
    stands = standing(run, task, task.state)
    name = cut(printable(str(task)), width - len(stands) - 2)
    yield f"{name}: {click.style(stands, fg=COLOURS[stands])}"
    if above:
        names = [printable(run.describe(one)) for one in above]
        yield from _wrapped("under ", " > ".join(names), width)
    at = RunAt(run)
    if end := in_the_end(at, at.tasks[task.id]):
        yield from _wrapped("waits in the end ", str(end), width)


def _wrapped(start: str, text: str, width: int) -> Iterator[str]:
    """*text* after *start*; what is too long for a line goes on below, and so do the lines of a
    traceback.
    """
    room = max(width - len(start), _LEAST_WORDS)
    for line in text.splitlines() or [""]:
        indent = " " * (len(line) - len(line.lstrip()))
        said = printable(line.strip())
        # wide characters take two columns
        least = room if columns_of(said) <= len(said) else room // 2
        pieces = wrap(said, least, initial_indent=indent, subsequent_indent=indent)
        for piece in pieces or [""]:
            yield (start + piece).rstrip()
            start = " " * len(start)
