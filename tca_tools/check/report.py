"""What a check has found, as text: what was read, which rule is broken where, and the story of the message."""

from collections.abc import Iterator

import click

from tca_tools.check.rules import Violation
from tca_tools.run.whole_run import Run
from tca_tools.terminal import cut
from tca_tools.why.story import story
from tca_wire.text.printable import printable

_LONGEST_STORY = 40
"""Sentences of one story that are shown."""


def violation_lines(violation: Violation, run: Run, width: int | None) -> Iterator[str]:
    """One violation, with the story of its message until then."""
    where = f"at {violation.time:.3f} s, entry {violation.event}"
    yield click.style(cut(printable(f"BROKEN {where}: {violation.rule}"), width), fg="red", bold=True)
    yield cut(printable(f"  {violation.what}"), width)
    if violation.source:
        yield click.style(cut(f"  the rule: {violation.source}", width), dim=True)
    yield from _story(violation, run, width)


def _story(violation: Violation, run: Run, width: int | None) -> Iterator[str]:
    until = run.times[min(violation.place, len(run.times) - 1)] if run.times else 0.0
    told = [sentence for sentence in story(run, violation.message) if sentence.time <= until]
    if not told:
        return
    of = cut(printable(run.describe(violation.message)), None if width is None else width - 28)
    yield f"  the story of {of} until then:"
    if len(told) > _LONGEST_STORY:
        yield f"     ... {len(told) - _LONGEST_STORY} sentences ..."
    for sentence in told[-_LONGEST_STORY:]:
        yield cut(f"  {sentence.time:10.3f}  {printable(sentence.by(until, until))}", width)
