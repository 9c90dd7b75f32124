"""``tca gantt``: what every module did when, on the terminal or as a picture."""

from pathlib import Path

import click

from tca_tools.gantt.bars import chart
from tca_tools.gantt.svg import svg_text
from tca_tools.gantt.text import ASCII, UNICODE, chart_lines
from tca_tools.history import History
from tca_tools.logs import open_log
from tca_tools.output import write_output
from tca_tools.terminal import can_show, cut, line_width, printable

_WIDTH_OF_FILE = 120


@click.command()
@click.argument("log_path", metavar="[LOG]", required=False, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help=".svg or .txt")
@click.option("--from", "start", metavar="SECONDS", type=float, help="Begin the chart there.")
@click.option("--to", "end", metavar="SECONDS", type=float, help="End the chart there.")
@click.option("--ascii", "as_ascii", is_flag=True, help="Draw bars with ASCII characters.")
def gantt(log_path: Path | None, output: Path | None, start: float | None, end: float | None, as_ascii: bool) -> None:
    """Show what every module did when.

    LOG is a journal directory or one of its segments; without it, the newest run is shown.
    """
    if output and output.suffix not in (".svg", ".txt"):
        raise click.BadParameter(f"{output}: its name must end in .svg or .txt", param_hint="'-o'")
    journal = open_log(log_path)
    history = History.until(journal, end)
    if (start or 0.0) >= (history.time if end is None else end) and start is not None:
        raise click.BadParameter(f"{start:g} is not before the end, {history.time:g}", param_hint="'--from'")
    drawing = chart(history, start, end)
    title = f"{printable(journal.name)}: {drawing.start:.2f} to {drawing.end:.2f} s"
    if output is None:
        blocks = ASCII if as_ascii or not can_show("█▉▒░╵") else UNICODE
        width = line_width() or _WIDTH_OF_FILE
        click.echo("\n".join([cut(title, width), *chart_lines(drawing, width, blocks)]))
    elif output.suffix == ".svg":
        write_output(output, svg_text(drawing, title))
    else:
        lines = chart_lines(drawing, _WIDTH_OF_FILE, ASCII if as_ascii else UNICODE)
        write_output(output, click.unstyle("\n".join([title, *lines])) + "\n")
    journal.check()


if __name__ == "__main__":
    gantt(prog_name="python -m tca_tools.gantt")
