"""What a bar says when it is asked: which message, where, when, for how long. Pure."""

from math import inf

from tca_tools.run.past import Past
from tca_tools.run.records import Claim, Handling, Queueing, Raised, Task, Wait
from tca_tools.why.coping import failing, told_to
from tca_tools.why.stretches import Stretch
from tca_tools.why.whereabouts import for_whom
from tca_wire.text.facts_in_words import by_whom, place, raised_by
from tca_wire.vocabulary import Outcome

NEWLINE = "\n"


def handled(past: Past, handling: Handling) -> str:
    """``take steps {2} handled by gait planner from 0.700 s to 1.400 s, 0.700 s``."""
    where = place(handling.module, handling.resource)
    title = f"{_described(past, handling)} handled by {where} {_span(past, handling.start, handling.end)}"
    if handling.outcome and handling.outcome is not Outcome.DONE:
        title += f": {handling.outcome}"
    if handling.outcome is Outcome.FAILED:
        told = told_to(past, failing(past, handling), handling.end or past.time)
        title += f", {told}" if told else ""
    return title


def raised(past: Past, task: Task, failure: Raised) -> str:
    """``move {7} failed at 2.000 s: timeout: end handling not reached within 1 s``."""
    told = told_to(past, task, failure.time)
    title = f"{task} failed at {failure.time:.3f} s: {failure.text.partition(NEWLINE)[0]}{raised_by(failure.by)}"
    return title + (f", {told}" if told else "")


def handler_waits(past: Past, handling: Handling, wait: Wait) -> str:
    """``take steps {2} waits for elevation map {5} from ...``."""
    return f"{_described(past, handling)} {_waits_for(past, wait)}"


def module_waits(past: Past, module: str, wait: Wait) -> str:
    """``user interface waits for traverse arc {1} from ...``."""
    return f"{module} {_waits_for(past, wait)}"


def queued(past: Past, queueing: Queueing) -> str:
    """``take steps {2} queued for gait planner from ...``."""
    where = place(queueing.module, queueing.resource) or "a handler"
    return f"{past.describe(queueing.message_id)} queued for {where} {_span(past, queueing.start, queueing.end)}"


def suspended(past: Past, task: Task, start: float, end: float | None) -> str:
    """``take steps {2} suspended by user from ...``."""
    there = (one for one in task.suspensions if one.start <= start < (inf if one.end is None else one.end))
    by = next((by_whom(one.by) for one in there), "")
    return f"{task} suspended{by} {_span(past, start, end)}"


def held_back(past: Past, task: Task, part: Stretch) -> str:
    """``take steps {3} held until take steps {2} is achieved from ...``."""
    return f"{task} held{part.why and f' {part.why}'} {_span(past, part.start, part.end)}"


def why_held(task: Task, part: Stretch, *, is_named: bool) -> str:
    """``take steps {3}: until take steps {2} is achieved``; or without the name."""
    why = part.why or "held"
    return f"{task}: {why}" if is_named else why


def held(past: Past, claim: Claim) -> str:
    """``controller locked by scanner from ...``."""
    where, how = place(claim.module, claim.resource), "reserved" if claim.is_reserved else "locked"
    start = claim.start if claim.granted is None else claim.granted
    why = f": {claim.ended}" if claim.ended else ""
    return f"{where} {how} by {claim.sender}{for_whom(past, claim, claim.start)} {_span(past, start, claim.end)}{why}"


def awaited_name(past: Past, wait: Wait) -> str:
    """The name of what is waited for: of a message, or what kind of claim it is."""
    claim = past.claims.get(wait.awaited)
    if claim is None:
        return past.name(wait.awaited)
    return "reservation" if claim.is_reserved else "lock"


def _described(past: Past, handling: Handling) -> str:
    if handling.direct_from:
        return f"{handling.name}, directly from {handling.direct_from},"
    return past.describe(handling.message_id)


def _waits_for(past: Past, wait: Wait) -> str:
    return f"waits for {past.describe(wait.awaited)} {_span(past, wait.start, wait.end)}"


def _span(past: Past, start: float, end: float | None) -> str:
    until = past.time if end is None else end
    return f"from {start:.3f} s" + (" on" if end is None else f" to {end:.3f} s") + f", {until - start:.3f} s"
