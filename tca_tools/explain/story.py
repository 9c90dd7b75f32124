"""The story of one message, in sentences: its sender, its waits, its handlers, its end."""

from bisect import bisect_left
from collections.abc import Iterator
from itertools import groupby, pairwise
from math import inf, nextafter
from operator import attrgetter
from typing import NamedTuple

from tca_tools.explain.deciding import calls, decisions, passed_on, retry_in_words
from tca_tools.explain.wait_words import (
    describe_event,
    for_claim,
    in_queue,
    named_waits,
    of_query,
    suspension_in_words,
    wait_for,
)
from tca_tools.explain.waits import NO_TIME, Wait, of_handler_wait, waits_for_display
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.coordinators import sent_by_coordinator
from tca_tools.journal.fates import WATCHING, describe_asker
from tca_tools.journal.records import (
    OVER,
    Claim,
    HandlerWait,
    Handling,
    LifeChange,
    Message,
    Task,
    TaskState,
)
from tca_tools.journal.whole_run import Run
from tca_wire.coordination import TaskRole
from tca_wire.life_cycles import Effect
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom, kill_reason, place, raised_by
from tca_wire.text.measures import listed
from tca_wire.text.printable import first_line
from tca_wire.text.waits_in_words import in_words, several_in_words, whereabouts
from tca_wire.vocabulary import Outcome
from tca_wire.waits import NAMED, WaitFor, WaitKind

NOT_HANDLED = "no exception handler handled that"
"""The reason of a kill because of a failure. Another sentence of the story describes the failure.
"""
_START = attrgetter("start")
_SHORTEST = 0.0005
"""A duration so far is shown only if it is at least this long, in seconds."""
_BAD = {TaskState.FAILED, TaskState.KILLED}
_DESCRIBED = {*_BAD, TaskState.QUEUED, TaskState.HANDLING, TaskState.SUSPENDED}
"""States that other sentences describe."""


class Sentence(NamedTuple):
    """One event or span in the story of a message."""

    time: float
    begun: str
    """The part of the text that is known at the start."""
    seconds: float | None = None
    """The duration; None for an event, and for a span that has not ended."""
    is_open: bool = False
    """Whether the span had not ended when the journal ended."""
    ending: str = ""
    """The part of the text that is known at the end."""
    is_bad: bool = False
    """Whether the message failed or was killed."""

    @property
    def text(self) -> str:
        """The whole sentence."""
        return self.begun + self.ending

    def as_known_at(self, instant: float) -> "Sentence":
        """Return the sentence as known at an instant, without a later end."""
        ends_later = self.seconds is not None and self.time + self.seconds > instant
        if self.is_open or ends_later:
            return self._replace(seconds=None, is_open=True, ending="")
        return self

    def text_at(self, instant: float, time: float) -> str:
        """Return the text as known at an instant, with the duration until its end or so far.

        Args:
            instant: The time of an entry.
            time: The same time on the entries' clock.
        """
        so_far = time - self.time
        if self.as_known_at(instant).is_open:
            return self.begun + (f", {so_far:.3f} s so far" if so_far >= _SHORTEST else "")
        return self.text + ("" if self.seconds is None else f", {self.seconds:.3f} s")


Sentences = Iterator[Sentence]


def _span_sentence(start: float, end: float, text: str, ending: str = "") -> Sentence:
    seconds = None if end == inf else end - start
    return Sentence(start, text, seconds, seconds is None, ending)


def story(run: Run, message_id: int, instant: float = inf) -> list[Sentence]:
    """Return the story of a message or task in order; [] if it is unknown.

    A sentence that starts by *instant* describes the state as known at *instant*. The part that
    became known later is in its ``ending``.
    """
    message = run.messages.get(message_id)
    if message is None:
        return []
    found = [_birth(run, message), *_failures(run, message, instant)]
    for time, why in message.new_values("dropped"):
        if why:
            found.append(Sentence(time, f"{_dropped(message, time)}: {why}"))
    if isinstance(message, Task):
        found += _exception_handlers(run, message, instant)
        found += _suspensions(run, message, instant)
        found += _changes(message, instant)
        found += _kills(message)
        found += _tests(run, message, instant)
        found += _plans(run, message)
        found += _preview(run, message)
    found += _waits_in_queues(run, message, instant)
    for handling in message.handlings:
        found += _handling(RunAt(run, instant), handling)
    if isinstance(message, Task):
        found += _states(run, message, instant)
    found += _restarts(run, message, found)
    # The sort is stable: at one time, causes come before their effects
    return sorted(found, key=attrgetter("time"))


