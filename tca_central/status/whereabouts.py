"""What messages, tasks and handlers wait for, in words: for those who give up, and for ``tca top``. Changes nothing."""

from tca_central.model.registry import Connection, Delivery, MessageType, ModuleResource
from tca_central.model.resources import Claim, Resource
from tca_central.model.task_tree import Task
from tca_central.order import dispatcher
from tca_central.order.holds import is_held
from tca_central.state import Collector, State
from tca_wire.packets.headers import Answer
from tca_wire.points import Moment, describe_moments
from tca_wire.vocabulary import Outcome

_NAMED, _SUMMARY = 20, 200  # of those that did not answer so many are told; of the text of each so many characters
_BEGINNINGS = (int(Moment.START_HANDLING), int(Moment.START_PLANNING), int(Moment.START_ACHIEVING))


def named(delivery: Delivery) -> str:
    """A message as people are told of it: ``'walk' {3}``."""
    return f"'{delivery.message.name}' {{{delivery.id}}}"


def why_unanswered(central: State, query: Delivery) -> str:
    """Why a query has no answer yet; "" if there is nothing to say."""
    if (slot := query.slot) is not None:
        return f"{_place(slot.resource)} had it, and had not answered{_waiting_in(central, slot, query)}"
    return _why_queued(query)


def why_not_reached(central: State, task: Task) -> str:
    """Why a task has not ended yet; "" if there is nothing to say."""
    if (slot := task.slot) is not None:
        return f"{_place(slot.resource)} had it, and had not returned{_waiting_in(central, slot, task)}"
    if task.queues is not None:
        return _why_queued(task)
    if task.suspended:
        return "it was suspended"
    if not task.killed and (at := held_at(task)):
        return f"it was held until {held_by(central, task, at)}"
    child = next(iter((task.children or {}).values()), None)
    if child is None:
        return ""
    more = f" (and {len(task.children or {}) - 1} more)" if len(task.children or {}) > 1 else ""
    return f"{named(child)} under it{more} had not ended"


def end_of(central: State, collector: Collector, number: int) -> tuple[Answer, bytes]:
    """With what a multi-query ends now: done, or where nobody has replied the first failure, and in its text all others
    and who had not answered.
    """
    answer, body = collector.end or (Answer(number), b"")
    text = why_not_replied(central, collector)
    if answer.outcome is Outcome.DONE:
        return Answer(number, text=text), b""
    trace = answer.text.partition("\n")[2]
    return Answer(number, answer.outcome, answer.failure, f"{text}\n{trace}" if trace else text), body


def why_not_replied(central: State, collector: Collector) -> str:
    """Who was asked by a multi-query and has not replied, and why; "" if all have."""
    late = [why_unanswered(central, copy) for copy in collector.pending.values()]
    who = [*collector.failures, *filter(None, late)]
    if not who:
        return ""
    more = [f"and {len(who) - _NAMED} more"] if len(who) > _NAMED else []
    has_replies = collector.end is not None and collector.end[0].outcome is Outcome.DONE
    begin = "" if has_replies else "nobody replied: "
    return begin + "; ".join(who[:_NAMED] + more)


def summary(failure: str, text: str) -> str:
    """A failure and the first line of its text."""
    first = text.partition("\n")[0][:_SUMMARY]
    return f"{failure}: {first}" if first else failure


def why_full(message: MessageType, *targets: ModuleResource) -> str:
    """Why no more messages of a type (for these *targets* only) are let into a queue: of which resource, and what fills
    it; for queries, informs and broadcasts that are refused or dropped.
    """
    if not targets and not message.handlers:
        first, number = next(iter(message.waiting.values()), None), len(message.waiting)
        told, end = [f"nobody handles '{message.name}', and {number} wait already"], "no more are let in"
    else:
        resource, *others = targets or tuple(message.candidates())
        first, number, end = resource.first_message(), resource.waiting, "only tasks are let in"
        told = [f"{number} messages wait for {_place(resource)} already", kept_busy(resource, is_now=True)]
        told += [f"and {len(others)} more that handle '{message.name}' are as full"] if others else []
    told += [f"{named(first)} first in line"] if first is not None else []
    return f"{', '.join(told)}; from {dispatcher.QUEUE_LIMIT} on {end}"


