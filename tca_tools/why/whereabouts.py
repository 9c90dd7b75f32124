"""Where something is that is waited for: in which queue and behind what, who handles it, who has not answered.

Asks what was known; changes nothing.
"""

from collections.abc import Sequence
from math import nextafter
from typing import NamedTuple

from tca_tools.run.at_time import RunAt, TaskAt
from tca_tools.run.records import Claim, HandlerWait, Handling, Message, Queueing
from tca_tools.run.whole_run import Run
from tca_tools.terminal import cut
from tca_wire.text.bodies import data_text
from tca_wire.text.facts_in_words import GAVE_UP, place
from tca_wire.vocabulary import Outcome

NAMED = 3
"""How many of several are named."""
_LONGEST_ANSWER = 40
"""Columns of an answer that is told among others."""


def kept_out(at: RunAt, module: str, resource: str, message: Message | TaskAt) -> Claim | list[Handling]:
    """What keeps a message that is queued out of a resource: the lock in force, or the one that is next in line, though
    there may be room; else what is handled there. Higher priorities, which the journal does not tell, go unnoticed.
    """
    held_by = at.held_by(module, resource)
    if held_by is None:
        line = _Line.at(at, module, resource)
        if line.wanted and (line.has_room or line.inside or line.wanted[0].start < _came(at.run, message.id)):
            return line.wanted[0]
    elif not (held_by.is_reserved and held_by.sender == _sent_by(at.run, message.id)):
        return held_by
    return [run for run in at.running(module, resource) if run.message_id != message.id]


def ahead_of_claim(at: RunAt, claim: Claim) -> tuple[list[Handling], Claim | None]:
    """What a lock that nobody else has yet waits for: all that is handled there but whoever wants it, and what is ahead
    of it in line.
    """
    line = _Line.at(at, claim.module, claim.resource)
    before = next((index for index, one in enumerate(line.wanted) if one is claim), 0)
    own: set[int] = set()
    run = claim.by
    while run is not None:  # and what it was called back by waits in the same slot
        own.add(id(run))
        run = line.called_back_by.get(id(run))
    runs = at.inside(claim.module, claim.resource)
    return [run for run in runs if id(run) not in own], line.wanted[before - 1] if before else None


class _Line(NamedTuple):
    """Who waits to have a resource for himself."""

    wanted: list[Claim]
    """Locks and reservations: those of who is in the resource first, then as they came."""
    inside: int
    """Those of who is in it: nobody gets in before he is out."""
    has_room: bool
    """Whether a slot is free."""
    called_back_by: dict[int, Handling]
    """For each run that takes no slot, by its identity, the one within whose wait for it it is handled."""

    @classmethod
    def at(cls, at: RunAt, module: str, resource: str) -> "_Line":
        """That of a resource."""
        key = (cls, module, resource)
        if (known := at.memo.get(key)) is None:
            known = at.memo[key] = cls._of(at, module, resource)
        found: _Line = known
        return found

    @classmethod
    def _of(cls, at: RunAt, module: str, resource: str) -> "_Line":
        runs, wanted = at.running(module, resource), at.wanted(module, resource)
        inside = [one for one in wanted if any(run is one.by for run in runs)]
        others = [one for one in wanted if one not in inside] if inside else wanted
        capacity, taken = at.capacity(module, resource), 0
        called_back_by: dict[int, Handling] = {}
        for run in runs:
            message = at.run.messages.get(run.message_id)
            by = message.by if message else None
            if taken < capacity or not any(one is by for one in runs):
                taken += 1
            elif by is not None:
                called_back_by[id(run)] = by
        return cls([*inside, *others], len(inside), capacity > taken, called_back_by)


def _came(run: Run, number: int) -> float:
    """Since when a message has its place in line: who is handled again keeps it."""
    message = run.messages.get(number)
    if message is None:
        return 0.0
    return min((one[0].start for one in (message.queueings, message.handlings) if one), default=message.received)


def _sent_by(run: Run, number: int) -> str:
    """Who sent a message; of one that central made, who sent what it was made for."""
    while (message := run.messages.get(number)) is not None and message.role and message.about < number:
        number = message.about
    return message.sender if message else ""


def kept_busy(at: RunAt, module: str, resource: str, message: Message | TaskAt) -> str:
    """What keeps a resource from a message: ``which controller has locked while handling walk {3}``."""
    by = kept_out(at, module, resource, message)
    if not by:
        return "" if at.capacity(module, resource) else "which has no handler now"
    if not isinstance(by, Claim):
        return f"busy with {_described(at, by)}"
    does = f"has {_how(by)}" if at.is_granted(by) else _wants(by)
    return f"which {by.sender} {does}{for_whom(at.run, by, at.moment)}"


def _wants(claim: Claim) -> str:
    return f"waits to {'reserve' if claim.is_reserved else 'lock'}"


def claim_and_why(at: RunAt, claim: Claim) -> str:
    """A claim that waits, and for whom: ``lock of legs {8}, but legs is busy with move {4}``."""
    held_by = at.held_by(claim.module, claim.resource)
    if held_by and held_by is not claim:
        return f"{claim}, but {held_by.sender} has {_how(held_by)} it{for_whom(at.run, held_by, at.moment)}"
    inside, first = ahead_of_claim(at, claim)
    busy = f"{place(claim.module, claim.resource)} is busy with {_described(at, inside)}" if inside else ""
    ahead = f"{first.sender} {_wants(first)} it first{for_whom(at.run, first, at.moment)}" if first else ""
    why = ", and ".join(one for one in (busy, ahead) if one)
    return f"{claim}, but {why}" if why else str(claim)


