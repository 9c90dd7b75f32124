"""The chain of a failure: its causes, the exception handlers called for it, and its fate. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, nextafter
from typing import NamedTuple

from tca_tools.explain.deciding import called_for, calls, decider, retry_in_words
from tca_tools.explain.graph import Ends
from tca_tools.explain.story import NOT_HANDLED
from tca_tools.explain.wait_words import age_of, in_the_end, named_waits_now, shown_waits, verb_of
from tca_tools.explain.waits import killed_at
from tca_tools.journal.at_time import RunAt, TaskAt
from tca_tools.journal.failure import Failure
from tca_tools.journal.fates import (
    ENDED_TASKS,
    UNDECIDED,
    Fate,
    fate,
    is_reported,
    retried_ancestor,
)
from tca_tools.journal.records import (
    DONE,
    OVER,
    Message,
    Task,
)
from tca_tools.journal.whole_run import Run
from tca_wire.messages.failures import TIMEOUT
from tca_wire.points import Moment, TaskId
from tca_wire.text.facts_in_words import by_whom, place
from tca_wire.text.measures import duration
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.vocabulary import Outcome
from tca_wire.waits import NAMED, WaitKind

_FAR = 500
"""The number of waits to follow when a deadline has passed."""
_MOST_LINKS = 30
"""The number of links in a chain, at most."""


@dataclass(frozen=True, slots=True)
class Link:
    """One event in the chain of a failure."""

    time: float
    depth: int
    """The number of causes between this event and the task of the chain."""
    text: str
    brief: str = ""
    """The text without the reason, if the text has a reason."""


def failure_chain(run: Run, number: TaskId, instant: float = inf) -> list[Link]:
    """Return the events that led to a task's failure or kill, oldest first, as known at *instant*.

    The chain is empty if the task had neither failed nor been killed.
    """
    task = run.tasks[number]
    found: list[tuple[float, _Path, Link]] = []
    waiting = [_FailureCause(task, (), instant, instant)]
    seen = {task.id}
    killed = killed_at(task)
    if not task.failures and killed <= instant:
        link = _with_why(killed, 0, f"{task} was killed", task.why_killed or "")
        found.append((killed, (_END, 0), link))
        path = (_CAUSES, 0)
        waiting = [_FailureCause(one, path, killed, instant) for one in _culprits(run, task)]
    while waiting and len(found) < _MOST_LINKS:
        cause = waiting.pop()
        if cause.message.id in seen and cause.path:
            continue
        seen.add(cause.message.id)
        for step, link in _steps_of(run, cause):
            if link.time <= cause.until:
                found.append((link.time, (*cause.path, *step), link))
        waiting += reversed(list(_causes(run, cause)))
    if not task.failures and seen == {task.id}:
        return []
    return [link for time, _, link in sorted(found, key=_order) if time <= instant]


_Path = tuple[int, ...]
"""The path of a link: its steps from the task of the chain. It orders events of the same time."""
_CAUSES, _ITSELF, _CALLS, _AGAIN, _END = range(5)
"""The steps of a message in order: causes, failure, exception handlers, retry, end."""


class _FailureCause(NamedTuple):
    """A message whose failure led to the failure of the task."""

    message: Message
    path: _Path
    until: float
    """The time until which its events may have been a cause."""
    known: float
    """The instant as of which the fate of the message is described."""


def _order(found: tuple[float, _Path, Link]) -> tuple[float, int, _Path]:
    """Return the sort key of a link: its time, then its path.

    At one time, failures come before the kills that follow from them. Kills come from top to
    bottom, but an exception handler's end comes before the end of the task it was called for.
    """
    time, path, _ = found
    *causes, step, _ = path
    above = sum(1 if one == _CAUSES else -_MOST_LINKS for one in causes[::2])
    return time, (_MOST_LINKS**2 + above) if step == _END else 0, path


def _steps_of(run: Run, cause: _FailureCause) -> Iterator[tuple[_Path, Link]]:
    message, path, until, known = cause
    depth = len(path) // 2
    for time, failure in [one for one in message.failures if one[0] <= until]:
        for since, is_indirect, text in _deadline_causes(run, message, time, failure):
            yield (_ITSELF, 0), Link(since, depth + is_indirect, text)
        yield (_ITSELF, 0), _with_why(time, depth, f"{message} failed", failure)
    if isinstance(message, Task):
        for call in calls(RunAt(run, known), message):
            text = f"exception handler {call.text}"
            yield (_CALLS, call.place), Link(call.time, depth, text)
        yield from (((_AGAIN, 0), link) for link in _retries(run, message, depth))
        if end := _end(run, message, depth, known):
            yield (_END, 0), end
            above = _end_above(run, message, depth, known)
            yield from (((_END, 0), link) for link in above)


def _newest_state_time(task: Task, instant: float) -> float:
    return task.stage(task.place_at(instant))[0]


def _retries(run: Run, task: Task, depth: int) -> Iterator[Link]:
    """Yield a link for each retry after a failure."""
    failed = min((time for time, _ in task.failures), default=inf)
    for one in task.retries:
        if one.time >= failed:
            yield Link(one.time, depth, f"{task} is {retry_in_words(run, task, one)}")


def _end(run: Run, task: Task, depth: int, instant: float) -> Link | None:
    """Return the link of the task's fate at *instant*; None if it had not failed."""
    at = RunAt(run, instant).tasks.get(task.id)
    if at is None or not (raised := [one for one in task.failures if one[0] <= instant]):
        return None
    became = fate(run, task, raised[-1][0], instant)
    time = _newest_state_time(task, instant)
    if at.why_killed is not None:
        time = task.written_at("killed", instant)
    without = ""
    if became is Fate.REPLACED and RunAt(run, instant).tasks[task.top].state in DONE:
        without = f"; {run.describe(task.top)} was achieved without it"
    if became is Fate.OPEN:
        return Link(time, depth, f"{task} is being recovered")
    if became is Fate.DEALT_WITH:
        return Link(time, depth, f"{task}: its failure was dealt with")
    if at.why_killed is not None:
        why = NOT_HANDLED if task.killed_for == task.id else at.why_killed
        return _with_why(time, depth, f"{task} was killed", why, without)
    if became in ENDED_TASKS:
        return Link(time, depth, f"{task}: its failure was not dealt with{without}")
    is_known = at.state in OVER or _has_tried_again(task, instant)
    return Link(time, depth, f"{task}: {at.state} after all") if is_known else None


