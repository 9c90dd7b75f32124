"""The story of one message as text; of a task also where it stands, and the chain of its failure."""

from collections.abc import Iterator
from textwrap import wrap

import click

from tca_tools.explain.story import story
from tca_tools.explain.wait_words import in_the_end
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import standing
from tca_tools.journal.records import Task
from tca_tools.journal.selection import lineage
from tca_tools.journal.whole_run import Run
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.text import COLOURS
from tca_tools.tasktree_viz.words import failure_line
from tca_tools.terminal import columns_of, cut
from tca_wire.points import TaskId
from tca_wire.text.printable import printable

_WIDTH_OF_FILE = 120
_NARROWEST, _NARROW = 20, 50
"""Columns: no line is cut shorter; in fewer how long something took stands behind it."""
_TIMES = 22
_SHORTEST = 8
"""Columns that are left for words."""


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
        start, text = f"{sentence.time:9.3f} {seconds:>11}  ".ljust(_TIMES), sentence.text
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
    """*text* after *start*; what is too long for a line goes on below, and so do the lines of a traceback."""
    room = max(width - len(start), _SHORTEST)
    for line in text.splitlines() or [""]:
        indent = " " * (len(line) - len(line.lstrip()))
        said = printable(line.strip())
        # wide characters take two columns
        least = room if columns_of(said) <= len(said) else room // 2
        pieces = wrap(said, least, initial_indent=indent, subsequent_indent=indent)
        for piece in pieces or [""]:
            yield (start + piece).rstrip()
            start = " " * len(start)
