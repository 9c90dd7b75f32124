"""``tca tree``: the task tree of a run, on the terminal or as a picture."""

from pathlib import Path

import click

from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.journal.selection import Forest, check_modules, one_message, part_of, tasks_called
from tca_tools.options import Asked, check_output, check_span, output_option, shared_options
from tca_tools.output import show_text
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.files import KINDS, LAYOUTS, write_picture
from tca_tools.tasktree_viz.outline import SHOWN_AT_MOST, Row, excerpt, outline, whole_outline
from tca_tools.tasktree_viz.text import ASCII, UNICODE, story_lines, tree_lines
from tca_tools.terminal import can_show, cut, line_width
from tca_wire.text.printable import printable

_DRAWN, _MOST_DRAWN, _MOST_IN_FIGURE = 120, 240, 60
"""For a large tree: about how many tasks a picture shows, the most rows of a picture, and the most
boxes of a figure.
"""


@click.command()
@shared_options
@click.option(
    "--story", metavar="TASK", help="Tell the story of this task (or query, ...) and its failure."
)
@output_option(".svg, .png, .pdf, .html, .dot or .txt")
@click.option(
    "--layout",
    type=click.Choice(LAYOUTS),
    default="auto",
    help="The layout of a picture [auto: by its size].",
)
@click.option("--data", is_flag=True, help="Show the tasks' data and results, too.")
@click.option("--all", "everything", is_flag=True, help="Show every task, also of a large tree.")
@click.option("--ascii", "as_ascii", is_flag=True, help="Draw guides with ASCII characters.")
def tree(
    asked: Asked,
    story: str | None,
    output: Path | None,
    layout: str,
    *,
    data: bool,
    everything: bool,
    as_ascii: bool,
) -> None:
    """Show the task tree of a run."""
    check_output(output, (".txt",) if story else KINDS, force=asked.force)
    journal = open_log(asked.log_path)
    history = folded(journal, asked.at)
    width = None if output else line_width()
    if story:
        show_text("\n".join(story_lines(history, one_message(history, story), width)), output)
        journal.check()
        return
    at = RunAt.by_clock(history, asked.at, history.time)
    forest = _forest(at, asked)
    kind = output.suffix if output else ".txt"
    rows = _chosen_rows(forest, everything, kind, layout)
    what = f", task {printable(asked.task)}" if asked.task is not None else ""
    title = f"{printable(journal.name)}{what}: {words.summary(forest, is_live=history.is_live)}"
    if output is None or kind == ".txt":
        guides = ASCII if as_ascii or (output is None and not can_show("├─└│…")) else UNICODE
        lines = tree_lines(at, rows, guides=guides, width=width, with_data=data)
        show_text("\n".join([cut(title, width), *lines]), output)
    else:
        write_picture(output, at, rows, title, layout, with_data=data)
    journal.check()


def _forest(at: RunAt, asked: Asked) -> Forest:
    """Return the tasks that the options select. Raises NotInLog."""
    check_modules(at.run, asked.modules)
    check_span(asked.start, at.time if asked.end is None else asked.end)
    if (asked.task, asked.modules, asked.start, asked.end) == (None, (), None, None):
        return at
    roots = tasks_called(at.run, asked.task) if asked.task is not None else None
    return part_of(at, roots=roots, modules=asked.modules, start=asked.start, end=asked.end)


def _chosen_rows(forest: Forest, everything: bool, kind: str, layout: str) -> list[Row]:
    """Return the rows to show.

    A text is folded only if it is long, since it scrolls. A picture has fewer rows, and a figure
    fewest.
    """
    if everything or (len(forest.tasks) <= SHOWN_AT_MOST and kind == ".txt"):
        return whole_outline(forest)
    if kind == ".txt":
        return outline(forest)
    most = _MOST_IN_FIGURE if kind == ".dot" or layout == "figure" else _MOST_DRAWN
    return excerpt(forest, outline(forest, budget=_DRAWN), most)


if __name__ == "__main__":
    tree(prog_name="python -m tca_tools.tasktree_viz")
