"""The result of a check as text: the journal, the broken rules, the stories of their messages."""

from collections.abc import Iterator

import click

from tca_tools.check.checked_run import CheckedRun
from tca_tools.check.rules import RULES, Violation
from tca_tools.explain.story import story
from tca_tools.journal.fold import History
from tca_tools.journal.journals import Log, open_log
from tca_tools.journal.whole_run import Run
from tca_tools.properties import Property
from tca_tools.terminal import cut, line_width
from tca_wire.text.printable import printable

_MOST_GAPS = 5
_LONGEST_STORY = 40
"""The most sentences of one story that are shown."""
_MOST_SHOWN = 100
"""The most violations that ``--all`` shows; one breach may cause thousands of others."""


def head_lines(run: CheckedRun, journal: Log) -> Iterator[str]:
    """Yield the extent of the journal, and its unreadable parts."""
    span = f"{run.began:.2f} s to {run.world.now:.2f} s"
    numbers = f" (numbers {run.first} to {run.last})" if run.events else ""
    extent = f"{run.facts:,} facts in {run.events:,} entries{numbers}, {span}"
    yield f"{printable(journal.name)}: {extent}"
    notes = [printable(gap) for gap in run.gaps[:_MOST_GAPS]]
    if len(run.gaps) > _MOST_GAPS:
        notes.append(f"and {len(run.gaps) - _MOST_GAPS} more gaps")
    if not run.is_closed:
        why = "central was stopped by force, or this is a copy"
        if journal.is_being_written:
            why = "central still runs"
        notes.append(f"it is not closed: {why}")
    yield from (click.style(f"  {note}", fg="yellow") for note in notes)


def verdict_lines(run: CheckedRun, misnamed: dict[Property, str]) -> Iterator[str]:
    """Yield the verdicts on the rules and on each unbroken property.

    A journal with gaps gets no "good", only that no breach was found.
    """
    if run.rules_kept < len(RULES):
        yield f"{run.rules_kept} of {len(RULES)} rules are kept"
    else:
        yield _good(f"{len(RULES)} rules", is_whole=run.is_whole)
    for judge in run.unbroken:
        why_vacuous = misnamed.get(judge.prop, judge.why_vacuous)
        note = share = ""
        if why_vacuous:
            note = click.style(f" (which says nothing: {printable(why_vacuous)})", fg="yellow")
        elif judge.counted:
            share = f" ({judge.counted})"
        yield _good(printable(str(judge.prop)) + share, is_whole=run.is_whole) + note


def _good(what: str, *, is_whole: bool) -> str:
    if is_whole:
        return click.style(f"good: {what}", fg="green")
    return f"no breach in the readable part: {what}"


def violation_lines(
    violations: list[Violation], journal: Log, *, everything: bool
) -> Iterator[str]:
    """Yield the violations with their stories.

    Args:
        violations: The violations, sorted by place.
        journal: The journal, which is read again for the stories.
        everything: Whether to show all violations. Else only the first broken rule, which may have
            caused others, and the broken properties are shown.
    """
    if not violations:
        return
    run, width = History.until(open_log(journal.path)), line_width()
    first_rule = [violation for violation in violations if violation.source][:1]
    firsts = [*first_rule, *(violation for violation in violations if not violation.source)]
    chosen = violations if everything else firsts
    shown = sorted(chosen, key=lambda violation: violation.place)[:_MOST_SHOWN]
    for violation in shown:
        yield ""
        yield from _violation(violation, run, width)
    if more := len(violations) - len(shown):
        yield f"\nand {more} more" + ("" if everything else ": --all shows them")


def _violation(violation: Violation, run: Run, width: int | None) -> Iterator[str]:
    where = f"at {violation.time:.3f} s, entry {violation.event}"
    yield click.style(
        cut(printable(f"BROKEN {where}: {violation.rule}"), width), fg="red", bold=True
    )
    yield cut(printable(f"  {violation.what}"), width)
    if violation.source:
        yield click.style(cut(f"  the rule: {violation.source}", width), dim=True)
    until = run.times[min(violation.place, len(run.times) - 1)] if run.times else 0.0
    sentences = [one for one in story(run, violation.message) if one.time <= until]
    if sentences:
        of = cut(printable(run.describe(violation.message)), None if width is None else width - 28)
        yield f"  the story of {of} until then:"
    if len(sentences) > _LONGEST_STORY:
        yield f"     ... {len(sentences) - _LONGEST_STORY} sentences ..."
    for sentence in sentences[-_LONGEST_STORY:]:
        yield cut(f"  {sentence.time:10.3f}  {printable(sentence.text_at(until, until))}", width)
