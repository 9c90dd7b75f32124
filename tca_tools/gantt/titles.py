"""The titles of bars: the message, its place, its time and its duration."""

from tca_tools.explain.wait_words import named_waits
from tca_tools.explain.waits import Wait, of_handler_wait
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.failure import Failure
from tca_tools.journal.fates import describe_asker
from tca_tools.journal.records import (
    Claim,
    HandlerWait,
    Handling,
    LifeChange,
    Queueing,
    Raised,
    Task,
)
from tca_tools.journal.whole_run import Run
from tca_tools.terminal import cut
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom, place, raised_by
from tca_wire.text.measures import duration, from_to, run_time
from tca_wire.text.printable import first_line
from tca_wire.text.waits_in_words import several_in_words
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitKind

_LONGEST_DATA = 80
"""The most columns of data in a title."""


def of_handling(run: Run, handling: Handling) -> str:
    """Return ``take steps {2} handled by gait planner from 0.700 s to 1.400 s, 0.700 s``."""
    where = place(handling.module, handling.resource)
    task = run.tasks.get(handling.message_id)
    preview = RunAt(run).tasks[task.id].preview if task is not None else ""
    ahead = f" ({preview})" if preview else ""
    span = _span(run, handling.start, handling.end)
    title = f"{run.describe(handling.message_id)}{ahead} handled by {where} {span}"
    if handling.outcome and handling.outcome is not Outcome.DONE:
        title += f": {handling.outcome}"
    if handling.outcome is Outcome.FAILED:
        title += _failure_text(run, handling)
        message = run.messages.get(handling.message_id)
        notice = message and describe_asker(run, message, handling.end or run.time)
        title += f", {notice}" if notice else ""
    return title


def _failure_text(run: Run, handling: Handling) -> str:
    """Return the failure of a handler: ``: terrain collision: leg 4 met rock``.

    The copies of a broadcast may fail in different ways, so a failure of one is not shown.
    """
    message = run.messages.get(handling.message_id)
    if message is None or message.message_class.fans_out or handling.end is None:
        return ""
    failure = message.value_at("failure", handling.end)
    return (
        failure and f": {_words_or_data(failure, message.value_at('failure_data', handling.end))}"
    )


def _words_or_data(failure: Failure, data: bytes) -> str:
    """Return a failure in a line; its data if it has no text: ``blocked {"at": 3}``."""
    if failure.words:
        return first_line(failure)
    return f"{failure} {cut(data_text(data), _LONGEST_DATA)}".rstrip()


def of_failure(run: Run, task: Task, failure: Raised) -> str:
    """Return ``move {7} failed at 2.000 s: timeout: end handling not reached within 1 s``."""
    notice = describe_asker(run, task, failure.time)
    text = _words_or_data(failure.failure, task.value_at("failure_data", failure.time))
    title = f"{task} failed at {run_time(failure.time)}: {text}{raised_by(failure.by)}"
    return title + (f", {notice}" if notice else "")


def of_change(task: Task, change: LifeChange) -> str:
    """Return ``grasp {7} at 2.000 s: update by planner, now update requested: {"width": 0.1}``."""
    data = cut(data_text(change.body), _LONGEST_DATA)
    return f"{task} at {run_time(change.time)}: {change}" + (f": {data}" if data else "")


def of_wait(run: Run, who: str, wait: HandlerWait) -> str:
    """Return ``take steps {2} waits for the reply to elevation map {5}, ...``.

    The waiter is a handler's message, or a module.
    """
    words = several_in_words(named_waits(RunAt(run, wait.start), [of_handler_wait(run, wait)]))
    return f"{who} waits {words}, {_span(run, wait.start, wait.end)}"


def of_queueing(run: Run, queueing: Queueing) -> str:
    """Return ``take steps {2} queued for gait planner from ...``."""
    where = place(queueing.module, queueing.resource) or "a handler"
    span = _span(run, queueing.start, queueing.end)
    return f"{run.describe(queueing.message_id)} queued for {where} {span}"


def of_suspension(run: Run, task: Task, start: float, end: float | None) -> str:
    """Return ``take steps {2} suspended by user from ...``."""
    begun = [span for span in task.suspensions if span.start <= start]
    current = [span for span in begun if span.end is None or start < span.end]
    by = by_whom(current[0].by) if current else ""
    return f"{task} suspended{by} {_span(run, start, end)}"


def of_hold(run: Run, task: Task, start: float, end: float | None, waits: list[Wait]) -> str:
    """Return ``take steps {3} held until take steps {2} is achieved, from ...``."""
    why = several_in_words(named_waits(RunAt(run, start), waits))
    return f"{task} held{why and f' {why},'} {_span(run, start, end)}"


def hold_reason(run: Run, who: str, start: float, waits: list[Wait]) -> str:
    """Return ``take steps {3}: until take steps {2} is achieved``."""
    return who + (several_in_words(named_waits(RunAt(run, start), waits)) or "held")


def of_claim(run: Run, claim: Claim, start: float) -> str:
    """Return ``controller locked by scanner from ...``."""
    where = place(claim.module, claim.resource)
    kind = "reserved" if claim.is_reserved else "locked"
    why = f": {claim.ended}" if claim.ended else ""
    holder = f" while handling {run.describe(claim.by.message_id)}" if claim.by else ""
    return f"{where} {kind} by {claim.sender}{holder} {_span(run, start, claim.end)}{why}"


def awaited_name(run: Run, wait: HandlerWait) -> str:
    """Return the name of the awaited message, or the kind of the awaited claim or event."""
    if not wait.awaited:
        return "handlers to come" if wait.kind is WaitKind.PRESENCE else "changes of tasks"
    if (claim := run.claims.get(wait.awaited)) is None:
        return run.name(wait.awaited)
    return "reservation" if claim.is_reserved else "lock"


def _span(run: Run, start: float, end: float | None) -> str:
    until = run.time if end is None else end
    return f"{from_to(start, end)}, {duration(until - start)}"
