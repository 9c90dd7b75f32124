"""``tca log``: a journal as text, one line a fact; which runs there are, and the removal of old
ones.
"""

from collections.abc import Callable, Iterable, Iterator
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import get_args

import click

from tca_tools.journal.journals import newest_journal, open_log, run_folders, runs_in
from tca_tools.journal.selection import no_task
from tca_tools.log.classic import classic_lines
from tca_tools.log.fact_rows import BAD_NEWS, fact_row
from tca_tools.log.prune import remove, stored_runs, superfluous
from tca_tools.log.shorten import EndedTasks
from tca_tools.options import AGE, SIZE, log_argument
from tca_tools.terminal import columns_of, cut, line_width, padded
from tca_wire.endpoint import default_journals
from tca_wire.journal.facts import Delivered, Entry, Fact, Queued, Received, kind_of
from tca_wire.text.bodies import data_text, json_text
from tca_wire.text.facts_in_words import Wording
from tca_wire.text.measures import counted, size
from tca_wire.text.printable import printable

KINDS: tuple[str, ...] = tuple(map(kind_of, get_args(Fact)))
_KIND_WIDTH = max(map(len, KINDS))
_LINES_AT_ONCE = 500


_folder_argument = click.argument(
    "folder", metavar="[FOLDER]", required=False, type=click.Path(path_type=Path)
)


@click.group()
def log() -> None:
    """Read the journal of a run."""


@log.command()
@log_argument
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line.")
@click.option("--classic", is_flag=True, help="In the words of TCA's own message log.")
@click.option("--follow", is_flag=True, help="Show what comes, too, until interrupted.")
@click.option(
    "--task",
    metavar="TASK",
    help="Only facts about this task or message (its number, or all of a name), and what it sent.",
)
@click.option(
    "--kind",
    "kinds",
    metavar="KIND",
    multiple=True,
    type=click.Choice(KINDS),
    help="Only facts of this kind (repeatable).",
)
def show(
    log_path: Path | None,
    as_json: bool,
    classic: bool,
    follow: bool,
    task: str | None,
    kinds: tuple[str, ...],
) -> None:
    """Show a journal, one line a fact.

    LOG is a journal directory or one of its segments; without it, the newest run is shown.
    """
    if classic and (as_json or kinds or task is not None):
        raise click.UsageError(
            "--classic shows whole messages, not facts: leave out --json, --kind and --task"
        )
    journal = open_log(log_path)
    if follow:
        journal.print_remarks()
    entries: Iterable[Entry] = journal.follow() if follow else journal
    about = _About(task) if task is not None else None
    if classic:
        lines = classic_lines(entries)
    else:
        render = _json_lines if as_json else _text_lines
        lines = render(
            entries,
            lambda fact: (
                (about is None or about.is_told_by(fact)) and (not kinds or kind_of(fact) in kinds)
            ),
        )
    while chunk := list(islice(lines, 1 if follow else _LINES_AT_ONCE)):
        click.echo("\n".join(chunk))
    journal.check()
    if about is not None:
        about.check()


@log.command()
@_folder_argument
def runs(folder: Path | None) -> None:
    """List the runs that lie in a folder, oldest first, as they are named as LOG.

    Without FOLDER those in central's folder of journals. Where several runs lie in one folder, all
    commands take one of them as FOLDER#NUMBER, and without a number the last.
    """
    folders = [open_log(folder).path] if folder else [*run_folders()][::-1]
    if not folders:
        newest_journal()
    found = [run for one in folders if one.is_dir() for run in runs_in(one)]
    width = max((columns_of(name) for name, _, _ in found), default=0)
    for name, opened, log in found:
        segments, live = counted(len(log.segments()), "segment"), ", goes on" * log.is_being_written
        click.echo(
            f"{padded(printable(name), width)}  began {_date(opened.began)}, {segments}{live}"
        )


