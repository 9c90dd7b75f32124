"""``tca schedule``: what the agents of a coordinator did when, for one or more runs."""

from pathlib import Path

import click

from tca_tools.drawing.pictures import write_svg
from tca_tools.errors import NotInLog
from tca_tools.gantt.cells import blocks_for, width_for
from tca_tools.gantt.chart import Chart
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.options import check_output, force_option, output_option
from tca_tools.output import show_text
from tca_tools.schedule.build import schedules
from tca_tools.schedule.svg import svg_text
from tca_tools.schedule.text import schedule_lines

_KINDS = (".svg", ".png", ".pdf", ".txt")


@click.command()
@click.argument(
    "log_paths", metavar="LOG...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@output_option(".svg, .png, .pdf or .txt")
@force_option
def schedule(log_paths: tuple[Path, ...], output: Path | None, *, force: bool) -> None:
    """Show what the agents of coordinators with a preview did when.

    LOG is a journal directory or one of its segments. Several runs share one time axis.
    """
    check_output(output, _KINDS, force=force)
    journals = [open_log(path) for path in log_paths]
    charts: list[Chart] = []
    for journal in journals:
        found = schedules(folded(journal), journal.name)
        if not found:
            raise NotInLog(f"{journal.path}: no coordinator has started a task in this run")
        charts += found
    if output is None or output.suffix == ".txt":
        lines = schedule_lines(charts, width_for(output), blocks_for(output))
        show_text("\n".join(lines), output)
    else:
        write_svg(output, svg_text(charts))
    for journal in journals:
        journal.check()


if __name__ == "__main__":
    schedule(prog_name="python -m tca_tools.schedule")
