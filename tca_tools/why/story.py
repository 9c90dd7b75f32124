"""What became of one message, in sentences: who sent it, what it waited for, who handled it, how it ended."""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import groupby
from math import inf, nextafter
from operator import attrgetter
from typing import Any, NamedTuple

from tca_tools.run.at_time import RunAt
from tca_tools.run.fates import WATCHING, told_to
from tca_tools.run.records import (
    OVER,
    Claim,
    HandlerWait,
    Handling,
    Message,
    Queueing,
    Retry,
    State,
    Suspension,
    Task,
)
from tca_tools.run.whole_run import Run
from tca_tools.terminal import cut
from tca_tools.why.deciding import decisions, exhausted, retried_for
from tca_tools.why.keepers import Part, parts_in_queue, parts_of_claim
from tca_tools.why.wait_words import NAMED, of_ahead, of_claim, of_query, of_queueing, told, wait_for
from tca_tools.why.waits import NO_TIME, Wait, of_handler_wait, told_waits
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom, kill_reason, place, raised_by
from tca_wire.text.measures import counted, listed, numbered
from tca_wire.text.waits_in_words import in_words, several_in_words, whereabouts
from tca_wire.vocabulary import Outcome
from tca_wire.waits import WaitFor, WaitKind

_NEWLINE = "\n"
_SHORTEST = 0.0005
"""Seconds: of what has just begun no length is said."""
_MANY = 3
"""Waits of one handler at a time, more of which are told as one; keepers told at either end of a wait in a queue."""
_LONGEST_ANSWER = 40
"""Columns of an answer that is told among others."""
_IS_TOLD = {State.QUEUED, State.FAILED, State.KILLED, State.HANDLING, State.SUSPENDED}
"""States of which other sentences tell."""
_IN_VAIN = {State.FAILED: ("failed", "failed"), State.KILLED: ("was killed", "were killed")}
"""How a task ends that is not achieved, and how several do."""


class _Asked(NamedTuple):
    """What a handler asked or waited for, from when until when."""

    what: WaitFor
    start: float
    end: float

    @property
    def name(self) -> str:
        """What that is called."""
        return numbered(self.what.name, self.what.number)


class Sentence(NamedTuple):
    """Something that happened: when, and how long it took (None: it goes on, or took no time)."""

    time: float
    begun: str
    """What is known of it from its beginning on."""
    seconds: float | None = None
    is_open: bool = False
    """Whether it goes on when the journal ends."""
    ending: str = ""
    """How it ended, behind that."""

    @property
    def text(self) -> str:
        """The whole sentence."""
        return self.begun + self.ending

    is_bad: bool = False
    """Whether it says that the message failed or was killed."""

    def known(self, moment: float) -> "Sentence":
        """What was known of it at a moment: of what ended later, not how nor when."""
        if self.is_open or (self.seconds is not None and self.time + self.seconds > moment):
            return self._replace(seconds=None, is_open=True, ending="")
        return self

    def by(self, moment: float, time: float) -> str:
        """What was known of it at a moment, when the clock showed *time*: with how long it took, or has so far."""
        if self.is_open or (self.seconds is not None and self.time + self.seconds > moment):
            lasts = f", {time - self.time:.3f} s so far" if time - self.time >= _SHORTEST else ""
            return self.begun + lasts
        return self.text + (f", {self.seconds:.3f} s" if self.seconds is not None else "")


def story(run: Run, message_id: int, moment: float = inf) -> list[Sentence]:
    """All that happened to a message or task, in order; nothing of one that is unknown. What had begun at *moment* is
    told as it was known then, but for how it ended: that is Sentence's.
    """
    message = run.messages.get(message_id)
    if message is None:
        return []
    told = [_birth(run, message), *_changes(run, message)]
    if isinstance(message, Task):
        told += _exhausted(run, message)
        told += _suspensions(run, message, moment)
        told += _recoveries(run, message)
        told += _retries(run, message)
        told += _kills(message)
        told += _tests(run, message, moment)
        told += _plans(run, message)
    told += _tellings(run, message, moment)
    told += _waits_in_queues(run, message, moment)
    for handling in message.handlings:
        told += _run(run, handling, moment)
    if isinstance(message, Task):
        told += _states(run, message, moment)
    return sorted(told, key=attrgetter("time"))  # at one time: what happened before what follows from it


