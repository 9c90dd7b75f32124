"""Failures and their exception handlers; kills, suspension and retries, and what they do to all
under a task.
"""

from collections.abc import Iterator

from tca_tools.check.missions import check_recovered
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import CAUGHT, HANDLER, KILLED, QUEUED, RECOVERED, RESOLVED, SUSPENDED
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.messages.failures import NOT_BY_CHOICE
from tca_wire.points import ROOT, START_HANDLING, STARTS
from tca_wire.vocabulary import Role

OWN, BESIDE = (
    0,
    -1,
)  # searches for an exception handler that begin anew: of the task's handler, or raised beside it


def failed(world: JournalWorld, task: MessageRecord, fact: facts.Failed) -> None:
    """A failure is raised on a task that has not ended: the search for an exception handler
    begins.
    """
    if not fact.is_beside and (task.is_killed or task.again):
        task.returned = task.is_killed
        return
    task.failure, task.returned = fact.failure, task.returned and fact.is_beside
    search(world, task, BESIDE if fact.is_beside else OWN)


def search(world: JournalWorld, task: MessageRecord, after: int) -> None:
    """Expect the search to find somebody with the same event."""
    task.searches.append(after)
    world.later.append(lambda: _check_found(world, task))


def _check_found(world: JournalWorld, task: MessageRecord) -> None:
    if task.searches and not task.is_killed:
        world.broken(
            CAUGHT,
            task,
            f"failed ({task.failure}), and that was neither caught nor called unhandled",
        )
    task.searches.clear()


def _found(world: JournalWorld, task: MessageRecord, what: str) -> int:
    """The search that ends now."""
    if not task.searches:
        if not task.is_stranger:
            world.broken(CAUGHT, task, f"{what}, and nothing failed")
        return BESIDE
    return task.searches.pop(0)


def caught(world: JournalWorld, task: MessageRecord, fact: facts.Caught) -> None:
    """An exception handler is called."""
    handler = world.task(fact.handler, "was called as exception handler")
    if handler is None:
        return
    _found(world, task, f"was caught by {handler}")
    if not fact.is_beside:
        task.deciding = handler.id
    task.recovering = (*task.recovering, handler.id)
    if handler.role is not Role.EXCEPTION or handler.about != task.id:
        world.broken(HANDLER, handler, f"deals with {task}, and was not made for that")
    for wrong in _miscalled(world, task, handler, fact):
        world.broken(HANDLER, handler, wrong)


def _miscalled(
    world: JournalWorld, task: MessageRecord, handler: MessageRecord, fact: facts.Caught
) -> Iterator[str]:
    """What is wrong with a call of an exception handler, by its attachment."""
    attached = world.attached.get(fact.attachment)
    if attached is None:
        if world.is_whole:
            yield f"was called, and attachment {{{fact.attachment}}} is not there"
        return
    at = next((one for one in _lineage(task) if one.id == fact.at), None)
    name = world.name(fact.at) if fact.at else "the root"
    if at is None and fact.at != ROOT:
        if not task.is_orphan:
            yield f"was called at {name}, which is not above {task}"
        return
    is_here = (
        at is not None and at.message == attached.message
        if attached.message
        else attached.task == fact.at
    )
    if not is_here or handler.message != attached.handler:
        whose = attached.message or world.name(attached.task)
        yield f"was called at {name}: {attached.handler} is attached to {whose}"
    calls = at.invocations if at is not None else world.invocations_at_root
    calls[fact.attachment] = number = calls.get(fact.attachment, 0) + 1
    if 0 < attached.maximum < number:
        yield f"is call {number} at {name}, and {attached.maximum} are allowed"


def _lineage(task: MessageRecord) -> Iterator[MessageRecord]:
    one: MessageRecord | None = task
    while one is not None:
        yield one
        one = one.parent


def unhandled(world: JournalWorld, task: MessageRecord, fact: facts.Unhandled) -> None:
    """No handler is left: the top-level task is killed, or the exception handler that could not
    decide.
    """
    after = _found(world, task, "was unhandled")
    if after == OWN or (after > 0 and task.deciding == after):
        task.deciding, task.returned = 0, True
    if _must_pass_over(world, task, fact, is_new=after <= 0):
        return
    *_, top = _lineage(task)
    top.failure = top.failure or task.failure
    world.touched[top] = None
    what = f"lives, and nobody dealt with the failure of {task}"
    world.expect(lambda: top.is_killed or top.is_orphan, CAUGHT, top, what)


