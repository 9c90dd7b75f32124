"""``tca replay``: a run message by message; on a terminal with keys, elsewhere as lines of text."""

import sys
from pathlib import Path

import click

from tca_tools.errors import extra
from tca_tools.journal.journals import open_log
from tca_tools.options import MOMENT, log_argument
from tca_tools.replay.growth import growth_lines
from tca_tools.replay.recording import Recording
from tca_tools.terminal import line_width


@click.command()
@log_argument
@click.option(
    "--speed",
    metavar="FACTOR",
    type=click.FloatRange(min=0, min_open=True),
    default=1.0,
    show_default=True,
    help="How fast time passes while it plays.",
)
@click.option(
    "--at",
    metavar="SECONDS",
    type=MOMENT,
    help="Begin there (default: at the end; as text, at the start).",
)
@click.option("--text", is_flag=True, help="As lines of text, as where there is no terminal.")
def replay(log_path: Path | None, speed: float, at: float | None, text: bool) -> None:
    """Re-create the task tree message by message.

    LOG is a journal directory or one of its segments; without it, the newest run. Keys: right and
    left for the next message and the one before, space to play (at the end: from the start), + and
    - for the speed, ] and [ for failures, / to search, g to go to a time, up and down to choose a
    task, page up and down to read its story, ? for all keys. Without a terminal the tree's growth
    is printed, a line for each step.
    """
    journal = open_log(log_path)
    as_text = text or not (sys.stdout.isatty() and sys.stdin.isatty())
    if not as_text:
        click.echo(f"reading {journal.path} ...", err=True)
    recording = Recording(journal)
    if as_text:
        start = at if at is not None else float("-inf")
        for line in growth_lines(recording, start, line_width()):
            click.echo(line)
    else:
        with extra("replay", "tca replay", "use --text"):
            from tca_tools.replay.app import Replay  # noqa: PLC0415 - textual is an extra
        Replay(recording, journal.name, speed=speed, at=at).run()
    journal.check()


if __name__ == "__main__":
    replay(prog_name="python -m tca_tools.replay")
