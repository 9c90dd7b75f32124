"""Rules of failures, exception handlers, kills, suspensions and retries."""

from collections.abc import Iterator

from tca_tools.check.missions import check_recovered
from tca_tools.check.records import Hold, MessageRecord
from tca_tools.check.rules import (
    CAUGHT,
    HANDLER,
    KILLED,
    QUEUED,
    RECOVERED,
    REPLACED,
    RESOLVED,
    SUSPENDED,
)
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.messages.failures import NOT_BY_CHOICE
from tca_wire.points import ROOT, START_HANDLING, STARTS
from tca_wire.vocabulary import Role

OWN, BESIDE = 0, -1
"""Two kinds of new searches for an exception handler: after a failure of the task's own handler,
and after a failure raised from outside that handler.
"""


def failed(world: JournalWorld, task: MessageRecord, fact: facts.Failed) -> None:
    """Apply a failure of a task that has not ended: the search for an exception handler starts."""
    if not fact.is_beside and (task.is_killed or task.is_retry_due):
        task.has_returned = task.is_killed
        return
    task.failure, task.has_returned = fact.failure, task.has_returned and fact.is_beside
    start_search(world, task, BESIDE if fact.is_beside else OWN)


def start_search(world: JournalWorld, task: MessageRecord, after: int) -> None:
    """Start the search for an exception handler, which must end with the same event.

    Args:
        world: The world at the event.
        task: The failed task.
        after: The exception handler that did not decide; OWN or BESIDE for a new failure.
    """
    task.searches.append(after)
    world.later.append(lambda: _check_search_ended(world, task))


def _check_search_ended(world: JournalWorld, task: MessageRecord) -> None:
    if task.searches and not task.is_killed:
        world.report(
            CAUGHT,
            task,
            f"failed ({task.failure}), but that was neither caught nor declared unhandled",
        )
    task.searches.clear()


def _pop_search(world: JournalWorld, task: MessageRecord, what: str) -> int:
    """End the oldest search of a task, and return it."""
    if not task.searches:
        if not task.is_incomplete:
            world.report(CAUGHT, task, f"{what}, but nothing failed")
        return BESIDE
    return task.searches.pop(0)


def _end_search(task: MessageRecord, after: int) -> None:
    """End a task's handling with its search, unless another exception handler decides on it."""
    if after == OWN or (after > 0 and task.deciding == after):
        task.deciding, task.has_returned = 0, True


def caught(world: JournalWorld, task: MessageRecord, fact: facts.Caught) -> None:
    """Apply the call of an exception handler."""
    handler = world.task(fact.handler, "was called as exception handler")
    if handler is None:
        return
    if fact.attachment:
        _pop_search(world, task, f"was caught by {handler}")
    else:  # the fallback of a retry policy has resolved the failure, unless it fails
        if handler.message != task.fallback and not task.is_incomplete:
            due = f"its policy's fallback is {task.fallback}" if task.fallback else "none was due"
            world.report(REPLACED, task, f"was replaced by {handler}, but {due}")
        task.is_retry_due, task.fallback = False, ""
        handler.is_fallback = handler.has_resolved = True
    if not fact.is_beside:
        task.deciding = handler.id
    task.recovering = (*task.recovering, handler.id)
    if handler.role is not Role.EXCEPTION or handler.about != task.id:
        world.report(HANDLER, handler, f"was called for {task}, but was made for another task")
    for wrong in _call_errors(world, task, handler, fact):
        world.report(HANDLER, handler, wrong)


def _call_errors(
    world: JournalWorld, task: MessageRecord, handler: MessageRecord, fact: facts.Caught
) -> Iterator[str]:
    """Yield the errors in a call of an exception handler, according to its attachment."""
    attached = world.attached.get(fact.attachment)
    if attached is None:
        if world.is_whole and fact.attachment:
            yield f"was called by attachment {{{fact.attachment}}}, which does not exist"
        return
    at = next((one for one in _lineage(task) if one.id == fact.at), None)
    name = world.name(fact.at) if fact.at else "the root"
    if at is None and fact.at != ROOT:
        if not task.is_orphan:
            yield f"was called at {name}, which is not above {task}"
        return
    is_here = attached.task == fact.at
    if attached.message:
        is_here = at is not None and at.message == attached.message
    if not is_here or handler.message != attached.handler:
        whose = attached.message or world.name(attached.task)
        yield f"was called at {name}, but {attached.handler} is attached to {whose}"
    calls = at.invocations if at is not None else world.invocations_at_root
    calls[fact.attachment] = number = calls.get(fact.attachment, 0) + 1
    if 0 < attached.maximum < number:
        yield f"is call {number} at {name}, but the maximum is {attached.maximum}"


def _lineage(task: MessageRecord) -> Iterator[MessageRecord]:
    one: MessageRecord | None = task
    while one is not None:
        yield one
        one = one.parent