def sender_of(run: Run, message: Message) -> str:
    """Who sent it, and while doing what."""
    origin = run.delivered(message.origin)
    return message.sender + (f" while handling {origin}" if origin else "")


def _birth(run: Run, message: Message) -> Sentence:
    text = f"{message.message_class} sent by {sender_of(run, message)}"
    if message.role:
        made = f"{message.message_class} made by central"
        role = "" if message.role.value == message.message_class.value else f": {message.role}"
        text = f"{made}{role} for {run.describe(message.about)}"
    if isinstance(message, Task) and message.parent:
        text += f", under {run.describe(message.parent)}"
    return Sentence(message.received, text)


def _waits_in_queues(run: Run, message: Message, moment: float) -> Iterator[Sentence]:
    for queueing in message.queueings:
        if queueing.end == queueing.start:
            continue  # it passed through, to a handler that was free
        if not queueing.module:
            yield _spanning(queueing, "no module handles it")
            continue
        for start, end, parts in _briefly(parts_in_queue(run, queueing, message), moment):
            at = RunAt(run, start)
            what = f"queued {in_words(of_queueing(at, queueing, parts[0].by))}"
            if len(parts) > 1:
                what = f"queued for {place(queueing.module, queueing.resource)}, kept busy by {_others(parts)}"
            yield _lasting(start, end, what)


def _waits_for_claim(run: Run, wait: HandlerWait, claim: Claim, moment: float) -> Iterator[Sentence]:
    for start, end, parts in _briefly(parts_of_claim(run, wait, claim), moment):
        what = in_words(of_claim(RunAt(run, start), claim, parts[0].by))
        if len(parts) > 1:
            what = f"for the {claim}, kept busy by {_others(parts)}"
        yield _lasting(start, end, f"its handler waits {what}")


def _others(parts: list[Part]) -> str:
    return f"{counted(len(parts), 'other')}, one after the other"


def _briefly(parts: list[Part], moment: float) -> Iterator[tuple[float, float, list[Part]]]:
    """The first and the last ones that had begun at a moment, and of those after it likewise; those between together.
    What is told of a moment stays the same when time goes on.
    """
    known = bisect_right(parts, moment, key=attrgetter("start"))
    for some in (parts[:known], parts[known:]):
        middle = some[_MANY:-_MANY]
        together = [middle] if len(middle) > 1 else [[one] for one in middle]
        last = some[max(len(some) - _MANY, _MANY) :]
        for group in ([one] for one in some[:_MANY]), together, ([one] for one in last):
            yield from ((one[0].start, one[-1].end, one) for one in group)


def _run(run: Run, handling: Handling, moment: float) -> Iterator[Sentence]:
    how = ""
    if handling.end is not None and handling.outcome is not Outcome.DONE:
        how = f": {handling.outcome or 'cut off'}"
    at = RunAt(run, moment)
    yield _spanning(handling, f"handled by {place(handling.module, handling.resource)}", how)
    over: dict[int, list[_Asked]] = {}
    for wait in handling.waits:
        claim = run.claims.get(wait.awaited)
        if claim is None:
            sentence = _wait(at, wait)
            if wait.end is None or wait.end > at.moment or sentence.ending or wait.end == wait.start:
                yield sentence
            else:
                over.setdefault(int(wait.moment or 0), []).append(_Asked(_plain(run, wait), wait.start, wait.end))
        elif claim.granted != wait.start:
            yield from _waits_for_claim(run, wait, claim, moment)
        if claim is not None and claim.granted is not None:
            took = None if claim.end is None else claim.end - claim.granted
            yield Sentence(claim.granted, f"its handler has the {claim}", took, took is None)
    for waited in over.values():
        yield from _over(waited)
    yield from _asked(at, handling)


def awaited(run: Run, wait: HandlerWait) -> str:
    """What a handler waited for when it began to: ``for the reply to next stance {7}``."""
    return in_words(wait_for(RunAt(run, wait.start), of_handler_wait(run, wait)))


def _plain(run: Run, wait: HandlerWait) -> WaitFor:
    """What a handler waited for, without where that was."""
    kind = WaitKind.TASK if wait.moment else WaitKind.REPLY
    return WaitFor(kind, wait.awaited, run.name(wait.awaited), int(wait.moment or 0))


