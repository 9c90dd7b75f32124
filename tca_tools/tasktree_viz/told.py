"""The story of one task as text: where it stands, what happened to it, and the chain of its failure."""

from collections.abc import Iterator
from textwrap import wrap

import click

from tca_tools.past import Past
from tca_tools.selection import lineage
from tca_tools.story import story
from tca_tools.tasktree_viz.failing import failure_chain
from tca_tools.tasktree_viz.text import COLOURS
from tca_tools.tasktree_viz.words import failure_line
from tca_tools.terminal import columns_of, cut, printable
from tca_wire.points import TaskId

_WIDTH_OF_FILE = 120
_NARROWEST = 40
_TIMES = 22


def story_lines(past: Past, number: TaskId, width: int | None = None) -> Iterator[str]:
    """The story, line by line, wrapped to *width*."""
    width = max(width or _WIDTH_OF_FILE, _NARROWEST)
    task = past.tasks[number]
    above = list(reversed(lineage(past, number)))[:-1]
    name = cut(printable(str(task)), width - len(task.state) - 2)
    yield f"{name}: {click.style(task.state, fg=COLOURS[task.state])}"
    if above:
        yield from _wrapped("under ", " > ".join(printable(past.describe(one)) for one in above), width)
    yield ""
    for sentence in story(past, number):
        seconds = "" if sentence.seconds is None else f"{sentence.seconds:.3f} s"
        so_far = f", {past.time - sentence.time:.3f} s so far" if sentence.is_open else ""
        yield from _wrapped(f"{sentence.time:9.3f} {seconds:>11}  ".ljust(_TIMES), sentence.text + so_far, width)
    chain = failure_chain(past, number)
    if chain:
        yield ""
        yield "its failure, step by step:"
    for link in chain:
        yield from _wrapped(f"{link.time:9.3f}  {'  ' * link.depth}", failure_line(link.text), width)


def _wrapped(start: str, text: str, width: int) -> Iterator[str]:
    """*text* after *start*; what is too long for a line goes on below, and so do the lines of a traceback."""
    room = max(width - len(start), _NARROWEST // 2)
    for line in text.splitlines() or [""]:
        indent = " " * (len(line) - len(line.lstrip()))
        said = printable(line.strip())
        least = room if columns_of(said) <= len(said) else room // 2  # wide characters take two columns
        pieces = wrap(said, least, initial_indent=indent, subsequent_indent=indent) or [""]
        for piece in pieces:
            yield (start + piece).rstrip()
            start = " " * len(start)
