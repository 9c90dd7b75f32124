"""What messages, tasks and handlers wait for, in words: for those who give up, and for ``tca top``. Changes nothing."""

from tca_central.holds import is_held
from tca_central.registry import Connection, Delivery, ModuleResource
from tca_central.resources import Claim, Resource
from tca_central.state import Collector, State
from tca_central.task_tree import Task
from tca_wire.points import Moment, describe_moments

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


def _why_queued(delivery: Delivery) -> str:
    if delivery.queues is None:
        return ""
    if not delivery.queues:
        return "nobody handled it"
    resource, *others = delivery.queues
    more = f" (or {len(others)} more)" if others else ""
    return f"it waited for {_place(resource)}{more}, {kept_busy(resource)}"


def kept_busy(resource: Resource[Connection, Delivery]) -> str:
    """What keeps others out of a resource: ``busy with 'plan' {4}``."""
    if (claim := resource.held_by) is not None:
        kind = "reserved" if claim.admits_owner else "locked"
        return f"which module '{claim.slot.module.name}' had {kind}"
    inside = next((one for slot in resource.slots for one in slot.handling), None)
    if inside is not None:
        taken = sum(bool(slot.handling) for slot in resource.slots) if resource.capacity > 1 else 1
        return f"busy with {named(inside)}" + (f" (and {taken - 1} more)" if taken > 1 else "")
    claim = next(iter(resource.claims), None)
    if claim is not None:
        return f"which module '{claim.slot.module.name}' waited to have for itself"
    return "which was not ready"


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
