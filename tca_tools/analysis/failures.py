"""The failures of a run: who raised them, which exception handlers were called, what became of them, what they cost.

A failure of a task is one *case*, from the moment it was raised until the task was handled again, was dealt with, was
killed, or the journal ended. Pure.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from operator import attrgetter

from tca_tools.analysis.summary import values
from tca_tools.run.fates import ENDED_TASKS, GOOD_FATES, Fate, begun_again_with, failing, fate, told_to, went_on
from tca_tools.run.records import HandlerWait, Handling, Message, Task
from tca_tools.run.whole_run import Run
from tca_tools.spans import Cover
from tca_tools.why.story import awaited, exhausted
from tca_wire.messages.failures import BAD_DATA, DEADLOCK, HANDLER_ERROR, NOT_BY_CHOICE
from tca_wire.points import Moment
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.vocabulary import Outcome

_RECEIVED, _START = attrgetter("received"), attrgetter("start")
_OF_CENTRAL = NOT_BY_CHOICE - {HANDLER_ERROR, BAD_DATA}
"""Failures that central itself raises, where no handler has failed with them."""


@dataclass(slots=True)
class Case:
    """One failure."""

    message_id: int
    of: str
    """The message, with its id."""
    failure: str
    """Its name."""
    text: str
    time: float
    raised_by: str
    chain: list[str]
    """The exception handlers that were called, in order, each with where it ran."""
    fate: Fate
    why: str
    """Of a task that was killed: why, or what came of the one above it that was retried; of a query: who was told."""
    lost: float
    """Seconds of work that came to nothing: how long the handler that failed had run, or the task that was ended."""
    recovery: float
    """Seconds from the failure until its fate was decided or the task was handled again."""

    @property
    def cost(self) -> float:
        """What it cost in time."""
        return self.lost + self.recovery


@dataclass(slots=True)
class Kind:
    """All failures of one name raised on one message."""

    failure: str
    message: str
    cases: list[Case] = field(default_factory=list)

    @property
    def cost(self) -> float:
        """What they cost in time; what two of them cost at the same time counts once."""
        return Cover((case.time - case.lost, case.time + case.recovery) for case in self.cases).total

    @property
    def fates(self) -> dict[Fate, int]:
        """How many met which fate."""
        fates = [case.fate for case in self.cases]
        return {fate: fates.count(fate) for fate in Fate if fate in fates}

    @property
    def is_good(self) -> bool:
        """Whether all of them were overcome."""
        return not self.bad

    @property
    def bad(self) -> int:
        """How many were not overcome."""
        return sum(case.fate not in GOOD_FATES for case in self.cases)

    @property
    def untold(self) -> int:
        """Of how many nobody was told."""
        return sum(case.fate is Fate.UNTOLD for case in self.cases)


def failures(run: Run) -> list[Kind]:
    """The failures by name and message: first those of which most were not overcome, then by what they cost. With what
    nobody was told of nothing else failed: it comes after those.
    """
    kinds: dict[tuple[str, str], Kind] = {}
    for message in run.messages.values():
        if not message.failure and not message.changes:
            continue
        for case in _cases(run, message):
            key = (case.failure, message.name)
            kinds.setdefault(key, Kind(*key)).cases.append(case)
    for name, case in _refused(run):
        kinds.setdefault((DEADLOCK, name), Kind(DEADLOCK, name)).cases.append(case)
    return sorted(kinds.values(), key=lambda kind: (kind.untold - kind.bad, -kind.bad, -kind.cost))


def _cases(run: Run, message: Message) -> Iterator[Case]:
    """The failures of one message, in order."""
    had = values(message, "failure")
    in_vain = {handling.end: handling for handling in message.handlings if handling.outcome is Outcome.FAILED}
    called = [run.tasks[one] for one in message.caught_by if one in run.tasks] if isinstance(message, Task) else []
    for number, (time, failure) in enumerate(had):
        if not failure:
            continue
        name = failure.name
        failed = in_vain.get(time)
        by = "central" if name in _OF_CENTRAL and not failed else _raised_by(run, message, failed, time)
        why = told_to(run, message, time)
        case = Case(
            message.id, str(message), name, failure.words, time, by, [], fate(run, message, time), why, 0.0, 0.0
        )
        case.lost = _lost(message, case, failed)
        if isinstance(message, Task):
            _follow(run, message, case, called, had[number + 1] if number + 1 < len(had) else None)
        yield case


def _refused(run: Run) -> Iterator[tuple[str, Case]]:
    """Those that were refused to wait, since that would have been a deadlock, and did not fail with that."""
    if not run.deadlocks:
        return
    waits = [wait for handling in run.handlings for wait in handling.waits]
    waits += [wait for module in run.modules.values() for wait in module.waits]
    for wait in waits:
        circle = run.deadlock(wait)
        if not circle or wait.end is None or (became := _became(run, wait)) is None:
            continue
        handling = wait.by if isinstance(wait.by, Handling) else None
        message, name = (handling.message_id, handling.name) if handling else (0, run.name(wait.awaited))
        of, text = run.describe(message) if handling else str(wait.by), circle.removeprefix(f"{DEADLOCK}: ")
        why = f"it was to wait {awaited(run, wait)}"
        yield name, Case(message, of, DEADLOCK, text, wait.end, "central", [], became, why, 0.0, 0.0)


def _became(run: Run, wait: HandlerWait) -> Fate | None:
    """What became of a wait that was refused; None if its handler failed with that, which is told as any failure."""
    if not isinstance(wait.by, Handling):
        return Fate.TOLD
    handling, failed = wait.by, failing(run, wait.by)
    if handling.outcome is not Outcome.FAILED or handling.end is None:
        return Fate.COPED
    if isinstance(failed, Message) and failed.was("failure", handling.end).startswith(DEADLOCK):
        return None
    return Fate.COPED if went_on(run, failed, handling.end) else Fate.ANSWERED


def _lost(message: Message, case: Case, failed: Handling | None) -> float:
    """How long was worked in vain: by the handler that failed; or, where the failure was raised beside it (a deadline)
    and ended the task or began it anew, for the task since it was last begun.
    """
    if failed:
        return case.time - failed.start
    if case.fate not in (*ENDED_TASKS, Fate.RETRIED):
        return 0.0
    begun = (run.start for run in reversed(message.handlings) if run.start <= case.time)
    return case.time - next(begun, case.time)


def _raised_by(run: Run, message: Message, failed: Handling | None, time: float) -> str:
    if failed:
        return f"its handler in {place(failed.module, failed.resource)}"
    where = message.handlings[-1] if message.handlings else None
    by = next((one.by for one in run.raised.get(message.id, ()) if one.time == time), "")
    return (by_whom(by).removeprefix(" by ") or "another module or central") + (
        f", beside its handler in {place(where.module, where.resource)}" if where else ""
    )


def _follow(run: Run, task: Task, case: Case, called: list[Task], after: tuple[float, str] | None) -> None:
    """What was done about a failure of a task: until *after*, when it had another failure, or ("") was retried."""
    first = bisect_left(called, case.time, key=_RECEIVED)
    mine = called[first : bisect_left(called, after[0], key=_RECEIVED) if after else None]
    case.chain = [_described(run, one) for one in mine]
    if after and not after[1]:
        again = bisect_right(task.handlings, case.time, key=_START)
        case.recovery = (task.handlings[again].start if again < len(task.handlings) else after[0]) - case.time
        return
    ends = [one.reached.get(Moment.END_ACHIEVING, run.time) for one in mine]
    case.recovery = max(ends, default=case.time) - case.time
    if (above := begun_again_with(run, task, case.time)) is not None:
        case.why = f"{above} was handled again: {above.state}"
    if case.fate in ENDED_TASKS:
        case.why = task.why_killed or ""
        case.chain += [exhausted(one) for one in run.exhausted.get(task.id, ()) if one.time >= case.time]


def _described(run: Run, handler: Task) -> str:
    handling = handler.handlings[-1] if handler.handlings else None
    words = str(handler) + (
        f" in {place(handling.module, handling.resource)}" if handling else ", which nobody handled"
    )
    if handler.failure:
        words += f", which failed itself ({handler.failure.name})"
    if handler.id in run.reissued:
        words += ", which passed the failure on"
    return words
