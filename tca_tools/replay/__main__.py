"""``tca replay``: a run message by message, with keys on a terminal, else as lines of text."""

import sys
from pathlib import Path

import click

from tca_tools.errors import extra
from tca_tools.journal.journals import open_log
from tca_tools.options import TIME, log_argument
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
    help="The speed of playing; 2 is twice real time.",
)
@click.option(
    "--at",
    metavar="SECONDS",
    type=TIME,
    help="Start at this time (default: the end; as text, the start).",
)
@click.option("--text", is_flag=True, help="Print lines of text, even on a terminal.")
def replay(log_path: Path | None, speed: float, at: float | None, text: bool) -> None:
    """Re-create the task tree message by message.

    \b
    right, left    the next or previous message
    space          play or pause (at the end: play from the start)
    + -            play faster or slower
    ] [            the next or previous failure
    / g            search, or go to a time
    up, down       select a task
    page up, down  scroll the task's story
    ?              all keys

    Without a terminal, the growth of the tree is printed, one line for each step.
    """  # noqa: D301 - click interprets the character itself
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
