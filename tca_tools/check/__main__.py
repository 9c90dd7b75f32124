"""``tca check``: holds a journal against the rules of task-level control, and against the user's
own properties.
"""

from pathlib import Path
from typing import Any

import click

from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.report import head_lines, verdict_lines, violation_lines
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log, open_log
from tca_tools.properties import BadProperty, Property, property_from
from tca_tools.user_file import names_of


@click.command()
@click.argument(
    "paths", metavar="[LOG] [PROPERTIES.py]...", nargs=-1, type=click.Path(path_type=Path)
)
@click.option(
    "--property",
    "texts",
    metavar="TEXT",
    multiple=True,
    help="A further property, such as 'at most 1 planned ahead of take steps' (repeatable).",
)
@click.option(
    "--all",
    "everything",
    is_flag=True,
    help="Show all that is broken, not only what was broken first.",
)
@click.option(
    "--rerun",
    is_flag=True,
    help="Handle the inputs of the run again, and compare with its journal.",
)
@click.pass_context
def check(
    context: click.Context,
    paths: tuple[Path, ...],
    texts: tuple[str, ...],
    *,
    everything: bool,
    rerun: bool,
) -> None:
    """Check that a run kept the rules of task-level control.

    LOG is a journal directory or one of its segments; without it, the newest run is checked. Properties of your own are
    texts, or come from Python files, which may also count cases of the whole run. Exit code 0: all is well; 1:
    something is broken, or the journal is damaged (one that is not closed is not: central still runs, or was killed).

    With --rerun the inputs that central has kept go through this version's core once more: exit code 1 if that comes to
    anything else than what the journal has.

    \b
    never P, always P, eventually P, P before P, at most N P [in all], never stuck
      where P is STATE of MESSAGE [with FIELD=VALUE, ...], or handled by MODULE
      [with ...]; data=VALUE compares the whole data of a message
      STATE: sent, begun, handled, queued, planned, planned ahead, being achieved,
             achieved, resolved, killed, failed, recovering, suspended, fired, retried
    """  # noqa: D301 - click wants the character itself
    journal, files = _sorted(paths)
    if rerun:
        from tca_tools.check.rerun import rerun as handle_again  # noqa: PLC0415 - only this needs central's core

        lines, is_same = handle_again(journal)
        click.echo("\n".join(lines))
        context.exit(not is_same)
    try:
        wanted = [
            *map(property_from, texts),
            *(one for file in files for one in _properties_in(file)),
        ]
        run = CheckedRun.of(journal, wanted, History() if files else None)
    except BadProperty as error:
        raise click.UsageError(str(error)) from error
    misnamed = run.misnamed()
    if misnamed and run.is_whole:  # else they may be known where it can't be read
        stated, wrong = next(iter(misnamed.items()))
        raise click.UsageError(f"property '{stated}': {wrong}")
    found = sorted(run.violations, key=lambda violation: violation.place)
    for line in (
        *head_lines(run, journal),
        *verdict_lines(run, misnamed),
        *violation_lines(found, journal, everything=everything),
    ):
        click.echo(line)
    journal.check(of_missing=False)  # of those it has a line of its own
    context.exit(bool(run.violations))


def _sorted(paths: tuple[Path, ...]) -> tuple[Log, list[Path]]:
    """The journal, and the files of properties."""
    files = [path for path in paths if path.suffix == ".py"]
    logs = [path for path in paths if path.suffix != ".py"]
    if len(logs) > 1:
        raise click.UsageError(
            f"{logs[1]}: one journal is checked at a time, and files of properties end in .py"
        )
    for file in files:
        if not file.is_file():
            raise click.UsageError(f"{file}: there is no such file of properties")
    return open_log(logs[0] if logs else None), files


def _properties_in(path: Path) -> list[Property]:
    """The properties at the top level of a Python file: alone, in lists, in scenarios, or as texts
    in PROPERTIES.
    """
    names = names_of(path)
    try:
        found = [one for value in names.values() for one in _found_in(value)]
        texts = names.get("PROPERTIES")
        if isinstance(texts, list | tuple):
            found += [property_from(one) for one in texts if isinstance(one, str)]
    except BadProperty as error:
        raise click.UsageError(f"{path}: {error}") from None
    found = list(dict.fromkeys(found))  # one may stand alone and in a list
    if not found:
        raise click.UsageError(
            f"{path} has no property: put some at its top level, or texts into a list PROPERTIES"
        )
    return found


def _found_in(value: Any) -> list[Property]:
    """The properties that a value is, or has."""
    if isinstance(value, Property):
        return [value]
    if isinstance(value, type):
        return []
    inside = getattr(value, "properties", value)
    return (
        [one for one in inside if isinstance(one, Property)]
        if isinstance(inside, list | tuple)
        else []
    )


if __name__ == "__main__":
    check(prog_name="python -m tca_tools.check")
