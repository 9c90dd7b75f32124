"""The contents of a report: all questions of the package ``analysis`` asked of a run, with bounds
on what is shown. Pure.
"""

from collections import Counter
from typing import NamedTuple

from tca_tools.analysis.advice import advice
from tca_tools.analysis.advice_words import Advice
from tca_tools.analysis.backwards import Causes
from tca_tools.analysis.concurrency import overlaps
from tca_tools.analysis.critical_path import (
    CriticalPath,
    Share,
    critical_path,
    last_task,
    longest_task,
    shares,
)
from tca_tools.analysis.failures import FailureKind, failures
from tca_tools.analysis.long_waits import WaitsOfKind, long_waits
from tca_tools.analysis.resources import Use, uses
from tca_tools.analysis.step_words import why_then
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.analysis.summary import Summary, summary
from tca_tools.explain.story import Sentence, story
from tca_tools.journal.coordinators import Gain, gains
from tca_tools.journal.whole_run import Run
from tca_wire.text.early_work import WhyNotEarly

_WORTH_SAYING = 0.005
"""Advice must bear on this share of the run."""
_WORTH_A_LINE = 0.001
"""Of a path."""
_STEPS = 60
_STORIES, _STORIES_EACH = 16, 2
_SENTENCES = 40
KINDS, CASES = 20, 8
"""Kinds of failures that are shown, and failures of each."""
_WAITS = 8


class ShownPath(NamedTuple):
    """A critical path: its shares but for the smallest, and its longest steps in their order."""

    path: CriticalPath
    shares: list[Share]
    steps: list[tuple[PathStep, str, str]]
    """Each with what it was of, and why it did not begin sooner."""
    left_out: int
    left_out_seconds: float


class Contents(NamedTuple):
    """All that a report says, but for the pictures."""

    summary: Summary
    kinds: list[FailureKind]
    stories: dict[int, list[Sentence]]
    """Of some failing messages: their whole stories, cut."""
    waits: list[WaitsOfKind]
    uses: list[Use]
    path: ShownPath | None
    longest: ShownPath | None
    """The critical path of the task that took longest, where that of the last one tells little of
    the run. Advice says which of the two it is about.
    """
    advice: list[Advice]
    previews: list[tuple[str, int, Gain, Counter[WhyNotEarly]]]
    """Of each machine that looked ahead how often it ran, what that gained, and why activities did
    not start early.
    """


def contents(run: Run) -> Contents:
    """Ask everything."""
    handling = summary(run)
    kinds, use = failures(run), uses(run, handling.start, handling.end)
    causes = Causes(run)
    last, longest = last_task(run), longest_task(run)
    path = critical_path(run, causes, last) if last else None
    other = None
    if path and longest and longest is not last and path.seconds < handling.seconds / 2:
        other = critical_path(run, causes, longest)
    least, beside = handling.seconds * _WORTH_SAYING, overlaps(run, causes)
    told = advice(run, causes, path, beside, use, kinds, least, other)
    shown, shown_too = (_shown(run, one) if one else None for one in (path, other))
    found = handling, kinds, _stories(run, kinds), long_waits(run, _WAITS), use
    return Contents(*found, shown, shown_too, told, gains(run))


def _stories(run: Run, kinds: list[FailureKind]) -> dict[int, list[Sentence]]:
    """The stories of the first failing message of each kind, then of others."""
    cases = [kind.cases[0] for kind in kinds]
    for kind in kinds[:KINDS]:
        cases += kind.cases[1:_STORIES_EACH]
    numbers = dict.fromkeys(case.message_id for case in cases)
    chosen = [number for number in numbers if number in run.messages]
    return {number: story(run, number)[:_SENTENCES] for number in chosen[:_STORIES]}


def _shown(run: Run, path: CriticalPath) -> ShownPath:
    longest = sorted(path.steps, key=lambda step: step.seconds, reverse=True)[:_STEPS]
    kept = sorted(longest, key=lambda step: step.start)
    steps = []
    for one in kept:
        before = "before " if one.doing is Doing.OUTSIDE else ""
        steps.append((one, before + run.describe(one.message_id), why_then(run, one)))
    told = [share for share in shares(run, path) if share.share >= _WORTH_A_LINE]
    left_out = path.seconds - sum(step.seconds for step in kept)
    return ShownPath(path, told, steps, len(path.steps) - len(kept), max(left_out, 0.0))