def _must_pass_over(
    world: JournalWorld, task: MessageRecord, fact: facts.Unhandled, *, is_new: bool
) -> bool:
    """Whether it is an exception handler that ends, and not the top-level task. It is the nearest;
    it must be one where the failure *is_new*, so that its name is known.
    """
    nearest = next((one for one in _lineage(task) if one.role is Role.EXCEPTION), None)
    if fact.undecided:
        if nearest is not None and nearest.id != fact.undecided:
            what = f"is not decided for by {world.name(fact.undecided)}, it is said, and {nearest} is nearer"
            world.broken(CAUGHT, task, what)
        handler = world.item(fact.undecided, "was said not to have decided")
        if handler is not None:
            what = f"lives, and could not decide for the failure of {task}"
            world.expect(lambda: handler.is_killed or handler.is_stranger, CAUGHT, handler, what)
    elif is_new and nearest is not None and task.failure in NOT_BY_CHOICE:
        what = f"failed ({task.failure}), not by choice: {nearest} could not decide, and was not passed over"
        world.broken(CAUGHT, task, what)
    return bool(fact.undecided)


def reissued(world: JournalWorld, handler: MessageRecord, _: facts.Reissued) -> None:
    """An exception handler could not deal with its failure."""
    _must_deal(world, handler, "reissued")
    had_decided, handler.is_void, handler.returned = handler.is_void, True, True
    if handler.parent is not None:
        _deals_no_more(world, handler.parent, handler.id)
        if not (handler.parent.is_killed or had_decided):
            search(world, handler.parent, handler.id)


def resolved(world: JournalWorld, handler: MessageRecord, _: facts.Resolved) -> None:
    """An exception handler says that it has dealt with its failure."""
    _must_deal(world, handler, "resolved")
    handler.has_resolved = True


def _must_deal(world: JournalWorld, handler: MessageRecord, what: str) -> None:
    if handler.role is not Role.EXCEPTION and not handler.is_stranger:
        world.broken(HANDLER, handler, f"{what} a failure, and deals with none")


def handler_ended(world: JournalWorld, handler: MessageRecord) -> None:
    """An exception handler has ended: what it has not dealt with goes on up the tree."""
    failing = handler.parent
    if failing is None:
        return
    _deals_no_more(world, failing, handler.id)
    if failing.is_killed:
        return
    failing.ended_handlers.append(handler)
    world.later.append(lambda: _check_recovered(world, failing))


def _deals_no_more(world: JournalWorld, failing: MessageRecord, handler: int) -> None:
    """The exception handler no longer works on that failure."""
    failing.recovering = tuple(one for one in failing.recovering if one != handler)
    world.touched[failing] = None


def _check_recovered(world: JournalWorld, failing: MessageRecord) -> None:
    if failing.ended_handlers and not failing.is_killed:
        handler = failing.ended_handlers[0]
        world.broken(
            RECOVERED, failing, f"neither recovered nor failed on when {handler} had ended"
        )
    failing.ended_handlers.clear()


def recovered(world: JournalWorld, task: MessageRecord, _: facts.Recovered) -> None:
    """A failure has been dealt with. The task may have ended with its exception handler."""
    check_recovered(world, task)
    if not task.ended_handlers and not task.is_stranger:
        world.broken(RECOVERED, task, "recovered, and no exception handler of it has ended")
    if handler := _pop_ended(task):
        if not (handler.has_resolved or handler.is_stranger):
            world.broken(
                RESOLVED,
                task,
                f"recovered, and {handler} neither resolved its failure nor retried it",
            )
        if task.deciding == handler.id:
            task.deciding, task.returned = 0, True
    task.failure, task.is_resolved = "", True


def not_resolved(world: JournalWorld, task: MessageRecord, fact: facts.NotResolved) -> None:
    """An exception handler has ended, and its failure goes on up the tree."""
    if handler := _pop_ended(task):
        if handler.has_resolved:
            world.broken(RESOLVED, task, f"failed on, and {handler} has resolved its failure")
        search(world, task, int(fact.handler))


def _pop_ended(task: MessageRecord) -> MessageRecord | None:
    return task.ended_handlers.pop(0) if task.ended_handlers else None


