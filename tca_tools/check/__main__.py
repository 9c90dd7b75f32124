"""``tca check``: check a journal against the rules of task-level control and own properties."""

from pathlib import Path
from typing import Any

import click

from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.report import head_lines, verdict_lines, violation_lines
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log, open_log
from tca_tools.options import log_help
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
    help="A property to check, such as 'at most 1 planned ahead of take steps' (repeatable).",
)
@click.option(
    "--all",
    "everything",
    is_flag=True,
    help="Show all broken rules, not only the first one.",
)
@click.option(
    "--rerun",
    is_flag=True,
    help="Process the inputs of the run again, and compare the result with the journal.",
)
@click.pass_context
@log_help
def check(
    context: click.Context,
    paths: tuple[Path, ...],
    texts: tuple[str, ...],
    *,
    everything: bool,
    rerun: bool,
) -> None:
    """Check that a run kept the rules of task-level control.

    Your own properties are texts (--property), or come from Python files, which may also count
    cases of the whole run. Exit code 0: all is well; 1: a rule or property is broken, or the
    journal is damaged. A journal that is not closed is not damaged: its central still runs, or was
    killed.

    With --rerun, this version's core processes the inputs that central has stored. Exit code 1: the
    result differs from the journal.

    \b
    Properties:
      never P, always P, eventually P, P before P, at most N P [in all], never stuck
    \b
    P is one of:
      STATE of MESSAGE [with FIELD=VALUE, ...]
      handled by MODULE [with FIELD=VALUE, ...]
    data=VALUE compares the whole data of a message.
    \b
    STATE is one of:
      sent, begun, handled, queued, planned, planned ahead, being achieved,
      achieved, resolved, killed, failed, recovering, suspended, fired, retried
    """  # noqa: D301 - click wants the character itself
    journal, files = _sorted(paths)
    if rerun:
        # Imported here, since only this needs central's core
        from tca_tools.check.rerun import rerun as process_again  # noqa: PLC0415

        lines, is_same = process_again(journal)
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
    if misnamed and run.is_whole:  # in a gap of the journal the names may occur
        prop, wrong = next(iter(misnamed.items()))
        raise click.UsageError(f"property '{prop}': {wrong}")
    found = sorted(run.violations, key=lambda violation: violation.place)
    for line in (
        *head_lines(run, journal),
        *verdict_lines(run, misnamed),
        *violation_lines(found, journal, everything=everything),
    ):
        click.echo(line)
    journal.check(of_missing=False)  # the head lines show missing segments
    context.exit(bool(run.violations))


def _sorted(paths: tuple[Path, ...]) -> tuple[Log, list[Path]]:
    """Return the journal and the files of properties."""
    files = [path for path in paths if path.suffix == ".py"]
    logs = [path for path in paths if path.suffix != ".py"]
    if len(logs) > 1:
        raise click.UsageError(
            f"{logs[1]}: only one journal can be checked at a time; files of properties end in .py"
        )
    for file in files:
        if not file.is_file():
            raise click.UsageError(f"{file}: no such file of properties")
    return open_log(logs[0] if logs else None), files


def _properties_in(path: Path) -> list[Property]:
    """Return the properties in a Python file: global variables, in global lists or scenarios, or as
    texts in PROPERTIES.
    """
    names = names_of(path)
    try:
        found = [one for value in names.values() for one in _found_in(value)]
        texts = names.get("PROPERTIES")
        if isinstance(texts, list | tuple):
            found += [property_from(one) for one in texts if isinstance(one, str)]
    except BadProperty as error:
        raise click.UsageError(f"{path}: {error}") from None
    found = list(dict.fromkeys(found))  # a property may be a variable and in a list
    if not found:
        raise click.UsageError(
            f"{path} has no property: assign some to global variables, or list texts in PROPERTIES"
        )
    return found


def _found_in(value: Any) -> list[Property]:
    """Return the properties that a value is or contains."""
    if isinstance(value, Property):
        return [value]
    if isinstance(value, type):
        return []
    inside = getattr(value, "properties", value)
    if not isinstance(inside, list | tuple):
        return []
    return [one for one in inside if isinstance(one, Property)]


if __name__ == "__main__":
    check(prog_name="python -m tca_tools.check")