def _over(waited: list[_Asked]) -> Iterator[Sentence]:
    """Waits that are over. Of many that began at once it is told in one sentence, with what came last."""
    for some in _at_once(waited):
        for together in [some] if len(some) > _MANY else [[one] for one in some]:
            last = max(together, key=attrgetter("end"))
            text = f"its handler waits {several_in_words(one.what for one in together)}"
            text += f", the last one {last.name}" if len(together) > 1 else ""
            yield Sentence(together[0].start, text, last.end - together[0].start)


def _asked(at: RunAt, handling: Handling) -> Iterator[Sentence]:
    """The queries for whose replies it did not wait, or later."""
    first = {wait.awaited: wait for wait in reversed(handling.waits)}
    later: list[_Asked] = []
    for query in handling.asked or ():
        fetched = first.get(query.id)
        if fetched is None or fetched.start > max(at.moment, query.received):
            end = query.answered if query.answered is not None else query.written("dropped") if query.dropped else None
            is_open = query.received <= at.moment and (end is None or end > at.moment)
            now = of_query(at, query)
            where = f"; {whereabouts(now)}" if is_open and now.because else ""
            took = None if end is None else end - query.received
            text = f"its handler asked {query}, and goes on{where}"
            how = f"; it fails: {failure}" if end is not None and (failure := _failure_told(query, end)) else ""
            yield Sentence(query.received, text, took, took is None, how)
        elif fetched.start > query.received:  # it fetches the reply later
            later.append(_Asked(WaitFor(WaitKind.REPLY, query.id, query.name), query.received, fetched.start))
    for some in _at_once(later):
        asked, end = listed([one.name for one in some]), max(one.end for one in some)
        yield Sentence(some[0].start, f"its handler asked {asked}, and goes on", end - some[0].start)


def _at_once(asked: list[_Asked]) -> Iterator[list[_Asked]]:
    """Those together, in the order of their start, that had begun before one of them was over."""
    some, end = list[_Asked](), inf
    for one in asked:
        if one.start >= end:
            yield some
            some, end = [], inf
        some.append(one)
        end = min(end, one.end)
    if some:
        yield some


def _wait(at: RunAt, wait: HandlerWait) -> Sentence:
    run, goes_on = at.run, wait.start <= at.moment and (wait.end is None or wait.end > at.moment)
    text = f"its handler waits {in_words(wait_for(at, of_handler_wait(run, wait)) if goes_on else _plain(run, wait))}"
    if circle := run.deadlock(wait):
        sentence = _spanning(wait, text, f", and is refused: {circle}")
        return sentence._replace(seconds=None) if wait.end == wait.start else sentence
    query = None if wait.moment else run.messages.get(wait.awaited)
    if query is None or wait.end is None:
        return _spanning(wait, text)
    if query.was_given_up:
        asked = of_query(RunAt(run, nextafter(wait.end, 0.0)), query)
        return _spanning(wait, text, f", and gives up: {whereabouts(asked) if asked.because else 'no answer came'}")
    failure = _failure_told(query, wait.end)
    return _spanning(wait, text, f", which fails: {failure}" if failure else "")


def _failure_told(query: Message, moment: float) -> str:
    """With what a query had failed, in a line; "" if it had not. Of a question to many single failures say nothing."""
    failure = str(query.was("failure", moment)) if query.message_class.asks_one else ""
    return next(iter(failure.strip().splitlines()), "")


def _answers_so_far(run: Run, query: Message, given_up: float) -> str:
    """What became of a multi-query that was given up when some had answered: its sender gets these answers. ``its
    sender waits no longer: 1 of 3 answered in time: arm (7); legs had not, head had failed``; "" of others.
    """
    if not query.message_class.asks_many or not query.was_given_up:
        return ""
    at = RunAt(run, nextafter(given_up, 0.0))
    late = [place(one.module, one.resource) for one in of_query(at, query).because]
    runs = [one for one in query.handlings if one.end is not None and one.end <= at.moment]
    answers = [_answer(query, one) for one in runs if one.outcome is Outcome.DONE]
    failed = [place(one.module, one.resource) for one in runs if one.outcome is not Outcome.DONE]
    others = [f"{listed(some)} had {what}" for some, what in ((late, "not"), (failed, "failed")) if some]
    rest = f"; {', '.join(others)}" if others else ""
    number = f"{len(answers)} of {len(late) + len(runs)}"
    return f"its sender waits no longer: {number} answered in time: {listed(answers)}{rest}" if answers else ""


