"""``tca tree``: the task tree of a run, on the terminal or as a picture."""

from pathlib import Path

import click

from tca_tools.errors import NoPicture
from tca_tools.history import History
from tca_tools.logs import open_log
from tca_tools.output import write_output
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.dot import dot_source
from tca_tools.tasktree_viz.outline import SHOWN_AT_MOST, Row, outline, whole_outline
from tca_tools.tasktree_viz.picture import PICTURES, drawn
from tca_tools.tasktree_viz.text import ASCII, UNICODE, tree_lines
from tca_tools.terminal import can_show, cut, line_width, printable
from tca_tools.then import Then

_MOST_DRAWN = 3000
"""Beyond that many boxes Graphviz takes minutes, and nobody could read the picture."""


@click.command()
@click.argument("log_path", metavar="[LOG]", required=False, type=click.Path(path_type=Path))
@click.option("--at", metavar="SECONDS", type=float, help="The tree as it was then (default: at the end).")
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help=".svg, .png, .pdf, .dot or .txt")
@click.option("--data", is_flag=True, help="Show the tasks' data and results, too.")
@click.option("--all", "everything", is_flag=True, help="Fold up nothing of a large tree.")
@click.option("--ascii", "as_ascii", is_flag=True, help="Draw guides with ASCII characters.")
def tree(
    log_path: Path | None, at: float | None, output: Path | None, data: bool, everything: bool, as_ascii: bool
) -> None:
    """Show the task tree of a run.

    LOG is a journal directory or one of its segments; without it, the newest run is shown.
    """
    if output and output.suffix not in (".txt", ".dot", *PICTURES):
        raise click.BadParameter(f"{output}: its name must end in .svg, .png, .pdf, .dot or .txt", param_hint="'-o'")
    journal = open_log(log_path)
    then = Then.by_clock(History.until(journal), at)
    rows = _chosen_rows(then, everything, is_picture=output is not None and output.suffix != ".txt")
    title = f"{printable(journal.name)}: {words.summary(then)}"
    if output is None:
        guides = ASCII if as_ascii or not can_show("├─└│…") else UNICODE
        width = line_width()
        click.echo(cut(title, width))
        click.echo("\n".join(tree_lines(then, rows, guides=guides, width=width, with_data=data)))
    else:
        text = [title, *tree_lines(then, rows, guides=ASCII if as_ascii else UNICODE, with_data=data)]
        if output.suffix in PICTURES and len(rows) > _MOST_DRAWN:
            raise NoPicture(
                f"{len(rows)} tasks are too many for a picture: ask for a .txt, or for an earlier time --at"
            )
        _write(output, dot_source(then, rows, title, with_data=data), click.unstyle("\n".join(text)) + "\n")
    journal.check()


def _chosen_rows(then: Then, everything: bool, *, is_picture: bool) -> list[Row]:
    """A text scrolls, so it is folded only when it is long; a picture also when it is wide."""
    if everything or (len(then.tasks) <= SHOWN_AT_MOST and not is_picture):
        return whole_outline(then)
    return outline(then)


def _write(output: Path, dot: str, text: str) -> None:
    """Write the kind of file that its name asks for; where no picture can be drawn, a text instead."""
    if output.suffix not in PICTURES:
        write_output(output, dot if output.suffix == ".dot" else text)
        return
    try:
        write_output(output, drawn(dot, output.suffix[1:]))
    except NoPicture as error:
        instead = output.with_suffix(".txt")
        write_output(instead, text)
        raise NoPicture(f"{error.message}; wrote {instead} instead") from None


if __name__ == "__main__":
    tree(prog_name="python -m tca_tools.tasktree_viz")