def _why_queued(delivery: Delivery) -> str:
    if delivery.queues is None:
        return ""
    if not delivery.queues:
        return "nobody handled it"
    resource, *others = delivery.queues
    more = f" (or {len(others)} more)" if others else ""
    claim = _ahead(resource, delivery)
    return f"it waited for {_place(resource)}{more}, {_wanted(claim) if claim else kept_busy(resource)}"


def _ahead(resource: ModuleResource, delivery: Delivery) -> Claim[Connection] | None:
    """The claim that is before a message in line, where nobody has the resource."""
    if resource.held_by is not None:
        return None
    key = -delivery.priority, delivery.arrival
    ahead = [claim for claim in resource.claims if (-claim.priority, claim.arrival) < key]
    return min(ahead, key=lambda claim: (-claim.priority, claim.arrival), default=None)


def _wanted(claim: Claim[Connection], *, is_now: bool = False) -> str:
    return f"which module '{claim.slot.module.name}' {'waits' if is_now else 'waited'} to have for itself"


def kept_busy(resource: Resource[Connection, Delivery], *, is_now: bool = False) -> str:
    """What kept others out of a resource, or does now: ``busy with 'plan' {4}``."""
    if (claim := resource.held_by) is not None:
        kind = "reserved" if claim.admits_owner else "locked"
        return f"which module '{claim.slot.module.name}' {'has' if is_now else 'had'} {kind}"
    inside = next((one for slot in resource.slots for one in slot.handling), None)
    if inside is not None:
        taken = sum(bool(slot.handling) for slot in resource.slots) if resource.capacity > 1 else 1
        return f"busy with {named(inside)}" + (f" (and {taken - 1} more)" if taken > 1 else "")
    claim = next(iter(resource.claims), None)
    if claim is not None:
        return _wanted(claim, is_now=is_now)
    return "which is not ready" if is_now else "which was not ready"


def _place(resource: ModuleResource | None) -> str:
    return f"resource '{resource.name}' of '{resource.module}'" if resource is not None else "its handler"


def _waiting_in(central: State, slot: Connection, delivery: Delivery) -> str:
    """What the handler of a delivery waits for itself, if it does."""
    given = slot.handling[delivery]
    waits = (number for each in (slot.waits, slot.pauses) for number, wait in each.items() if wait.since > given)
    number = next(waits, 0)
    return f": it waited for {awaited(central, slot, number)}" if number else ""


def held_at(task: Task) -> int:
    """Which beginning of a task is held (0: none)."""
    return next((moment for moment in _BEGINNINGS if is_held(task, moment)), 0)


def held_by(central: State, task: Task, at: int) -> str:
    """What the beginning of a task waits for."""
    tasks = central.tree.tasks
    entries = ((tasks.get(leader), moment) for held, leader, moment in task.leaders or () if held == at)
    ahead = [(leader, moment) for leader, moment in entries if leader is not None and not leader.reached & moment]
    if not ahead:
        return "the end of a delay"
    leader, moment = ahead[0]
    more = f" (and {len(ahead) - 1} more)" if len(ahead) > 1 else ""
    return f"{describe_moments(Moment(moment))[0]} of {named(leader)}{more}"


def awaited(central: State, connection: Connection, number: int) -> str:
    """What a connection that blocks waits for."""
    due = connection.outstanding.get(number)
    if isinstance(due, Delivery):
        return f"the reply to {named(due)}"
    if isinstance(due, Collector):
        copy = next(iter(due.pending.values()), None)
        return f"the replies to '{copy.message.name}' {{{due.id}}}" if copy is not None else "an answer"
    if isinstance(due, Claim):
        return f"resource '{due.resource.name}' of '{due.resource.module}'"
    if messages := getattr(due, "messages", ()):
        return f"modules that handle {', '.join(repr(message.name) for message in messages)}"
    task = central.tree.tasks.get(getattr(due, "task_id", 0))
    if task is None:
        return "an answer"
    return f"{', '.join(describe_moments(Moment(getattr(due, 'moment', 0))))} of {named(task)}"