def _answer(query: Message, run: Handling) -> str:
    """Who answered, and what."""
    data = "" if run.end is None else data_text(query.was("result", run.end))
    return place(run.module, run.resource) + (f" ({cut(data, _LONGEST_ANSWER)})" if data else "")


def _changes(run: Run, message: Message) -> Iterator[Sentence]:
    changed = {name for _, name, _ in message.changes}
    raised = {(one.time, one.failure): raised_by(one.by) for one in run.raised.get(message.id, ())}
    for name, say in _SAY.items():
        for time, new in message.became(name) if name in changed else ():
            if new and (said := say(new)):
                if name == "dropped":
                    said = _answers_so_far(run, message, time) or said
                who = raised.get((time, new), "") if name == "failure" else ""
                yield Sentence(time, said + who, is_bad=name == "failure")


_SAY: dict[str, Any] = {
    "failure": lambda text: f"failed: {text}",
    "failure_data": lambda data: f"the failure's data: {text}" if (text := data_text(data)) else "",
    "dropped": lambda why: f"came to nothing: {why}",
    "watched": lambda why: f"watches no longer: {why}",
}


def _kills(task: Task) -> Iterator[Sentence]:
    for time, why in task.became("killed"):
        if why is not None:
            yield Sentence(time, f"killed: {kill_reason(why, task.was('killed_by', time))}", is_bad=True)


def _exhausted(run: Run, task: Task) -> Iterator[Sentence]:
    """Why an exception handler was not called, though it is there."""
    for one in run.exhausted.get(task.id, ()):
        yield Sentence(one.time, f"exception handler {exhausted(one)}")


def _tellings(run: Run, message: Message, moment: float) -> Iterator[Sentence]:
    """Who was told that a query failed, and went on or did not."""
    for time, failure in message.became("failure"):
        if failure and (who := told_to(run, message, time, max(moment, time))):
            yield Sentence(time, f"its failure is {who}")


def _recoveries(run: Run, task: Task) -> Iterator[Sentence]:
    for handler in task.caught_by:
        if found := run.tasks.get(handler):
            yield Sentence(found.received, f"exception handler {found} is called")
            for time, failure in found.became("failure"):
                if failure:
                    yield Sentence(time, f"{found} fails, too: {failure.strip().partition(_NEWLINE)[0]}")
        if handler in run.reissued:
            yield Sentence(run.reissued[handler], f"{run.describe(handler)} passes the failure on")
    if task.id in run.reissued:
        yield Sentence(run.reissued[task.id], f"passes the failure of {run.describe(task.parent)} on")


def _retries(run: Run, task: Task) -> Iterator[Sentence]:
    for one in task.retries:
        yield Sentence(one[0], retried(run, task, one))
    for time, text in decisions(run, task):
        yield Sentence(time, text)


def retried(run: Run, task: Task, retry: Retry) -> str:
    """``to be handled again, with other data (retried by safety)``."""
    why = retried_for(run, task, retry)
    whom = by_whom(retry.by) + (f": {why}" if why else "")
    return f"to be handled again{', with other data' * retry.is_other} (retried{whom})"


def _tests(run: Run, monitor: Task, moment: float) -> Iterator[Sentence]:
    """What a monitor's condition came to; tests with the same outcome, one after the other, are one sentence."""
    for (_, holds), tests in groupby(run.tests.get(monitor.id, ()), key=lambda test: (test[0] <= moment, test[1])):
        first, *more = [time for time, _ in tests]
        text = "its condition holds" if holds else "its condition does not hold"
        often = f", {1 + len(more)} times" if more else ""
        yield Sentence(first, text, more[-1] - first if more else None, ending=often)


def _plans(run: Run, task: Task) -> Iterator[Sentence]:
    """Its deadlines, and the kills that were to come."""
    for one in run.ahead.get(task.id, ()):
        at = RunAt(run, one.set_at)
        if said := of_ahead(at, at.tasks[task.id], one):
            yield Sentence(one.set_at, said)