def attached(world: JournalWorld, fact: facts.Attached) -> None:
    """An exception handler is attached."""
    world.new_number(fact.id, "attachment")
    if fact.task != ROOT:
        world.task(fact.task, "got an exception handler")
    declared = world.declared.get(fact.handler)
    if declared is not None and not declared.message_class.handles_failures:
        what = f"{declared.message_class} {fact.handler} was attached as exception handler"
        world.broken(HANDLER, 0, what)
    world.attached[fact.id] = fact


def removed(world: JournalWorld, fact: facts.Removed) -> None:
    """An exception handler or wiretap is taken away."""
    tap = world.taps.pop(fact.id, None)
    if tap is not None:
        world.taps_before.get(tap.message, {}).pop(fact.id, None)
    elif world.attached.pop(fact.id, None) is None and world.is_whole:
        world.broken(
            HANDLER, 0, f"{{{fact.id}}} was removed, and is no exception handler or wiretap"
        )


# --- kills, suspension and retries ----------------------------------------------------------------


def killed(world: JournalWorld, item: MessageRecord, _: facts.Killed) -> None:
    """A task is killed."""
    if item.is_killed:
        world.broken(KILLED, item, "was killed a second time")
    if any(after <= 0 for after in item.searches):
        what = (
            f"failed ({item.failure}) and was killed: that was neither caught nor called unhandled"
        )
        world.broken(CAUGHT, item, what)
    item.is_killed, item.is_suspended, item.returned = True, False, item.place is None
    item.never_began = STARTS & ~item.reached
    world.later.append(lambda: check_below(world, item))
    failing = item.parent if item.role is Role.EXCEPTION and not item.is_void else None
    if failing is None:
        return
    item.is_void = True
    _deals_no_more(world, failing, item.id)
    failing.searches.append(
        item.id
    )  # a killed exception handler has decided nothing: the search goes on
    what = "was killed, and nobody else was asked to deal with its failure"
    world.expect(lambda: item.id not in failing.searches or failing.is_killed, KILLED, item, what)


def check_below(world: JournalWorld, item: MessageRecord) -> None:
    """Check what is under a killed task: only safety tasks and exception handlers go on."""
    if item.waits_at is not None:
        world.broken(QUEUED, item, "is killed, and waits for a handler")
    for child in item.children.values():
        if not child.is_killed and not child.role.survives and not child.is_over:
            world.broken(KILLED, child, f"lives, and {item} above it is killed")


def suspended(world: JournalWorld, item: MessageRecord, fact: facts.SuspendedOrResumed) -> None:
    """A task is suspended or resumed, with all under it."""
    below, is_new = [item], False
    for one in below:  # grows while it is walked
        if one.is_suspended is not fact.is_suspended:
            one.is_suspended, is_new = fact.is_suspended, True
            world.touched[one] = None
        below += one.children.values()
    if not is_new and not (item.is_killed or item.is_orphan):
        world.broken(
            SUSPENDED, item, f"was {'suspended' if fact.is_suspended else 'resumed'} already"
        )


def retried(world: JournalWorld, fact: facts.Retried) -> None:
    """A task is to be handled again."""
    asking = world.known(world.asked_by)
    if asking is not None and asking.role is Role.EXCEPTION:
        asking.has_resolved = True
    if (item := world.task(fact.task, "was retried")) is None:
        return
    if item.is_killed:
        world.broken(KILLED, item, "was retried, and it is killed")
    item.failure, item.body, item.is_resolved = "", fact.body or item.body, False
    item.has_resolved = False
    item.attempts += item.is_begun
    for child in item.children.values():  # the failures that they were called for are forgotten
        child.is_void = child.is_void or child.role is Role.EXCEPTION
    item.is_retried = True
    item.passed.clear()
    world.flagged.append(item)
    if item.reached & START_HANDLING:
        item.again, item.returned, item.deciding = True, False, 0
        world.later.append(lambda: _check_retried(world, item))


def _check_retried(world: JournalWorld, item: MessageRecord) -> None:
    """Check that a retried task keeps only the monitors that others put under it."""
    for child in item.children.values():
        if item.again and not (child.is_killed or child.role or child.is_guest):
            world.broken(KILLED, child, f"lives, and {item} above it is retried")
