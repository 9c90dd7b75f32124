"""The contents of a report: the results of the package ``analysis``, limited to a readable size."""

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
from tca_tools.analysis.step_words import why_not_sooner
from tca_tools.analysis.steps import Doing, PathStep
from tca_tools.analysis.summary import Summary, summary
from tca_tools.explain.story import Sentence, story
from tca_tools.journal.coordinators import Gain, gains
from tca_tools.journal.whole_run import Run
from tca_wire.text.early_work import WhyNotEarly

_LEAST_SHARE_OF_ADVICE = 0.005
"""The least share of the run that advice must be about."""
_LEAST_SHARE_OF_PATH = 0.001
"""The least share of a path that is shown."""
_STEPS = 60
"""The most steps of a path that are shown, the longest ones."""
_STORIES, _STORIES_EACH = 16, 2
"""The most stories, and those for each kind of failure."""
_SENTENCES = 40
"""The most sentences of a story."""
KINDS, CASES = 20, 8
"""The most kinds of failures that are shown, and the most failures of each."""
_WAITS = 8
"""The most waits of a kind."""


class ShownPath(NamedTuple):
    """A critical path: its shares without the smallest, and its longest steps in order."""

    path: CriticalPath
    shares: list[Share]
    steps: list[tuple[PathStep, str, str]]
    """Each step with its message, and why it did not begin sooner."""
    left_out: int
    left_out_seconds: float


class Contents(NamedTuple):
    """The contents of a report, without the pictures and the task tree."""

    summary: Summary
    kinds: list[FailureKind]
    stories: dict[int, list[Sentence]]
    """By failed message: the first sentences of its story."""
    waits: list[WaitsOfKind]
    uses: list[Use]
    path: ShownPath | None
    longest: ShownPath | None
    """The critical path of the longest task, if *path* covers less than half of the run.

    Advice says which of the two it is about.
    """
    advice: list[Advice]
    previews: list[tuple[str, int, Gain, Counter[WhyNotEarly]]]
    """For each machine with a preview: its number of runs, the gain, and the causes of late starts.
    """


def contents(run: Run) -> Contents:
    """Analyse a run."""
    overview = summary(run)
    kinds, use = failures(run), uses(run, overview.start, overview.end)
    causes = Causes(run)
    last, longest = last_task(run), longest_task(run)
    path = critical_path(run, causes, last) if last else None
    other = None
    if path and longest and longest is not last and path.seconds < overview.seconds / 2:
        other = critical_path(run, causes, longest)
    least, parallel = overview.seconds * _LEAST_SHARE_OF_ADVICE, overlaps(run, causes)
    advices = advice(run, causes, path, parallel, use, kinds, least, other)
    shown, shown_other = (_shown(run, one) if one else None for one in (path, other))
    found = overview, kinds, _stories(run, kinds), long_waits(run, _WAITS), use
    return Contents(*found, shown, shown_other, advices, gains(run))


def _stories(run: Run, kinds: list[FailureKind]) -> dict[int, list[Sentence]]:
    """Return the stories of the first failed message of each kind, then of others."""
    cases = [kind.cases[0] for kind in kinds]
    for kind in kinds[:KINDS]:
        cases += kind.cases[1:_STORIES_EACH]
    numbers = dict.fromkeys(case.message_id for case in cases)
    chosen = [number for number in numbers if number in run.messages]
    return {number: story(run, number)[:_SENTENCES] for number in chosen[:_STORIES]}


def _shown(run: Run, path: CriticalPath) -> ShownPath:
    longest = sorted(path.steps, key=lambda step: step.seconds, reverse=True)[:_STEPS]
    in_order = sorted(longest, key=lambda step: step.start)
    steps = []
    for step in in_order:
        before = "before " if step.doing is Doing.OUTSIDE else ""
        steps.append((step, before + run.describe(step.message_id), why_not_sooner(run, step)))
    main = [share for share in shares(run, path) if share.share >= _LEAST_SHARE_OF_PATH]
    left_out = path.seconds - sum(step.seconds for step in in_order)
    return ShownPath(path, main, steps, len(path.steps) - len(in_order), max(left_out, 0.0))