def _birth(run: Run, message: Message) -> Sentence:
    text = str(message.message_class)
    if message.role:
        text += " made by central"
        if message.role.value != message.message_class.value:
            text += f": {message.role}"
        text += f" for {run.describe(message.about)}"
    else:
        text += f" sent by {message.sender}"
        if origin := run.delivered(message.origin):
            text += f" while handling {origin}"
    if isinstance(message, Task) and message.parent:
        text += f", under {run.describe(message.parent)}"
    return Sentence(message.received, text)


def _restarts(run: Run, message: Message, others: list[Sentence]) -> Sentences:
    """Yield the restarts of central during the message's life."""
    is_open = any(one.is_open for one in others)
    if isinstance(message, Task):
        is_open = message.state not in OVER
    end = inf if is_open else max(one.time + (one.seconds or 0.0) for one in others)
    for one in run.restarts:
        if message.received < one.time <= end:
            yield Sentence(one.time, str(one))


def _failures(run: Run, message: Message, instant: float) -> Sentences:
    raised = run.raised.get(message.id, ())
    by = {(one.time, one.failure): raised_by(one.by) for one in raised}
    for time, failure in message.failures:
        yield Sentence(time, f"failed: {failure}{by.get((time, failure), '')}", is_bad=True)
        if who := describe_asker(run, message, time, max(instant, time)):
            yield Sentence(time, f"its failure is {who}")
    for time, data in message.new_values("failure_data"):
        if text := data_text(data):
            yield Sentence(time, f"the failure's data: {text}")


def _kills(task: Task) -> Sentences:
    """Yield when a task was killed, or stopped watching."""
    for time, why in task.new_values("watched"):
        if why:
            yield Sentence(time, f"stops watching: {why}")
    for time, why in task.new_values("killed"):
        if why is not None:
            reason = kill_reason(why, task.value_at("killed_by", time))
            if task.killed_for == task.id and task.value_at("failure", time):
                reason = NOT_HANDLED
            yield Sentence(time, f"killed: {reason}", is_bad=True)


def _dropped(query: Message, given_up: float) -> str:
    """Return the end of a message that was dropped; a multi-query retains the answers it got."""
    answers = [
        one for one in query.handlings if one.outcome is Outcome.DONE and one.until < given_up
    ]
    has_some = query.message_class.asks_many and query.was_given_up and answers
    return "ended with the answers received" if has_some else "dropped"


def _exception_handlers(run: Run, task: Task, instant: float) -> Sentences:
    """Yield the calls of exception handlers for a task's failures, and the task's retries.

    If the task is an exception handler, yield its own decisions, too.
    """
    later = nextafter(instant, inf)
    for call in (*calls(RunAt(run, instant), task, end=later), *calls(RunAt(run), task, later)):
        yield Sentence(call.time, f"exception handler {call.text}")
    failure = f"the failure of {run.describe(task.parent)}"
    yield from (Sentence(*one) for one in passed_on(run, task.id, failure))
    for retry in task.retries:
        yield Sentence(retry.time, retry_in_words(run, task, retry))
    yield from (Sentence(*one) for one in decisions(run, task))


def _suspensions(run: Run, task: Task, instant: float) -> Sentences:
    """Yield when a task was suspended and resumed, and the handlers that were still running."""
    for one in task.suspensions:
        cause = run.describe(one.cause)
        text = suspension_in_words(one)
        if one.end is None or one.is_resumed or one.is_active(instant):
            text += f", until {cause} is resumed"
        elif one.cause != task.id:
            text += f" with {cause}"
        yield _span_sentence(one.start, one.until, text)
        for handling in one.handlings:
            number = handling.message_id
            if handling.start < one.start and task.id in (number, one.cause):
                who = "its handler" if number == task.id else run.describe(number)
                yield _span_sentence(one.start, handling.until, f"{who} still runs")
        if one.is_resumed:
            yield Sentence(one.until, f"resumed{by_whom(one.resumed_by)}")


def _tests(run: Run, monitor: Task, instant: float) -> Sentences:
    """Yield the results of a monitor's tests; a row of equal results is one sentence."""

    def outcome(test: tuple[float, bool]) -> tuple[bool, bool]:
        return test[0] <= instant, test[1]

    for (_, holds), tests in groupby(run.tests.get(monitor.id, ()), key=outcome):
        first, *more = [time for time, _ in tests]
        text = f"its condition {'holds' if holds else 'does not hold'}"
        if more:
            yield _span_sentence(first, more[-1], text, f", {1 + len(more)} times")
        else:
            yield Sentence(first, text)