def unhandled(world: JournalWorld, task: MessageRecord, fact: facts.Unhandled) -> None:
    """Apply that no exception handler was found.

    The top-level task must be killed, or instead the exception handler that could not decide.
    """
    after = _pop_search(world, task, "was unhandled")
    _end_search(task, after)
    if _check_undecided(world, task, fact, is_new=after <= 0):
        return
    *_, top = _lineage(task)
    top.failure = top.failure or task.failure
    world.touched[top] = None
    what = f"was not killed, though the failure of {task} was not handled"
    world.expect(lambda: top.is_killed or top.is_orphan, CAUGHT, top, what)


def _check_undecided(
    world: JournalWorld, task: MessageRecord, fact: facts.Unhandled, *, is_new: bool
) -> bool:
    """Check whether an unhandled failure ends an exception handler, not the top-level task.

    If so, it must end the nearest exception handler. If no handler raises a failure of this name by
    choice, a new failure under an exception handler must end one. Returns whether one ends.
    """
    nearest = next((one for one in _lineage(task) if one.role is Role.EXCEPTION), None)
    if fact.undecided:
        if nearest is not None and nearest.id != fact.undecided:
            what = f"was left undecided by {world.name(fact.undecided)}, but {nearest} is nearer"
            world.report(CAUGHT, task, what)
        handler = world.item(fact.undecided, "was declared undecided")
        if handler is not None:
            what = f"was not killed, though it could not decide about the failure of {task}"
            world.expect(lambda: handler.is_killed or handler.is_incomplete, CAUGHT, handler, what)
    elif is_new and nearest is not None and task.failure in NOT_BY_CHOICE:
        what = (
            f"failed ({task.failure}), not by choice, but {nearest}, which could not decide, "
            "was not passed over"
        )
        world.report(CAUGHT, task, what)
    return bool(fact.undecided)


def reissued(world: JournalWorld, handler: MessageRecord, _: facts.Reissued) -> None:
    """Apply that an exception handler passed on the failure for which it was called."""
    _check_is_handler(world, handler, "reissued")
    had_decided, handler.is_void, handler.has_returned = handler.is_void, True, True
    if handler.parent is not None:
        _stop_recovering(world, handler.parent, handler.id)
        if not (handler.parent.is_killed or had_decided):
            start_search(world, handler.parent, handler.id)


def resolved(world: JournalWorld, handler: MessageRecord, _: facts.Resolved) -> None:
    """Apply that an exception handler resolved the failure for which it was called."""
    _check_is_handler(world, handler, "resolved")
    handler.has_resolved = True


def _check_is_handler(world: JournalWorld, handler: MessageRecord, what: str) -> None:
    if handler.role is not Role.EXCEPTION and not handler.is_incomplete:
        world.report(HANDLER, handler, f"{what} a failure, but is not an exception handler")


def handler_ended(world: JournalWorld, handler: MessageRecord) -> None:
    """Apply that an exception handler has ended.

    With the same event the failed task must recover, or the failure must be passed on.
    """
    failing = handler.parent
    if failing is None:
        return
    _stop_recovering(world, failing, handler.id)
    if failing.is_killed:
        return
    failing.ended_handlers.append(handler)
    world.later.append(lambda: _check_recovered(world, failing))


def _stop_recovering(world: JournalWorld, failing: MessageRecord, handler: int) -> None:
    """Record that an exception handler no longer works on a failure."""
    failing.recovering = tuple(one for one in failing.recovering if one != handler)
    world.touched[failing] = None


def _check_recovered(world: JournalWorld, failing: MessageRecord) -> None:
    if failing.ended_handlers and not failing.is_killed:
        handler = failing.ended_handlers[0]
        what = f"neither recovered nor passed its failure on when {handler} had ended"
        world.report(RECOVERED, failing, what)
    failing.ended_handlers.clear()


def recovered(world: JournalWorld, task: MessageRecord, _: facts.Recovered) -> None:
    """Apply that a failure was dealt with; the task may have ended with its exception handler."""
    check_recovered(world, task)
    if not task.ended_handlers and not task.is_incomplete:
        world.report(RECOVERED, task, "recovered, but none of its exception handlers has ended")
    if handler := _pop_ended(task):
        if not (handler.has_resolved or handler.is_incomplete):
            what = f"recovered, but {handler} neither resolved its failure nor retried it"
            world.report(RESOLVED, task, what)
        if task.deciding == handler.id:
            task.deciding, task.has_returned = 0, True
    task.failure, task.is_resolved = "", True


def not_resolved(world: JournalWorld, task: MessageRecord, fact: facts.NotResolved) -> None:
    """Apply that an exception handler ended without a decision: the failure is passed on."""
    if handler := _pop_ended(task):
        if handler.has_resolved:
            world.report(RESOLVED, task, f"passed its failure on, though {handler} has resolved it")
        start_search(world, task, int(fact.handler))


