"""``tca check``: holds a journal against the rules of task-level control, and against the user's own properties."""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import click

from tca_properties import BadProperty, Property, property_from
from tca_properties.field_values import FieldValue
from tca_properties.predicates import OfMessages
from tca_tools.check.checker import Checker
from tca_tools.check.judge import Judge
from tca_tools.check.records import MessageRecord
from tca_tools.check.report import head_lines, verdict_lines, violation_lines
from tca_tools.check.rules import Violation
from tca_tools.check.world import JournalWorld
from tca_tools.run.fold import History
from tca_tools.run.journals import Log, open_log
from tca_tools.run.losses import Losses
from tca_wire.journal.facts import Entry
from tca_wire.user_file import CannotRun, names_of


@click.command()
@click.argument("paths", metavar="[LOG] [PROPERTIES.py]...", nargs=-1, type=click.Path(path_type=Path))
@click.option("--property", "texts", metavar="TEXT", multiple=True,
              help="A further property, such as 'at most 1 planned ahead of take steps' (repeatable).")  # fmt: skip
@click.option("--all", "everything", is_flag=True, help="Show all that is broken, not only what was broken first.")
@click.option("--rerun", is_flag=True, help="Handle the inputs of the run again, and compare with its journal.")
@click.pass_context
def check(
    context: click.Context, paths: tuple[Path, ...], texts: tuple[str, ...], *, everything: bool, rerun: bool
) -> None:
    """Check that a run kept the rules of task-level control.

    LOG is a journal directory or one of its segments; without it, the newest run is checked. Properties of your own are
    texts, or come from Python files. Exit code 0: all is well; 1: something is broken, or the journal is damaged (one
    that is not closed is not: central still runs, or was killed).

    With --rerun the inputs that central has kept go through this version's core once more: exit code 1 if that comes to
    anything else than what the journal has.

    \b
    never P, always P, eventually P, P before P, at most N P [in all], never stuck
      where P is STATE of MESSAGE [with FIELD=VALUE, ...], or handled by MODULE
      [with ...]; data=VALUE compares the whole data of a message
      STATE: sent, begun, handled, queued, planned, planned ahead, being achieved,
             achieved, killed, failed, recovering, suspended, fired, retried
    """  # noqa: D301 - click wants the character itself
    journal, files = _sorted(paths)
    if rerun:
        from tca_tools.check.rerun import rerun as handle_again  # noqa: PLC0415 - only this needs central's core

        lines, is_same = handle_again(journal)
        click.echo("\n".join(lines))
        context.exit(not is_same)
    wanted = [*_from_texts(texts), *(one for file in files for one in _properties_in(file))]
    run = _Run(wanted, with_history=bool(files))
    for entry in journal:
        run.take(entry, journal.losses)
    run.close(journal.losses, is_cut_short=journal.is_cut_short)
    misnamed = _misnamed(run)
    if misnamed and not run.checker.gaps:  # else they may be known where it can't be read
        stated, wrong = next(iter(misnamed.items()))
        raise click.UsageError(f"property '{stated}': {wrong}")
    found = sorted(run.violations, key=lambda violation: violation.place)
    for line in (
        *head_lines(run.checker, journal),
        *verdict_lines(found, run.unbroken, misnamed, is_whole=not run.checker.gaps),
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
        raise click.UsageError(f"{logs[1]}: one journal is checked at a time, and files of properties end in .py")
    for file in files:
        if not file.is_file():
            raise click.UsageError(f"{file}: there is no such file of properties")
    return open_log(logs[0] if logs else None), files


def _from_texts(texts: tuple[str, ...]) -> list[Property]:
    try:
        return [property_from(text) for text in texts]
    except BadProperty as error:
        raise click.UsageError(str(error)) from None


class _Run:
    """A journal on its way past the rules and properties."""

    def __init__(self, wanted: list[Property], *, with_history: bool) -> None:
        self.violations: list[Violation] = []
        self.checker = Checker(self.violations.append, self._follow if wanted else lambda _: None)
        if with_history:
            self.checker.history = History()
        self.messages: dict[str, None] = {}
        self.modules: dict[str, None] = {}
        self.judges = [Judge(one) for one in wanted]
        self.unbroken = list(self.judges)
        self._touched: dict[MessageRecord, None] = {}
        self._lost = self._unknown = 0

    def take(self, entry: Entry, losses: Losses) -> None:
        """The next entry, and what was passed over until then, with it or before it."""
        self._pass_over(losses)
        if losses.facts > self._unknown:
            self._unknown = losses.facts
            self.checker.leave_out(entry)
        else:
            self.checker.take(entry)

    def _pass_over(self, losses: Losses) -> None:
        if losses.places > self._lost:
            self.checker.skip(losses.places - self._lost)
            self._lost = losses.places

    def _follow(self, world: JournalWorld) -> None:
        """An event is over: ask the properties about what changed, with it or (what is so for one event) before it."""
        changed = self._touched | world.touched
        self._touched = world.touched.copy()
        for item in world.touched:
            if item.is_new:
                self.messages[item.message] = None
        for module in world.joined if world.joined.keys() - self.modules.keys() else ():
            self.modules[module] = None
        for judge in list(self.unbroken):
            try:
                wrong = judge.after(world, changed)
            except Exception as error:  # a mistake in it, not in the robot
                words = f"property '{judge.stated}' can't be asked: {type(error).__name__}: {error}"
                raise click.UsageError(words) from error
            self._judge(judge, wrong, world, world.events)

    def _judge(self, judge: Judge, wrong: str, world: JournalWorld, place: int) -> None:
        if wrong:
            self.unbroken.remove(judge)
            words = str(judge.stated)
            self.violations.append(Violation(words, "", place, world.event, world.now, judge.culprit, wrong))

    def close(self, losses: Losses, *, is_cut_short: bool) -> None:
        """The journal is read, or nothing more of it can be (*is_cut_short*)."""
        self._pass_over(losses)
        if is_cut_short:
            self.checker.skip(1)
        self.checker.close()
        world = self.checker.world
        for judge in list(self.unbroken):
            self._judge(judge, judge.at_end(world), world, max(world.events - 1, 0))


def _misnamed(run: _Run) -> dict[Property, str]:
    """The properties of what the journal does not know, or does not allow: they would hold whatever happens."""
    world = run.checker.world
    messages = run.messages.keys() | world.classes.keys()
    found = {}
    for judge in run.judges:
        for one in judge.stated.predicates:
            if isinstance(one, OfMessages) and one.is_typed:
                misfit = "" if judge.matches.has_subject(one) else _misfit(one, world)
                unknown = _unknown("message", one.message, messages) or _unknown("module", one.module, run.modules)
                if wrong := unknown or misfit:
                    found[judge.stated] = wrong
    return found


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    if not name or name in known:
        return ""
    nearest = get_close_matches(name, known, n=1)
    advice = f": did you mean '{nearest[0]}'?" if nearest else ""
    return f"the journal has no {kind} '{name}'{advice}"


def _misfit(predicate: OfMessages, world: JournalWorld) -> str:
    """Of a message that never came, its declaration must allow that it might have."""
    name = predicate.message
    formats = [world.formats.get(name, "")] if name else [*world.formats.values()]
    values = [one for one in predicate.data if isinstance(one, FieldValue)] if formats else []
    wrong = next(filter(None, (one.misfit(formats) for one in values)), "")
    return f"of '{name}', {wrong}" if wrong and name else wrong


def _properties_in(path: Path) -> list[Property]:
    """The properties at the top level of a Python file: alone, in lists, in scenarios, or as texts in PROPERTIES."""
    try:
        names = names_of(path)
        found = [one for value in names.values() for one in _found_in(value)]
        texts = names.get("PROPERTIES")
        if isinstance(texts, list | tuple):
            found += [property_from(one) for one in texts if isinstance(one, str)]
    except CannotRun as error:
        raise click.UsageError(str(error)) from None
    except BadProperty as error:
        raise click.UsageError(f"{path}: {error}") from None
    if not found:
        raise click.UsageError(f"{path} has no property: put some at its top level, or texts into a list PROPERTIES")
    return found


def _found_in(value: Any) -> list[Property]:
    """The properties that a value is, or has."""
    if isinstance(value, Property):
        return [value]
    if isinstance(value, type):
        return []
    inside = getattr(value, "properties", value)
    return [one for one in inside if isinstance(one, Property)] if isinstance(inside, list | tuple) else []


if __name__ == "__main__":
    check(prog_name="python -m tca_tools.check")
