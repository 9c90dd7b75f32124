"""The failures of a run: their origins, the exception handlers called, their fates and costs. Pure.

A failure of a task is one *case*. It lasts until the task was handled again or killed, until the
failure was dealt with, or until the journal ended.
"""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import attrgetter

from tca_tools.explain.deciding import calls
from tca_tools.explain.story import awaited_in_words
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fates import (
    ENDED_TASKS,
    GOOD_FATES,
    Failed,
    Fate,
    all_failures,
    describe_asker,
    fate,
    retried_ancestor,
    run_continued_after,
)
from tca_tools.journal.records import HandlerWait, Handling, Task
from tca_tools.journal.whole_run import Run
from tca_tools.spans import Cover, Span
from tca_wire.messages.failures import DEADLOCK
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.vocabulary import Outcome


@dataclass(slots=True)
class Case:
    """One failure."""

    message_id: int
    of: str
    """The message, with its id."""
    text: str
    """The text of the failure."""
    time: float
    raised_by: str
    called: list[str]
    """The exception handlers called, in order, with their outcomes."""
    fate: Fate
    why: str
    """For a task, why it was killed, or which ancestor was retried. For a query, whether its asker
    got the report, and what the asker did then.
    """
    lost: float
    """Seconds of lost work: of the handler that failed, or of the task that was ended."""
    recovery: float
    """Seconds from the failure until its fate was decided or the task was handled again."""

    @property
    def cost(self) -> float:
        """The cost in time."""
        return self.lost + self.recovery

    @property
    def span(self) -> Span:
        """The span of the cost."""
        return self.time - self.lost, self.time + self.recovery


@dataclass(slots=True)
class FailureKind:
    """All failures of one name raised on one message."""

    failure: str
    message: str
    cases: list[Case] = field(default_factory=list)

    @property
    def cost(self) -> float:
        """The cost in seconds; overlapping times count once."""
        return Cover(case.span for case in self.cases).total

    @property
    def fates(self) -> dict[Fate, int]:
        """The number of cases by fate."""
        fates = [case.fate for case in self.cases]
        return {fate: fates.count(fate) for fate in Fate if fate in fates}

    @property
    def is_good(self) -> bool:
        """Whether the run continued after all of them."""
        return all(case.fate in GOOD_FATES for case in self.cases)


def failures(run: Run) -> list[FailureKind]:
    """Return the failures by name and message.

    The kinds are sorted by the number of failures that stopped something. Kinds with the same
    number are sorted by failures that were not reported to an asker, then by cost. A failure that
    was not reported caused no other failure, so it counts less.
    """
    kinds: dict[tuple[str, str], FailureKind] = {}
    for one in all_failures(run):
        key = one.failure.name, one.message.name
        kinds.setdefault(key, FailureKind(*key)).cases.append(_case(run, one))
    for key, case in _refused_waits(run):
        kinds.setdefault(key, FailureKind(*key)).cases.append(case)
    return sorted(kinds.values(), key=_rank)


def _rank(kind: FailureKind) -> tuple[int, int, float]:
    bad = [case.fate for case in kind.cases if case.fate not in GOOD_FATES]
    return bad.count(Fate.NOT_REPORTED) - len(bad), -len(bad), -kind.cost


def _case(run: Run, one: Failed) -> Case:
    message, time = one.message, one.time
    decided, why = fate(run, message, time), describe_asker(run, message, time)
    recovery, called = 0.0, list[str]()
    if isinstance(message, Task):
        recovery = _recovery_end(run, message, one) - time
        called = [call.text for call in calls(RunAt(run), message, time, one.until)]
        if (above := retried_ancestor(run, message, time)) is not None:
            why = f"{above} was handled again: {above.state}"
        if decided in ENDED_TASKS:
            why = message.why_killed or ""
    return Case(
        message.id,
        str(message),
        one.failure.words,
        time,
        _raised_by(one),
        called,
        decided,
        why,
        _lost_seconds(one, decided),
        recovery,
    )


def _refused_waits(run: Run) -> Iterator[tuple[tuple[str, str], Case]]:
    """Yield a case, with its kind, for each wait that was refused as a deadlock.

    If the handler failed because of the refusal, that failure is a case already: none is yielded.
    """
    if not run.deadlocks:
        return
    waits = [wait for handling in run.handlings for wait in handling.waits]
    waits += [wait for module in run.modules.values() for wait in module.waits]
    for wait in waits:
        cycle = run.deadlock(wait)
        if not cycle or wait.end is None or (decided := _fate_of_refused(run, wait)) is None:
            continue
        number, of, name = 0, str(wait.by), run.name(wait.awaited)
        if isinstance(wait.by, Handling):
            number, name = wait.by.message_id, wait.by.name
            of = run.describe(number)
        fields = cycle.words, wait.end, "by central", list[str](), decided
        why = f"it would have waited {awaited_in_words(run, wait)}"
        yield (cycle.name, name), Case(number, of, *fields, why, 0.0, 0.0)


def _fate_of_refused(run: Run, wait: HandlerWait) -> Fate | None:
    """Return the fate of a refused wait; None if its handler failed with the same deadlock."""
    if not isinstance(wait.by, Handling):
        return Fate.REPORTED
    handling, failed = wait.by, run.messages.get(wait.by.message_id)
    if handling.outcome is not Outcome.FAILED or handling.end is None:
        return Fate.ASKER_CONTINUED
    if failed is not None and failed.value_at("failure", handling.end).name == DEADLOCK:
        return None
    return Fate.ASKER_CONTINUED if run_continued_after(run, handling) else Fate.ASKER_FAILED


def _lost_seconds(one: Failed, decided: Fate) -> float:
    """Return the seconds of lost work.

    They count from the start of the handler that failed. If a failure was raised from outside the
    handler and ended or restarted the task, they count from the last start of the task.
    """
    if one.handling:
        return one.time - one.handling.start
    if decided not in (*ENDED_TASKS, Fate.RETRIED):
        return 0.0
    handlings = reversed(one.message.handlings)
    starts = (handling.start for handling in handlings if handling.start <= one.time)
    return one.time - next(starts, one.time)


def _raised_by(one: Failed) -> str:
    if one.handling:
        return f"by its handler in {place(one.handling.module, one.handling.resource)}"
    whom = by_whom(one.by).strip()
    if not whom:
        return "by central"
    for handling in one.message.handlings[-1:]:
        whom += f", beside its handler in {place(handling.module, handling.resource)}"
    return whom


def _recovery_end(run: Run, task: Task, one: Failed) -> float:
    """Return when a failed task was handled again, else when its exception handlers had ended."""
    if one.is_handled_again:
        again = bisect_right(task.handlings, one.time, key=attrgetter("start"))
        return task.handlings[again].start if again < len(task.handlings) else one.until
    ends = [one.time]
    for number in task.caught_by:
        handler = run.tasks.get(number)
        if handler is not None and one.time <= handler.received < one.until:
            ends.append(handler.reached.get(Moment.END_ACHIEVING, run.time))
    return max(ends)