def _with_why(time: float, depth: int, what: str, why: str, more: str = "") -> Link:
    return Link(time, depth, f"{what}: {why}{more}", what + more)


def _end_above(run: Run, task: Task, depth: int, instant: float) -> Iterator[Link]:
    """Yield the state at *instant* of an ancestor that was retried because *task* had failed."""
    failed = max((time for time, _ in task.failures if time <= instant), default=inf)
    above = retried_ancestor(run, task, failed, instant)
    if above is not None and (state := RunAt(run, instant).tasks[above.id].state) in OVER:
        text = f"{above}, handled again: {state}"
        yield Link(_newest_state_time(above, instant), depth, text)


def _has_tried_again(task: Task, instant: float) -> bool:
    """Whether the task's handler has returned once more after the last retry."""
    again = max((one.time for one in task.retries if one.time <= instant), default=0.0)
    since = [one for one in task.handlings if one.start >= again]
    return any(one.end is not None and one.end <= instant for one in since)


def _causes(run: Run, failed: _FailureCause) -> Iterator[_FailureCause]:
    """Yield the message that the failing handler waited for, then failed exception handlers."""
    message, path, latest, known = failed
    handlings = [one for one in message.handlings if one.outcome is Outcome.FAILED]
    handlings = [one for one in handlings if (one.end or 0.0) <= latest]
    for wait, end in [(wait, one.end) for one in handlings for wait in one.waits][-1:]:
        until = min(latest if one is None else one for one in (wait.end, end))
        awaited = run.messages.get(wait.awaited)
        if awaited is not None and _is_named(run, awaited, until, message):
            yield _FailureCause(awaited, (*path, _CAUSES, 0), until, until)
    if not isinstance(message, Task):
        return
    for order, number in enumerate(message.caught_by):
        if (handler := run.tasks.get(number)) is not None:
            until = min(latest, _decided(message, handler.received))
            if any(time <= until for time, _ in handler.failures):
                yield _FailureCause(handler, (*path, _CALLS, 2 * order + 1), until, known)