@log.command()
@_folder_argument
@click.option(
    "--keep",
    metavar="AGE",
    type=AGE,
    help="Remove runs that ended longer ago: 30d, 12h, 90min, 2w.",
)
@click.option(
    "--keep-bytes",
    metavar="SIZE",
    type=SIZE,
    help="Remove the oldest, down to this size: 500M, 10G.",
)
@click.option("--dry-run", is_flag=True, help="Only say what would be removed.")
def prune(
    folder: Path | None, keep: float | None, keep_bytes: float | None, *, dry_run: bool
) -> None:
    """Remove old runs, with the inputs and images that recovery needs.

    FOLDER is a journal folder, in which one or several runs lie, or a folder of such folders;
    without it, central's folder of journals. A run that a central writes stays, and the newest that
    ended without a goodbye: it may go on. Of these the tasks and messages go that ended longer ago,
    or the oldest of them. The rest stays readable.
    """
    if keep is None and keep_bytes is None:
        raise click.UsageError("say what to keep: --keep 30d, --keep-bytes 10G, or both")
    folder = folder or default_journals()
    stored = stored_runs(folder)
    found = superfluous(stored, keep, keep_bytes)
    width = max((columns_of(printable(run.name)) for run in found), default=0)
    for run in found:
        told = f"{padded(printable(run.name), width)}  ended {_date(run.ended)}, {size(run.size)}"
        click.echo(f"{told}: stays, {run.kept}" if run.kept else told)
        if not run.kept and not dry_run:
            remove(run, with_folder=run.folder != folder)
    gone = [run for run in found if not run.kept]
    left = sum(run.size for run in stored) - sum(run.size for run in gone)
    verb = "would be removed" if dry_run else "removed"
    for run in [run for run in stored if run.kept]:
        ended = EndedTasks(run.files)
        until = ended.until(keep, None if keep_bytes is None else keep_bytes - (left - run.size))
        if (bytes_gone := ended.remove(until, dry_run=dry_run)) > 0:
            click.echo(
                f"{printable(run.name)}: {size(bytes_gone)} of what had ended by {until:.0f} s {verb}"
            )
            left -= bytes_gone
    removed = f"{counted(len(gone), 'run')} {verb} ({size(sum(run.size for run in gone))})"
    click.echo(f"{removed}, {counted(len(stored) - len(gone), 'run')} left ({size(left)})")


def _date(time: float) -> str:
    return f"{datetime.fromtimestamp(time):%Y-%m-%d %H:%M:%S}"  # noqa: DTZ006


def _json_lines(entries: Iterable[Entry], is_wanted: Callable[[Fact], bool]) -> Iterator[str]:
    """Each wanted fact as a JSON object."""
    for entry in entries:
        for fact in filter(is_wanted, entry.facts):
            yield json_text(fact_row(entry, fact))


def _text_lines(entries: Iterable[Entry], is_wanted: Callable[[Fact], bool]) -> Iterator[str]:
    """Each wanted fact as an aligned line: time, kind, words, data; the first of an entry says what
    that came from.
    """
    wording, width = Wording(), line_width()
    for entry in entries:
        cause = f"  ({wording.cause(entry.cause)})" if entry.cause else ""
        for fact in entry.facts:
            words = wording.words(fact)  # also of what is not shown: it may name what is
            if is_wanted(fact):
                yield _text_line(entry.time, fact, words, cause, width)
                cause = ""


def _text_line(time: float, fact: Fact, words: str, cause: str, width: int | None) -> str:
    kind, data = kind_of(fact), data_text(getattr(fact, "body", b""))
    start = f"{time:10.3f}  "
    rest = (
        f"{kind:{_KIND_WIDTH}}  {printable(words)}"
        + (f"  {data}" if data else "")
        + printable(cause)
    )
    rest = cut(rest.rstrip(), None if width is None else width - len(start))
    return click.style(start, dim=True) + (
        click.style(rest, fg="red") if kind in BAD_NEWS else rest
    )


class _About:
    """The task or message of a number, or all of a name, as their facts come. Give it all facts,
    then ``check`` it.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        wanted = text.strip().strip("{}")
        self._numbers: set[int | None] = {int(wanted)} if wanted.isdecimal() else set()
        self._is_found = False
        self._names: set[str] = set()

    def is_told_by(self, fact: Fact) -> bool:
        """Whether a fact is about one of them, or about what its handler sent."""
        if isinstance(fact, Received):
            self._names.add(fact.message)
            if fact.message == self._text:
                self._numbers.add(fact.id)
        elif isinstance(fact, Queued | Delivered) and fact.message_id in self._numbers:
            self._numbers.add(
                fact.id
            )  # what comes of a copy, or of another try, is told by its own number
        is_told = not self._numbers.isdisjoint(_told_of(fact))
        self._is_found |= is_told
        return is_told

    def check(self) -> None:
        """Raise NotInLog if there was none."""
        if not self._is_found:
            raise no_task(self._text, self._names)


def _told_of(fact: Fact) -> Iterator[int | None]:
    """The messages that a fact is about, or whose handlers did what it tells."""
    yield from (
        getattr(fact, name, None) for name in ("id", "task", "message_id", "parent", "origin")
    )
    for constraint in getattr(fact, "constraints", []):
        yield from (constraint.before.task, constraint.after.task)
