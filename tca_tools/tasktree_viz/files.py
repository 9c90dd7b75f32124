"""A picture of a tree as a file: a figure or an outline, as its name and its size ask for."""

from collections import Counter
from pathlib import Path

import click

from tca_tools.drawing.graphviz import drawn
from tca_tools.drawing.page import zoomed_page
from tca_tools.drawing.pictures import converted
from tca_tools.errors import NoPicture
from tca_tools.journal.at_time import RunAt
from tca_tools.output import made_for, write_output
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.outline import Row
from tca_tools.tasktree_viz.outline_svg import outline_svg

KINDS = (".svg", ".png", ".pdf", ".html", ".dot", ".txt")
LAYOUTS = ("auto", "figure", "outline")
_MOST_DRAWN = 3000
"""Beyond that many boxes nobody could read the picture."""
_FIGURE, _FIGURE_WIDE = 14, 9
"""A figure has at most so many leaves, and so many boxes at one depth: a wider one can't be read on a screen."""


def write_picture(output: Path, at: RunAt, rows: list[Row], title: str, layout: str, *, with_data: bool) -> None:
    """Write the kind of picture that the file's name asks for. Raises ToolError if that can't be done."""
    kind = output.suffix[1:]
    if kind == "dot":
        write_output(output, dot_source(at, rows, title, with_data=with_data))
        return
    if len(rows) > _MOST_DRAWN:
        raise NoPicture(
            f"{len(rows)} tasks are too many for a picture: ask for a part with --task, --module, --from and --to,"
            " or for a .txt"
        )
    with made_for(output):  # without "dot" a library draws into a file of its own
        picture = None
        if layout == "figure" or (layout == "auto" and is_figure(rows)):
            source = dot_source(at, rows, title, with_data=with_data)
            picture = _figure(kind, source, is_asked=layout == "figure")
        if picture is None:
            svg = outline_svg(at, rows, title, with_data=with_data)
            picture = svg.encode() if kind in ("svg", "html") else converted(svg, kind)
    write_output(output, zoomed_page(title, picture.decode()) if kind == "html" else picture)


def is_figure(rows: list[Row]) -> bool:
    """Whether the tree is small enough for a figure."""
    beside = Counter(row.depth for row in rows)
    leaves = len(rows) - len({row.parent for row in rows if row.parent >= 0})
    return leaves <= _FIGURE and max(beside.values(), default=0) <= _FIGURE_WIDE


def _figure(kind: str, source: str, *, is_asked: bool) -> bytes | None:
    """The tree as Graphviz draws it; None if that can't be done here, unless it *is asked* for."""
    try:
        return drawn(source, "svg" if kind == "html" else kind)
    except NoPicture as error:
        if is_asked:
            raise
        click.echo(f"{error.message}: drawn as an outline", err=True)
        return None