def _decided(task: Task, failed: float) -> float:
    """Return when the fate of a failed task was decided."""
    places = range(task.place_at(failed), len(task.stages))
    states = [time for time, state in map(task.stage, places) if state not in UNDECIDED]
    decided = [time for time in states if time > failed]
    return min([*decided[:1], killed_at(task), task.time_of(Moment.END_ACHIEVING)])


def _is_named(run: Run, cause: Message, until: float, failed: Message) -> bool:
    """Whether the text of `failed` names a failure of `cause` that was reported by *until*."""
    reported = [one for one in cause.failures if one[0] <= until]
    if not isinstance(cause, Task):
        reported = [one for one in reported if is_reported(run, cause, one[0])]
    names = {failure.name for _, failure in reported}
    return any(name in text for _, text in failed.failures for name in names)


def _culprits(run: Run, task: Task) -> list[Task]:
    """Return the other task because of whose failure *task* was killed; empty if there is none.

    The failure of the other task was not handled, or an exception handler called for it requested
    the kill.
    """
    handler = decider(run, task.killer)
    failed = run.tasks.get(task.killed_for, task)
    if handler is not None:
        failed = called_for(run, handler)
    return [failed] if failed is not task and failed.failures else []


# --- passed deadlines: waits, their holders, and suspensions --------------------------------------


def _deadline_causes(
    run: Run, message: Message, failed: float, failure: Failure
) -> Iterator[tuple[float, bool, str]]:
    """Yield the known causes of a passed deadline.

    Each has its start, whether it lies in another message, and its text.
    """
    deadlines = [one.set_at for one in run.plans.get(message.id, ()) if one.moment is not None]
    at = RunAt(run, nextafter(failed, 0.0))
    task = at.tasks.get(TaskId(message.id))
    if not deadlines or failure.name != TIMEOUT or task is None or task.is_watching:
        return
    for one in run.tasks[task.id].suspensions[-NAMED:]:
        if one.start >= deadlines[0] and one.end is not None and one.end < failed:
            how_long = duration(one.end - one.start)
            yield one.start, False, f"{task} was suspended{by_whom(one.by)}, for {how_long}"
    if age := age_of(waits := shown_waits(at, task)):
        end, causes = in_the_end(at, task, _FAR), several_in_words(named_waits_now(at, task, waits))
        how_long = f", for {duration(failed - age.since)}" + (f"; in the end {end}" if end else "")
        yield age.since, False, f"{task} {verb_of(task, verb='waited')} {causes}{how_long}"
    yield from _holders(at, task, failed)


def _holders(at: RunAt, task: TaskAt, failed: float) -> Iterator[tuple[float, bool, str]]:
    """Yield the handlers and lock holders that the task waited for in the end at its deadline."""
    ends = Ends.at(at).of(task.id, _FAR)
    for number in [
        end.number for end in ends if end.kind is WaitKind.RUNNING or end.number in at.run.claims
    ][:NAMED]:
        claim, message = at.run.claims.get(number), at.run.messages.get(number)
        if claim is not None and claim.granted is not None and at.is_granted(claim):
            since, what = claim.granted, f"{claim.sender} had the {claim}"
        elif message is None or message.message_class.asks_many:
            continue
        elif (handling := at.handling_of(message)) is not None:
            where = place(handling.module, handling.resource)
            since, what = handling.start, f"{message} was being handled by {where}"
        else:
            continue
        how_long = duration(failed - since)
        yield since, number != task.id, f"{what}, for {how_long} when time ran out"