def _states(run: Run, task: Task, moment: float) -> Iterator[Sentence]:
    """The states that nothing else tells of, with what ended them or keeps them up."""
    waits = told_waits(run, task)
    for number, (start, end, state) in enumerate(task.spans()):
        is_told = state in _IS_TOLD and state not in OVER
        if is_told or end - start < NO_TIME:
            continue
        if state in OVER:
            is_late = number > 0 and (task.states[number - 1][1] is State.ENDING or _failed_before(task, state, start))
            if state not in _IS_TOLD or is_late:
                yield Sentence(start, "has ended" if is_late else str(state))
            continue
        kept = [one for one in waits if start <= one.start < end]
        handled = [one for one in kept if one.record is not None and isinstance(one.record, Handling)]
        if state is State.PLANNING and handled:
            kept = []
        yield from _in_state(RunAt(run, moment), task, state, kept) if kept else [_lasting(start, end, str(state))]


def _in_state(at: RunAt, task: Task, state: State, waits: list[Wait]) -> Iterator[Sentence]:
    """What keeps a task in a state; what kept it from when it came to that on is told together, if it is much."""
    watched = [one for one in waits if one.kind is WaitKind.CONDITION]
    yield from (_lasting(one.start, one.end, WATCHING) for one in watched)
    groups: dict[object, list[Wait]] = {}
    for wait in waits:
        if wait.kind is WaitKind.CONDITION or any(one.start <= wait.start < one.end for one in watched):
            continue
        groups.setdefault((wait.kind, wait.on.moment, wait.start), []).append(wait)
    for group in groups.values():
        is_told_at_once = len(group) > NAMED or group[0].kind is WaitKind.SUBTASK
        for some in [group] if is_told_at_once else [[one] for one in group]:
            yield _of_group(at, task, state, some)


def _of_group(at: RunAt, task: Task, state: State, waits: list[Wait]) -> Sentence:
    start, end = waits[0].start, max(one.end for one in waits)
    is_in_whatever_way = state is State.ENDING or task.is_retried
    what = several_in_words(told(RunAt(at.run, start), waits, however=is_in_whatever_way))
    left = sum(one.end > at.moment for one in waits) if start <= at.moment < end else len(waits)
    more = f", {left} of them still to come" if left < len(waits) else ""
    return _lasting(start, end, f"{state}, {what}{more}", _not_achieved(at.run, task, waits, end))


def _not_achieved(run: Run, task: Task, waits: list[Wait], end: float) -> str:
    """Which of what it waited for failed or was killed instead: whatever is reaches all moments at once."""
    if end == inf or (task.killed is not None and task.written("killed") <= end):
        return ""
    found: dict[str, list[str]] = {}
    for wait in waits:
        other = run.tasks.get(wait.on.number)
        if wait.kind is WaitKind.CONSTRAINT and other is not None and other.states and wait.end < inf:
            ended, how = other.states[-1]
            if how in _IN_VAIN and ended == wait.end:
                found.setdefault(how, []).append(str(other))
    ends = [f"{listed(names)} {_IN_VAIN[State(how)][len(names) > 1]}" for how, names in found.items()]
    return f", but {' and '.join(ends)}" if ends else ""


def _failed_before(task: Task, state: State, time: float) -> bool:
    """Whether it ends as failed, and went on after its failure: so does what survives what is above it."""
    return state is State.FAILED and task.killed is None and task.written("failure", time) < time


def _suspensions(run: Run, task: Task, moment: float) -> Iterator[Sentence]:
    """When it was suspended and resumed, and which handlers ran on."""
    for suspension in task.suspensions:
        cause, text = run.describe(suspension.cause), f"suspended{by_whom(suspension.by)}"
        if suspension.end is None or suspension.is_resumed or suspension.start <= moment < suspension.end:
            text += f", until {cause} is resumed"
        elif suspension.cause != task.id:
            text += f" with {cause}"
        yield _spanning(suspension, text)
        for handling in suspension.still:
            took = None if handling.end is None else handling.end - suspension.start
            if handling.message_id == task.id:
                yield Sentence(suspension.start, "its handler still runs", took, took is None)
            elif suspension.cause == task.id:
                who = run.describe(handling.message_id)
                yield Sentence(suspension.start, f"{who} under it still runs", took, took is None)
        if suspension.is_resumed and suspension.end is not None:
            yield Sentence(suspension.end, f"resumed{by_whom(suspension.resumed_by)}")


def _spanning(span: Queueing | Handling | HandlerWait | Suspension, text: str, ending: str = "") -> Sentence:
    took = None if span.end is None else span.end - span.start
    return Sentence(span.start, text, took, took is None, ending)


def _lasting(start: float, end: float, text: str, ending: str = "") -> Sentence:
    took = None if end == inf else end - start
    return Sentence(start, text, took, took is None, ending)