def _pop_ended(task: MessageRecord) -> MessageRecord | None:
    return task.ended_handlers.pop(0) if task.ended_handlers else None


def attached(world: JournalWorld, fact: facts.Attached) -> None:
    """Apply the attachment of an exception handler."""
    world.new_number(fact.id, "attachment")
    if fact.task != ROOT:
        world.task(fact.task, "got an exception handler")
    declared = world.declared.get(fact.handler)
    if declared is not None and not declared.message_class.handles_failures:
        what = f"{declared.message_class} {fact.handler} was attached as exception handler"
        world.report(HANDLER, 0, what)
    world.attached[fact.id] = fact


def removed(world: JournalWorld, fact: facts.Removed) -> None:
    """Apply the removal of an exception handler or wiretap."""
    tap = world.taps.pop(fact.id, None)
    if tap is not None:
        world.taps_before.get(tap.message, {}).pop(fact.id, None)
    elif world.attached.pop(fact.id, None) is None and world.is_whole:
        what = f"{{{fact.id}}} was removed, but is not an exception handler or wiretap"
        world.report(HANDLER, 0, what)


# --- kills, suspension and retries ----------------------------------------------------------------


def killed(world: JournalWorld, item: MessageRecord, _: facts.Killed) -> None:
    """Apply the kill of a task."""
    if item.is_killed:
        world.report(KILLED, item, "was killed a second time")
    if any(after <= 0 for after in item.searches):
        what = f"failed ({item.failure}) and was killed, but neither caught nor declared unhandled"
        world.report(CAUGHT, item, what)
    item.is_killed, item.is_suspended, item.has_returned = True, False, item.place is None
    item.never_began = STARTS & ~item.reached
    world.later.append(lambda: check_below(world, item))
    failing = item.parent if item.role is Role.EXCEPTION and not item.is_void else None
    if failing is None:
        return
    item.is_void = True
    _stop_recovering(world, failing, item.id)
    # A killed exception handler has not decided, so the search continues
    failing.searches.append(item.id)
    what = "was killed, but no other exception handler was searched for its failure"
    world.expect(lambda: item.id not in failing.searches or failing.is_killed, KILLED, item, what)


def check_below(world: JournalWorld, item: MessageRecord) -> None:
    """Check the children of a killed task: only safety tasks and exception handlers survive."""
    if item.waits_at is not None:
        world.report(QUEUED, item, "was killed, but waits for a handler")
    for child in item.children.values():
        if not child.is_killed and not child.role.survives and not child.is_over:
            world.report(KILLED, child, f"was not killed with {item}, under which it is")


def suspended(world: JournalWorld, item: MessageRecord, fact: facts.SuspendedOrResumed) -> None:
    """Apply the suspension or resume of a task with its descendants."""
    below, is_new = [item], False
    for one in below:  # the list grows during the loop
        if one.is_suspended is not fact.is_suspended:
            one.is_suspended, is_new = fact.is_suspended, True
            world.touched[one] = None
        below += one.children.values()
    if not is_new and not (item.is_killed or item.is_orphan):
        how = "suspended" if fact.is_suspended else "resumed"
        world.report(SUSPENDED, item, f"was {how} already")


def retried(world: JournalWorld, fact: facts.Retried) -> None:
    """Apply a retry."""
    asking = world.known(world.asked_by)
    if asking is not None and asking.role is Role.EXCEPTION:
        asking.has_resolved = True
    if fact.failed and (failing := world.task(fact.failed, "failed and was retried")) is not None:
        after = _pop_search(world, failing, "was retried by a policy")
        if fact.failed != fact.task:
            _end_search(failing, after)
    if (item := world.task(fact.task, "was retried")) is None:
        return
    if fact.pause is not None:
        item.holds.append(Hold(fact.pause, None, fact.pause.delay))
    if item.is_killed:
        world.report(KILLED, item, "was retried after it was killed")
    item.failure, item.body, item.is_resolved = "", fact.body or item.body, False
    item.has_resolved, item.fallback = item.is_fallback, fact.fallback
    item.attempts += item.is_begun
    for child in item.children.values():  # its exception handlers no longer decide
        child.is_void = child.is_void or child.role is Role.EXCEPTION
    item.is_retried = True
    item.taps_passed.clear()
    world.flagged.append(item)
    if item.reached & START_HANDLING:
        item.is_retry_due, item.has_returned, item.deciding = True, False, 0
        world.later.append(lambda: _check_retried(world, item))


def _check_retried(world: JournalWorld, item: MessageRecord) -> None:
    """Check that all children of a retried task are killed, except foreign monitors."""
    for child in item.children.values():
        if item.is_retry_due and not (child.is_killed or child.role or child.is_foreign_monitor):
            world.report(
                KILLED, child, f"was not killed when {item}, under which it is, was retried"
            )