def _changes(task: Task, instant: float) -> Sentences:
    """Yield the requests of clients, the server's replies, and the intermediate results.

    Consecutive results share a sentence.
    """

    def kind(one: LifeChange) -> tuple[bool, object]:
        return one.time <= instant, one.effect is Effect.RESULT and one.transition

    for (_, are_results), changes in groupby(task.life, key=kind):
        first, *more = row = list(changes)
        if are_results and more:
            last = more[-1]
            ending = f", {len(row)} times; the last: {data_text(last.body)}"
            yield _span_sentence(first.time, last.time, str(first), ending)
            continue
        for one in row:
            data = data_text(one.body)
            yield Sentence(one.time, f"{one}: {data}" if data else str(one))


def _preview(run: Run, task: Task) -> Sentences:
    """Yield how long a coordinator's task was early work, and whether that work was kept."""
    if (sent := sent_by_coordinator(run, task)) is None:
        return
    ending = ", kept: the state is entered"
    if sent.is_wasted:
        ending = ", wasted: the state is not entered"
    ahead = f"ahead of the state '{sent.state}'"
    for (time, role), (until, _) in pairwise([*sent.roles, (inf, None)]):
        if role is TaskRole.AHEAD:
            yield _span_sentence(time, until, ahead, ending)
        elif role is TaskRole.RESTORING:
            yield Sentence(time, f"undoes wasted work {ahead}")


def _plans(run: Run, task: Task) -> Sentences:
    """Yield the deadlines and planned kills of a task."""
    for one in run.plans.get(task.id, ()):
        at = RunAt(run, one.set_at)
        if text := describe_event(at, at.tasks[task.id], one):
            yield Sentence(one.set_at, text)


# --- queues and handlers --------------------------------------------------------------------------


def _waits_in_queues(run: Run, message: Message, instant: float) -> Sentences:
    for queueing in message.queueings:
        if queueing.end == queueing.start:
            continue  # a handler was free
        text = "no module handles it"
        if queueing.module:
            until = instant if queueing.start <= instant else inf
            text = f"queued {in_queue(run, queueing, message, until)}"
        yield _span_sentence(queueing.start, queueing.until, text)


def _handling(at: RunAt, handling: Handling) -> Sentences:
    how = ""
    if handling.end is not None and handling.outcome is not Outcome.DONE:
        how = f": {handling.outcome or 'cut off'}"
    where = place(handling.module, handling.resource)
    yield _span_sentence(handling.start, handling.until, f"handled by {where}", how)
    for wait in handling.waits:
        if (claim := at.run.claims.get(wait.awaited)) is not None:
            yield from _wait_for_claim(at, wait, claim)
        else:
            yield _wait(at, wait)
    yield from _queries(at, handling)


def _wait_for_claim(at: RunAt, wait: HandlerWait, claim: Claim) -> Sentences:
    """Yield a handler's wait for a lock, and how long it has the lock."""
    if claim.granted != wait.start:
        until = at.instant if wait.start <= at.instant else inf
        text = for_claim(at.run, wait, claim, until)
        yield _span_sentence(wait.start, wait.until, f"its handler waits {text}")
    if claim.granted is not None:
        yield _span_sentence(claim.granted, claim.until, f"its handler has the {claim}")


def awaited_in_words(run: Run, wait: HandlerWait) -> str:
    """Return what a handler waited for at the start: ``for the reply to next stance {7}``."""
    return in_words(wait_for(RunAt(run, wait.start), of_handler_wait(run, wait)))


def _without_place(run: Run, wait: HandlerWait) -> WaitFor:
    """Return what a handler waited for, without where that was queued or handled."""
    kind, name = of_handler_wait(run, wait).kind, wait.name or run.name(wait.awaited)
    return WaitFor(kind, wait.awaited, name, int(wait.moment or 0))


def _wait(at: RunAt, wait: HandlerWait) -> Sentence:
    run = at.run
    cause = _without_place(run, wait)
    if wait.is_active(at.instant):
        cause = wait_for(at, of_handler_wait(run, wait))
    sentence = _span_sentence(wait.start, wait.until, f"its handler waits {in_words(cause)}")
    if cycle := run.deadlock(wait):
        seconds = sentence.seconds if wait.end != wait.start else None
        return sentence._replace(seconds=seconds, ending=f", and is refused: {cycle}")
    query = None if wait.moment else run.messages.get(wait.awaited)
    if query is None or wait.end is None:
        return sentence
    ending = ""
    if query.was_given_up:
        asked = of_query(RunAt(run, nextafter(wait.end, 0.0)), query)
        ending = f", and gives up: {whereabouts(asked) if asked.because else 'no answer arrived'}"
    elif failure := _failure_of(query, wait.end):
        ending = f", which fails: {failure}"
    return sentence._replace(ending=ending)