def _described(at: RunAt, runs: list[Handling]) -> str:
    return listed([at.describe(run.message_id) for run in runs])


def for_whom(run: Run, claim: Claim, moment: float) -> str:
    """The message for which a claim was wanted, if that is known: `` while handling walk {3}``."""
    if claim.by is None:
        return ""
    is_over = claim.by.end is not None and claim.by.end <= moment
    return f" {'for' if is_over else 'while handling'} {run.describe(claim.by.message_id)}"


def _how(claim: Claim) -> str:
    return "reserved" if claim.is_reserved else "locked"


def whereabouts(at: RunAt, message_id: int) -> str:
    """Where a query is: ``, which no module handles``; and which modules have not answered a multi-query yet."""
    query = at.run.messages.get(message_id)
    if query is None:
        return ""
    if query.message_class.asks_many:
        missing = not_answered(at, query)
        return missing and f", which {missing}"
    if not query.message_class.asks_one:
        return ""
    if queueing := at.queueing_of(query):
        if not queueing.module:
            return ", which no module handles"
        return f", which is {_queued(at, queueing, query)}"
    run = at.handling_of(query)
    return f", which {place(run.module, run.resource)} handles" if run else ""


def _queued(at: RunAt, queueing: Queueing, query: Message) -> str:
    why = kept_busy(at, queueing.module, queueing.resource, query)
    return f"queued for {place(queueing.module, queueing.resource)}" + (f", {why}" if why else "")


def not_answered(at: RunAt, query: Message, *, is_over: bool = False) -> str:
    """Who has not answered a multi-query: ``arm and legs (queued, busy with walk {3}) have not answered yet (1 of 3
    has)``; "" if all have, or no more answers are wanted. *is_over*: it was given up.
    """
    if query.answered is not None and query.answered <= at.moment:
        return ""
    names = _still_asked(at, query)
    if not names:
        return ""
    answered = sum(run.end is not None and run.end <= at.moment for run in query.handlings)
    rest = f" ({answered} of {answered + len(names)} {_has(answered, is_over)})" if answered else ""
    return f"{_together(names)} {_has(len(names), is_over)} not answered{' yet' * (not is_over)}{rest}"


def _still_asked(at: RunAt, query: Message) -> list[str]:
    """Who has a multi-query, or has it in a queue."""
    runs, queueings = at.copies_of(query)
    names = [place(run.module, run.resource) for run in runs]
    for queueing in queueings:
        why = kept_busy(at, queueing.module, queueing.resource, query)
        names.append(f"{place(queueing.module, queueing.resource)} (queued{why and f', {why}'})")
    return names


def answers_so_far(run: Run, query: Message, given_up: float) -> str:
    """What became of a multi-query that was given up when some had answered: its sender gets these answers. ``its
    sender waits no longer: 1 of 3 answered in time: arm (7); legs had not, head had failed``; "" of others.
    """
    if not query.message_class.asks_many or query.dropped != GAVE_UP:
        return ""
    at = RunAt(run, nextafter(given_up, 0.0))
    late = _still_asked(at, query)
    runs = [handling for handling in query.handlings if handling.end is not None and handling.end <= at.moment]
    answers = [_answer(query, handling) for handling in runs if handling.outcome is Outcome.DONE]
    failed = [place(handling.module, handling.resource) for handling in runs if handling.outcome is not Outcome.DONE]
    others = [f"{_together(some)} had {what}" for some, what in ((late, "not"), (failed, "failed")) if some]
    rest = f"; {', '.join(others)}" if others else ""
    number = f"{len(answers)} of {len(late) + len(runs)}"
    return f"its sender waits no longer: {number} answered in time: {_together(answers)}{rest}" if answers else ""


def _answer(query: Message, run: Handling) -> str:
    """Who answered, and what."""
    data = "" if run.end is None else data_text(query.was("result", run.end))
    return place(run.module, run.resource) + (f" ({cut(data, _LONGEST_ANSWER)})" if data else "")


def _has(number: int, is_over: bool) -> str:
    return "had" if is_over else "has" if number == 1 else "have"


def _together(names: list[str]) -> str:
    """``arm, legs and head``; of many the first, and how many more there are."""
    if len(names) > NAMED or len(names) == 1:
        return listed(names)
    return f"{', '.join(names[:-1])} and {names[-1]}"


def why_in_vain(run: Run, wait: HandlerWait) -> str:
    """Where a query was when its handler waited no longer for the reply: ``legs had it``; "" if it did not give up."""
    query = run.messages.get(wait.awaited)
    if query is None or wait.end is None or query.dropped != GAVE_UP:
        return ""
    at = RunAt(run, nextafter(wait.end, 0.0))
    if query.message_class.asks_many:
        return not_answered(at, query, is_over=True)
    if not query.message_class.asks_one:
        return ""
    if queueing := at.queueing_of(query):
        if not queueing.module:
            return "no module handled it"
        return f"it was {_queued(at, queueing, query)}"
    handling = at.handling_of(query)
    return (
        f"{place(handling.module, handling.resource)} had it, and had not answered"
        if handling
        else "there was no answer yet"
    )


def failure_told(query: Message, moment: float) -> str:
    """With what a query had failed, in a line; "" if it had not. Of a question to many single failures say nothing."""
    failure = query.was("failure", moment) if query.message_class.asks_one else ""
    return str(failure).strip().partition("\n")[0]


def listed(names: Sequence[str], number: int | None = None) -> str:
    """The first of them, and how many more there are: of *number*, if not all names are given."""
    more = (len(names) if number is None else number) - NAMED
    return ", ".join(names[:NAMED]) + (f" and {more} more" if more > 0 else "")
