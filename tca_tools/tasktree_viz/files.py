"""Write a picture of a tree, as a figure or an outline: by its name and the tree's size."""

from collections import Counter
from pathlib import Path

import click

from tca_tools.drawing.pictures import write_graph, write_svg
from tca_tools.errors import NoPicture
from tca_tools.journal.at_time import RunAt
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.outline import Row
from tca_tools.tasktree_viz.outline_svg import outline_svg

KINDS = (".svg", ".png", ".pdf", ".html", ".dot", ".txt")
LAYOUTS = ("auto", "figure", "outline")
_MOST_DRAWN = 3000
"""A picture of more boxes would not be readable."""
_FIGURE, _FIGURE_WIDE = 14, 9
"""The most leaves of a figure, and its most boxes at one depth. A wider figure does not fit a
screen.
"""


def write_picture(
    output: Path, at: RunAt, rows: list[Row], title: str, layout: str, *, with_data: bool
) -> None:
    """Write the kind of picture that the file's name asks for.

    Args:
        output: the file; its suffix is one of `KINDS`, except .txt.
        at: the run at an instant.
        rows: the rows of the tree.
        title: the title of the picture.
        layout: one of `LAYOUTS`.
        with_data: whether to show each task's data and result.

    Raises:
        ToolError: the picture can't be drawn or written.
    """
    is_source = output.suffix == ".dot"
    if len(rows) > _MOST_DRAWN and not is_source:
        raise NoPicture(
            f"{len(rows)} tasks are too many for a picture: choose a part with --task, --module,"
            " --from and --to, or write a .txt"
        )
    if is_source or layout == "figure" or (layout == "auto" and is_figure(rows)):
        try:
            write_graph(output, dot_source(at, rows, title, with_data=with_data), title)
        except NoPicture as error:
            if layout == "figure":
                raise
            click.echo(f"{error.message}: drawn as an outline", err=True)
        else:
            return
    write_svg(output, outline_svg(at, rows, title, with_data=with_data), title)


def is_figure(rows: list[Row]) -> bool:
    """Whether the tree is small enough for a figure."""
    beside = Counter(row.depth for row in rows)
    leaves = len(rows) - len({row.parent for row in rows if row.parent >= 0})
    return leaves <= _FIGURE and max(beside.values(), default=0) <= _FIGURE_WIDE