def _failure_of(query: Message, instant: float) -> str:
    """Return the failure of a query in one line; "" for none, and for a multi-query."""
    if not query.message_class.asks_one:
        return ""
    return first_line(query.value_at("failure", instant))


def _queries(at: RunAt, handling: Handling) -> Sentences:
    """Yield the queries after which the handler did not wait at once for the reply."""
    first = {wait.awaited: wait for wait in reversed(handling.waits)}
    for query in handling.asked or ():
        text, fetched = f"its handler asked {query}, and continues", first.get(query.id)
        if fetched is not None and fetched.start <= max(at.instant, query.received):
            if fetched.start > query.received:
                yield _span_sentence(query.received, fetched.start, text)
            continue
        end = query.answered
        if end is None:
            end = query.written_at("dropped") if query.dropped else inf
        now = of_query(at, query)
        if query.received <= at.instant < end and now.because:
            text += f"; {whereabouts(now)}"
        failure = _failure_of(query, end) if end < inf else ""
        yield _span_sentence(query.received, end, text, f"; it fails: {failure}" if failure else "")


# --- states ---------------------------------------------------------------------------------------


def _states(run: Run, task: Task, instant: float) -> Sentences:
    """Yield the states that other sentences do not describe, with their causes."""
    waits, at = waits_for_display(run, task, together=True), RunAt(run, instant)
    starts = [one.start for one in waits]
    state = TaskState.HELD
    for start, end, following in task.spans():
        before, state = state, following
        if end - start < NO_TIME:
            continue
        if state in OVER:
            survived = state is TaskState.FAILED and task.killed is None
            if before is TaskState.ENDING or (
                survived and task.written_at("failure", start) < start
            ):
                yield Sentence(start, "has ended")
            elif state not in _DESCRIBED:
                yield Sentence(start, str(state))
            continue
        if state in _DESCRIBED:
            continue
        causes = waits[bisect_left(starts, start) : bisect_left(starts, end)]
        is_at_work = any(isinstance(one.record, Handling) for one in causes)
        if not causes or (state is TaskState.PLANNING and is_at_work):
            yield _span_sentence(start, end, str(state))
        else:
            yield from _in_state(at, task, state, causes)


def _in_state(at: RunAt, task: Task, state: TaskState, waits: list[Wait]) -> Sentences:
    """Yield the waits of a task in a state; waits with the same kind and start share a sentence."""
    watched = [one for one in waits if one.kind is WaitKind.CONDITION]
    yield from (_span_sentence(one.start, one.end, WATCHING) for one in watched)
    groups: dict[object, list[Wait]] = {}
    for wait in waits:
        if not any(one.start <= wait.start < one.end for one in watched):
            groups.setdefault((wait.kind, wait.on.moment, wait.start), []).append(wait)
    for group in groups.values():
        is_one_sentence = len(group) > NAMED or group[0].kind is WaitKind.SUBTASK
        for part in [group] if is_one_sentence else [[one] for one in group]:
            yield _of_group(at, task, state, part)


def _of_group(at: RunAt, task: Task, state: TaskState, waits: list[Wait]) -> Sentence:
    ends = [end for one in waits for end in (one.end, *one.others)]
    start, end = waits[0].start, max(ends)
    any_outcome = state is TaskState.ENDING or task.is_retry_due
    named = named_waits(RunAt(at.run, start), waits, any_outcome=any_outcome)
    text = f"{state}, {several_in_words(named)}"
    return _span_sentence(start, end, text, _in_vain(at.run, task, waits, end))


def _in_vain(run: Run, task: Task, waits: list[Wait], end: float) -> str:
    """Return which awaited tasks failed or were killed.

    Such a task reaches all its moments at once, which ends the waits for them.
    """
    if end == inf or (task.killed is not None and task.written_at("killed") <= end):
        return ""
    bad = []
    for wait in waits:
        one = run.tasks.get(wait.on.number)
        if wait.kind is WaitKind.CONSTRAINT and one is not None:
            time, state = one.stage(-1)
            if time == wait.end and state in _BAD:
                bad.append(str(one))
    if not bad:
        return ""
    return f", but {listed(bad)} {'was' if len(bad) == 1 else 'were'} not achieved"
