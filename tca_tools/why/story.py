"""What became of one message, in sentences: who sent it, what it waited for, who handled it, how it ended."""

from collections.abc import Iterator
from itertools import groupby
from math import inf, nextafter
from operator import attrgetter
from typing import Any, NamedTuple

from tca_tools.run.at_time import RunAt
from tca_tools.run.records import (
    OVER,
    Claim,
    Exhausted,
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
from tca_tools.why.coping import WATCHING, told_to, watches
from tca_tools.why.deciding import decisions, retried_for
from tca_tools.why.stretches import NO_TIME, OTHERS, Stretch, for_claim_briefly, in_queue_briefly, in_state, still_open
from tca_tools.why.waiting import clause, of_ahead, of_all
from tca_tools.why.whereabouts import (
    NAMED,
    answers_so_far,
    claim_and_why,
    failure_told,
    listed,
    whereabouts,
    why_in_vain,
)
from tca_wire.points import Moment
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import by_whom, kill_reason, place, raised_by
from tca_wire.text.measures import times
from tca_wire.vocabulary import Outcome

_NEWLINE = "\n"
_SHORTEST = 0.0005
"""Seconds: of what has just begun no length is said."""
_MANY = 3
"""Waits of one handler at a time, more of which are told as one."""
_IS_TOLD = {State.QUEUED, State.FAILED, State.KILLED, State.HANDLING, State.SUSPENDED}
"""States of which other sentences tell."""
_IN_VAIN = {State.FAILED: "failed", State.KILLED: "was killed"}
"""How a task ends that is not achieved."""


class _Asked(NamedTuple):
    """What a handler asked or waited for, from when until when."""

    name: str
    start: float
    end: float


class Sentence(NamedTuple):
    """Something that happened: when, and how long it took (None: it goes on, or took no time)."""

    time: float
    text: str
    seconds: float | None = None
    is_open: bool = False
    """Whether it goes on when the journal ends."""
    ending: str = ""
    """The end of the text, if it tells how it ended: not known before."""

    def known(self, moment: float) -> "Sentence":
        """What was known of it at a moment: of what ended later, not how nor when."""
        if self.is_open or (self.seconds is not None and self.time + self.seconds > moment):
            return self._replace(text=self.text.removesuffix(self.ending), seconds=None, is_open=True, ending="")
        return self

    def by(self, moment: float, time: float) -> str:
        """What was known of it at a moment, when the clock showed *time*: with how long it took, or has so far."""
        if self.is_open or (self.seconds is not None and self.time + self.seconds > moment):
            lasts = f", {time - self.time:.3f} s so far" if time - self.time >= _SHORTEST else ""
            return self.text.removesuffix(self.ending) + lasts
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
        where = place(queueing.module, queueing.resource)
        for part in in_queue_briefly(run, queueing, message, moment):
            yield _part(part, f"queued for {where}" + (f", {part.why}" if part.why else ""))


def _run(run: Run, handling: Handling, moment: float) -> Iterator[Sentence]:
    how = ""
    if handling.end is not None and handling.outcome is not Outcome.DONE:
        how = f": {handling.outcome or 'cut off'}"
    where, at = place(handling.module, handling.resource), RunAt(run, moment)
    yield _spanning(handling, f"handled by {where}", how)
    over: dict[Moment | None, list[_Asked]] = {}
    for wait in handling.waits:
        claim = run.claims.get(wait.awaited)
        if claim is None:
            told = _wait(at, wait)
            if wait.end is None or wait.end > at.moment or told.ending or wait.end == wait.start:
                yield told
            else:
                over.setdefault(wait.moment, []).append(_Asked(run.describe(wait.awaited), wait.start, wait.end))
        elif claim.granted != wait.start:
            yield from _waits_for_claim(run, wait, claim, moment)
        if claim is not None and claim.granted is not None:
            took = None if claim.end is None else claim.end - claim.granted
            yield Sentence(claim.granted, f"its handler has the {claim}", took, took is None)
    for until, waited in over.items():
        yield from _over(until, waited)
    yield from _asked(at, handling)


def _over(moment: Moment | None, waited: list[_Asked]) -> Iterator[Sentence]:
    """Waits that are over. Of many that began at once it is told in one sentence, with what came last."""
    for some in _at_once(waited):
        for together in [some] if len(some) > _MANY else [[one] for one in some]:
            last = max(together, key=attrgetter("end"))
            names, several = listed([one.name for one in together]), len(together) > 1
            what = f"for the {'replies' if several else 'reply'} to {names}"
            if moment:
                what = f"until {names} {of_all(clause(moment), len(together))}"
            text = f"its handler waits {what}" + (f", the last one {last.name}" if several else "")
            yield Sentence(together[0].start, text, last.end - together[0].start)


def _waits_for_claim(run: Run, wait: HandlerWait, claim: Claim, moment: float) -> Iterator[Sentence]:
    for part in for_claim_briefly(run, wait, claim, moment):
        what = f"{claim}, {OTHERS}" if part.why == OTHERS else part.why
        yield _part(part, f"its handler waits for the {what}")


def _asked(at: RunAt, handling: Handling) -> Iterator[Sentence]:
    """The queries for whose replies it did not wait, or later."""
    first = {wait.awaited: wait for wait in reversed(handling.waits)}
    later: list[_Asked] = []
    for query in handling.asked or ():
        fetched = first.get(query.id)
        if fetched is None or fetched.start > max(at.moment, query.received):
            end = query.answered if query.answered is not None else query.written("dropped") if query.dropped else None
            is_open = query.received <= at.moment and (end is None or end > at.moment)
            where = whereabouts(at, query.id) if is_open else ""
            took = None if end is None else end - query.received
            text = f"its handler asked {query}{where}, and goes on"
            how = f"; it fails: {failure}" if end is not None and (failure := failure_told(query, end)) else ""
            yield Sentence(query.received, text + how, took, took is None, how)
        elif fetched.start > query.received:  # it fetches the reply later
            later.append(_Asked(str(query), query.received, fetched.start))
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
    run, text = at.run, f"its handler waits {awaited(at.run, wait)}{_missing(at, wait)}"
    if circle := run.deadlock(wait):
        told = _spanning(wait, text, f", and is refused: {circle}")
        return told._replace(seconds=None) if wait.end == wait.start else told
    if why := why_in_vain(run, wait):
        return _spanning(wait, text, f", and gives up: {why}")
    query = None if wait.moment or wait.end is None else run.messages.get(wait.awaited)
    failure = "" if query is None or wait.end is None else failure_told(query, wait.end)
    return _spanning(wait, text, f", which fails: {failure}" if failure else "")


def _missing(at: RunAt, wait: HandlerWait) -> str:
    """Where the query is that a handler waits for at that moment, or who has not answered one that many were asked."""
    is_waiting = not wait.moment and wait.start <= at.moment and (wait.end is None or wait.end > at.moment)
    return whereabouts(at, wait.awaited) if is_waiting else ""


def awaited(run: Run, wait: HandlerWait) -> str:
    """What a handler waited for: ``for the reply to next stance {7}``."""
    if wait.moment:
        return f"until {run.describe(wait.awaited)} {clause(wait.moment)}"
    if claim := run.claims.get(wait.awaited):
        return f"for the {claim_and_why(RunAt(run, wait.start), claim)}"
    return f"for the reply to {run.describe(wait.awaited)}"


def _changes(run: Run, message: Message) -> Iterator[Sentence]:
    changed = {name for _, name, _ in message.changes}
    raised = {(one.time, one.failure): raised_by(one.by) for one in run.raised.get(message.id, ())}
    for name, say in _SAY.items():
        for time, new in message.became(name) if name in changed else ():
            if new and (said := say(new)):
                if name == "dropped":
                    said = answers_so_far(run, message, time) or said
                who = raised.get((time, new), "") if name == "failure" else ""
                yield Sentence(time, said + who)


_SAY: dict[str, Any] = {
    "failure": lambda text: f"failed: {text}",
    "failure_data": lambda data: f"the failure's data: {text}" if (text := data_text(data)) else "",
    "dropped": lambda why: f"came to nothing: {why}",
    "watched": lambda why: f"watches no longer: {why}",
}


def _kills(task: Task) -> Iterator[Sentence]:
    for time, why in task.became("killed"):
        if why is not None:
            yield Sentence(time, f"killed: {kill_reason(why, task.was('killed_by', time))}")


def _exhausted(run: Run, task: Task) -> Iterator[Sentence]:
    """Why an exception handler was not called, though it is there."""
    for one in run.exhausted.get(task.id, ()):
        yield Sentence(one.time, exhausted(one))


def exhausted(one: Exhausted) -> str:
    """``exception handler less heat has been called 3 times, as often as it may``."""
    return f"exception handler {one.handler} has been called {times(one.calls)}, as often as it may"


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
        yield Sentence(first, text + often, more[-1] - first if more else None, ending=often)


def _plans(run: Run, task: Task) -> Iterator[Sentence]:
    """Its deadlines, and the kills that were to come."""
    for one in run.ahead.get(task.id, ()):
        at = RunAt(run, one.set_at)
        if said := of_ahead(at, at.tasks[task.id], one):
            yield Sentence(one.set_at, said)


def _states(run: Run, task: Task, moment: float) -> Iterator[Sentence]:
    """The states that nothing else tells of, with what ended them or keeps them up."""
    for number, (time, state) in enumerate(task.states):
        after = task.states[number + 1][0] if number + 1 < len(task.states) else None
        is_told = state in _IS_TOLD and state not in OVER
        if is_told or (after is not None and after - time < NO_TIME):
            continue
        if state in OVER:
            is_late = number > 0 and (task.states[number - 1][1] is State.ENDING or _failed_before(task, state, time))
            if state not in _IS_TOLD or is_late:
                yield Sentence(time, "has ended" if is_late else str(state))
            continue
        for part in in_state(run, task, number, moment):
            if part.why:
                left = _left(run, task, part, moment)
                yield _part(part, f"{state}, {part.why}{left}", _not_achieved(run, task, part))
            elif state is not State.ENDING:
                last = run.time if part.end is None else nextafter(part.end, 0.0)
                last = min(last, moment) if part.start <= moment else last
                yield _part(part, WATCHING if watches(task, state, last) else str(state))


def _left(run: Run, task: Task, part: Stretch, moment: float) -> str:
    """Of many that it waits for at that moment, how many are not done yet, if some are."""
    moment = min(moment, run.time)
    if len(part.tasks) <= NAMED or not part.start <= moment < (inf if part.end is None else part.end):
        return ""
    left = still_open(run, task, part, moment)
    return f", {left} of them still to come" if left < len(part.tasks) else ""


def _not_achieved(run: Run, task: Task, part: Stretch) -> str:
    """Which of what it waited for failed or was killed instead: who is reaches all moments at once."""
    if part.end is None or (task.killed is not None and task.written("killed") <= part.end):
        return ""
    found: dict[str, dict[str, None]] = {}
    for point in (hold.constraint.before for hold in task.holds):
        other = run.tasks.get(point.task)
        if other is None or other is task or not other.states or not (other.id in part.tasks or str(other) in part.why):
            continue
        ended, how = other.states[-1]
        if how in _IN_VAIN and part.start < ended <= part.end and other.reached.get(point.moment) == ended:
            found.setdefault(_IN_VAIN[how], {})[str(other)] = None
    told = [f"{listed(list(names))} {of_all(how, len(names))}" for how, names in found.items()]
    return f", but {' and '.join(told)}" if told else ""


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
    return Sentence(span.start, text + ending, took, took is None, ending)


def _part(part: Stretch, text: str, ending: str = "") -> Sentence:
    took = None if part.end is None else part.end - part.start
    return Sentence(part.start, text + ending, took, took is None, ending)
