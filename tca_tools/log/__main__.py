"""``tca log``: show a journal as text, list the stored runs, remove old ones."""

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
@click.option("--classic", is_flag=True, help="In the format of TCA's own message log.")
@click.option("--follow", is_flag=True, help="Show new facts, too, until interrupted.")
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
    """Show a journal, one line a fact."""
    if classic and (as_json or kinds or task is not None):
        raise click.UsageError(
            "--classic shows messages, not facts: leave out --json, --kind and --task"
        )
    journal = open_log(log_path)
    if follow:
        journal.print_remarks()
    entries: Iterable[Entry] = journal.follow() if follow else journal
    about = _About(task) if task is not None else None

    def is_wanted(fact: Fact) -> bool:
        is_match = about is None or about.matches(fact)  # called with every fact
        return is_match and (not kinds or kind_of(fact) in kinds)

    if classic:
        lines = classic_lines(entries)
    else:
        lines = (_json_lines if as_json else _text_lines)(entries, is_wanted)
    while chunk := list(islice(lines, 1 if follow else _LINES_AT_ONCE)):
        click.echo("\n".join(chunk))
    journal.check()
    if about is not None:
        about.check()


@log.command()
@_folder_argument
def runs(folder: Path | None) -> None:
    """List the runs in a folder, oldest first, by the names that LOG accepts.

    Without FOLDER, central's folder of journals is listed. If a folder has several runs, every
    command accepts FOLDER#NUMBER for one of them, and FOLDER for the last.
    """
    folders = [open_log(folder).path] if folder else [*run_folders()][::-1]
    if not folders:
        newest_journal()
    found = [run for one in folders if one.is_dir() for run in runs_in(one)]
    width = max((columns_of(name) for name, _, _ in found), default=0)
    for name, opened, log in found:
        start = f"{padded(printable(name), width)}  started {_date(opened.began)}"
        live = ", continues" * log.is_being_written
        click.echo(f"{start}, {counted(len(log.segments()), 'segment')}{live}")


@log.command()
@_folder_argument
@click.option(
    "--keep",
    metavar="AGE",
    type=AGE,
    help="Remove runs that ended more than AGE ago: 30d, 12h, 90min, 2w.",
)
@click.option(
    "--keep-bytes",
    metavar="SIZE",
    type=SIZE,
    help="Remove the oldest, down to this size: 500M, 10G.",
)
@click.option("--dry-run", is_flag=True, help="Only list the runs that would be removed.")
def prune(
    folder: Path | None, keep: float | None, keep_bytes: float | None, *, dry_run: bool
) -> None:
    """Remove old runs, with the inputs and images that recovery needs.

    FOLDER is a journal folder, with one or several runs, or a folder of such folders; without it,
    central's folder of journals. Two runs stay: the one that a central writes, and the newest
    unfinished run, which may continue. From these two, old tasks and messages that have ended are
    removed. The rest stays readable.
    """
    if keep is None and keep_bytes is None:
        raise click.UsageError(
            "give the age or size to keep: --keep 30d, --keep-bytes 10G, or both"
        )
    folder = folder or default_journals()
    stored = stored_runs(folder)
    found = superfluous(stored, keep, keep_bytes)
    width = max((columns_of(printable(run.name)) for run in found), default=0)
    for run in found:
        line = f"{padded(printable(run.name), width)}  ended {_date(run.ended)}, {size(run.size)}"
        click.echo(f"{line}: stays, {run.why_retained}" if run.why_retained else line)
        if not run.why_retained and not dry_run:
            remove(run, with_folder=run.folder != folder)
    removed = [run for run in found if not run.why_retained]
    left = sum(run.size for run in stored) - sum(run.size for run in removed)
    verb = "would be removed" if dry_run else "removed"
    for run in [run for run in stored if run.why_retained]:
        ended = EndedTasks(run.files)
        until = ended.until(keep, None if keep_bytes is None else keep_bytes - (left - run.size))
        if (bytes_removed := ended.remove(until, dry_run=dry_run)) > 0:
            click.echo(
                f"{printable(run.name)}: {size(bytes_removed)} of tasks and messages"
                f" that had ended by {until:.0f} s {verb}"
            )
            left -= bytes_removed
    total = f"{counted(len(removed), 'run')} {verb} ({size(sum(run.size for run in removed))})"
    click.echo(f"{total}, {counted(len(stored) - len(removed), 'run')} left ({size(left)})")


def _date(time: float) -> str:
    return f"{datetime.fromtimestamp(time):%Y-%m-%d %H:%M:%S}"  # noqa: DTZ006


def _json_lines(entries: Iterable[Entry], is_wanted: Callable[[Fact], bool]) -> Iterator[str]:
    """Yield each wanted fact as a JSON object."""
    for entry in entries:
        for fact in filter(is_wanted, entry.facts):
            yield json_text(fact_row(entry, fact))


def _text_lines(entries: Iterable[Entry], is_wanted: Callable[[Fact], bool]) -> Iterator[str]:
    """Yield each wanted fact as an aligned line: time, kind, words, data.

    The first line of an entry also has the cause of the entry.
    """
    wording, width = Wording(), line_width()
    for entry in entries:
        cause = f"  ({wording.cause(entry.cause)})" if entry.cause else ""
        for fact in entry.facts:
            words = wording.words(fact)  # hidden facts, too: they declare names for later ones
            if is_wanted(fact):
                yield _text_line(entry.time, fact, words, cause, width)
                cause = ""


def _text_line(time: float, fact: Fact, words: str, cause: str, width: int | None) -> str:
    kind, data = kind_of(fact), data_text(getattr(fact, "body", b""))
    start, rest = f"{time:10.3f}  ", f"{kind:{_KIND_WIDTH}}  {printable(words)}"
    rest += f"  {data}" * bool(data) + printable(cause)
    rest = cut(rest.rstrip(), None if width is None else width - len(start))
    rest = click.style(rest, fg="red") if kind in BAD_NEWS else rest
    return click.style(start, dim=True) + rest


class _About:
    """Selects the facts about the message of a number, or about all messages of a name.

    Call ``matches`` with every fact in order, then ``check``.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        wanted = text.strip().strip("{}")
        self._numbers: set[int | None] = {int(wanted)} if wanted.isdecimal() else set()
        self._is_found = False
        self._names: set[str] = set()

    def matches(self, fact: Fact) -> bool:
        """Whether a fact is about a wanted message, or about a message that its handler sent."""
        if isinstance(fact, Received):
            self._names.add(fact.message)
            if fact.message == self._text:
                self._numbers.add(fact.id)
        elif isinstance(fact, Queued | Delivered) and fact.message_id in self._numbers:
            # later facts about a copy, or about another try, have only the number of this delivery
            self._numbers.add(fact.id)
        is_match = not self._numbers.isdisjoint(_subjects(fact))
        self._is_found |= is_match
        return is_match

    def check(self) -> None:
        """Raise NotInLog if no fact matched."""
        if not self._is_found:
            raise no_task(self._text, self._names)


def _subjects(fact: Fact) -> Iterator[int | None]:
    """Yield the messages that a fact is about, or whose handlers caused it."""
    for name in ("id", "task", "message_id", "parent", "origin"):
        yield getattr(fact, name, None)
    for constraint in getattr(fact, "constraints", []):
        yield from (constraint.before.task, constraint.after.task)
