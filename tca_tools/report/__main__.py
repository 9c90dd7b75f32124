"""``tca report``: a run as one HTML file to mail to a colleague."""

from pathlib import Path

import click

from tca_tools.errors import DamagedLog, extra
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import Log, open_log
from tca_tools.options import check_output, force_option, log_argument, output_option
from tca_tools.output import write_output


@click.command()
@log_argument
@output_option("The file, .html.", required=True)
@force_option
def report(log_path: Path | None, output: Path, *, force: bool) -> None:
    """Write a run down as one HTML file: outcome, failures, where time went, what would help, chart and tree.

    LOG is a journal directory or one of its segments; without it, the newest run is reported.
    """
    check_output(output, (".html", ".htm"), force=force)
    with extra("report", "a report"):
        import jinja2  # noqa: F401, PLC0415 - an extra
    journal = open_log(log_path)
    text = _page(journal)
    write_output(output, text)
    click.echo(f"{output}: {len(text.encode()) / 1e6:.1f} MB")
    journal.check()


def _page(journal: Log) -> str:
    from tca_tools.report.contents import contents  # noqa: PLC0415 - these import the extra
    from tca_tools.report.page import page  # noqa: PLC0415
    from tca_tools.report.pictures import gantt, strips  # noqa: PLC0415
    from tca_tools.report.tree import tree  # noqa: PLC0415

    history = folded(journal)
    try:
        journal.check()
        damage = ""
    except DamagedLog as error:
        damage = error.message
    found = contents(history)
    is_plain = journal.name == "journal"  # it is known by the directory that it is in
    name = f"{journal.path.resolve().parent.name}/journal" if is_plain else journal.name
    pictures = gantt(history, found), strips(history, found)
    return page(name, damage, found, tree(history), *pictures)


if __name__ == "__main__":
    report(prog_name="python -m tca_tools.report")
