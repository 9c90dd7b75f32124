"""``tca report``: a report of a run as one HTML file."""

from pathlib import Path

import click

from tca_tools.errors import DamagedLog, extra
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import Log, open_log
from tca_tools.options import check_output, force_option, log_argument, output_option
from tca_tools.output import write_output
from tca_tools.report.contents import contents
from tca_tools.report.pictures import gantt, strips
from tca_tools.report.tree import tree


@click.command()
@log_argument
@output_option("The file, .html.", required=True)
@force_option
def report(log_path: Path | None, output: Path, *, force: bool) -> None:
    """Write a report of a run as one HTML file.

    It has the outcome, failures, critical path, advice, Gantt chart and task tree of the run.
    """
    check_output(output, (".html", ".htm"), force=force)
    with extra("report", "a report"):
        from tca_tools.report.page import page  # noqa: PLC0415 - needs an extra
    journal = open_log(log_path)
    history = folded(journal)
    found = contents(history)
    pictures = gantt(history, found), strips(history, found)
    text = page(journal.name, _damage(journal), found, tree(history), *pictures)
    write_output(output, text)
    click.echo(f"{output}: {len(text.encode()) / 1e6:.1f} MB")
    journal.check()


def _damage(journal: Log) -> str:
    """Return why a part of the journal could not be read; "" if all of it was."""
    try:
        journal.check()
    except DamagedLog as error:
        return error.message
    return ""


if __name__ == "__main__":
    report(prog_name="python -m tca_tools.report")
