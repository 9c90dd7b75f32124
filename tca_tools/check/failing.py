"""Failures: which exception handlers are called, what becomes of the failing task, where handlers are attached."""

from collections.abc import Iterator

from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import CAUGHT, HANDLER, NUMBERS, RECOVERED
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.messages.failures import NOT_BY_CHOICE
from tca_wire.points import ROOT
from tca_wire.vocabulary import Role

OWN, BESIDE = 0, -1  # searches for an exception handler that begin anew: of the task's handler, or raised beside it


def failed(world: JournalWorld, task: MessageRecord, fact: facts.Failed) -> None:
    """A failure is raised on a task that has not ended: the search for an exception handler begins."""
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
    if task.searches and not (task.is_killed or task.again):
        world.broken(
            CAUGHT, task.id, f"{task} failed ({task.failure}), and that was neither caught nor called unhandled"
        )
    task.searches.clear()


def _found(world: JournalWorld, task: MessageRecord, what: str) -> int:
    """The search that ends now."""
    if not task.searches:
        if not task.is_stranger:
            world.broken(CAUGHT, task.id, f"{task} {what}, and nothing failed")
        return BESIDE
    return task.searches.pop(0)


def caught(world: JournalWorld, fact: facts.Caught) -> None:
    """An exception handler is called."""
    task = world.task(fact.task, "was caught")
    handler = world.task(fact.handler, "was called as exception handler")
    if task is None or handler is None:
        return
    after = _found(world, task, f"was caught by {handler}")
    if after == OWN or (after > 0 and task.deciding == after):
        task.deciding = handler.id
    task.recovering = (*task.recovering, handler.id)
    if handler.role is not Role.EXCEPTION or handler.about != task.id:
        world.broken(HANDLER, handler.id, f"{handler} deals with {task}, and was not made for that")
    _check_attachment(world, task, handler, fact)


def _check_attachment(world: JournalWorld, task: MessageRecord, handler: MessageRecord, fact: facts.Caught) -> None:
    attached = world.attached.get(fact.attachment)
    if attached is None:
        if world.is_whole:
            world.broken(
                HANDLER, handler.id, f"{handler} was called, and attachment {{{fact.attachment}}} is not there"
            )
        return
    at = next((one for one in _lineage(task) if one.id == fact.at), None)
    name = world.name(fact.at) if fact.at else "the root"
    if at is None and fact.at != ROOT:
        if not task.is_orphan:
            world.broken(HANDLER, handler.id, f"{handler} was called at {name}, which is not above {task}")
        return
    is_here = at is not None and at.message == attached.message if attached.message else attached.task == fact.at
    if not is_here or handler.message != attached.handler:
        whose = attached.message or world.name(attached.task)
        world.broken(HANDLER, handler.id, f"{handler} was called at {name}: {attached.handler} is attached to {whose}")
    calls = at.invocations if at is not None else world.invocations_at_root
    calls[fact.attachment] = calls.get(fact.attachment, 0) + 1
    if 0 < attached.maximum < calls[fact.attachment]:
        number = calls[fact.attachment]
        what = f"{handler} is call {number} at {name}, and {attached.maximum} are allowed"
        world.broken(HANDLER, handler.id, what)


def _lineage(task: MessageRecord) -> Iterator[MessageRecord]:
    one: MessageRecord | None = task
    while one is not None:
        yield one
        one = one.parent


def unhandled(world: JournalWorld, fact: facts.Unhandled) -> None:
    """No handler is left: the top-level task is killed, or the exception handler that could not decide."""
    task = world.task(fact.task, "failed, unhandled,")
    if task is None:
        return
    after = _found(world, task, "was unhandled")
    if after == OWN or (after > 0 and task.deciding == after):
        task.deciding, task.returned = 0, True
    if _must_pass_over(world, task, fact, is_new=after <= 0):
        return
    *_, top = _lineage(task)
    top.failure = top.failure or task.failure
    world.touched[top] = None
    world.later.append(lambda: _check_top(world, task, top))


def _must_pass_over(world: JournalWorld, task: MessageRecord, fact: facts.Unhandled, *, is_new: bool) -> bool:
    """Whether it is an exception handler that ends, and not the top-level task. It is the nearest; it must be one where
    the failure *is_new*, so that its name is known.
    """
    nearest = next((one for one in _lineage(task) if one.role is Role.EXCEPTION), None)
    if fact.undecided:
        if nearest is not None and nearest.id != fact.undecided:
            what = f"{world.name(fact.undecided)} is said not to have decided for {task}, and {nearest} is nearer"
            world.broken(CAUGHT, task.id, what)
        handler = world.item(fact.undecided, "was said not to have decided")
        if handler is not None:
            world.later.append(lambda: _check_ended(world, task, handler))
    elif is_new and nearest is not None and task.failure in NOT_BY_CHOICE:
        what = f"{task} failed ({task.failure}), not by choice: {nearest} could not decide, and was not passed over"
        world.broken(CAUGHT, task.id, what)
    return bool(fact.undecided)


def _check_ended(world: JournalWorld, task: MessageRecord, handler: MessageRecord) -> None:
    if not (handler.is_killed or handler.is_stranger):
        world.broken(CAUGHT, handler.id, f"{handler} lives, and could not decide for the failure of {task}")


def _check_top(world: JournalWorld, task: MessageRecord, top: MessageRecord) -> None:
    if not (top.is_killed or top.is_orphan):
        world.broken(CAUGHT, top.id, f"{top} lives, and nobody dealt with the failure of {task}")


def reissued(world: JournalWorld, fact: facts.Reissued) -> None:
    """An exception handler could not deal with its failure."""
    handler = world.task(fact.handler, "reissued its failure")
    if handler is None:
        return
    if handler.role is not Role.EXCEPTION and not handler.is_stranger:
        world.broken(HANDLER, handler.id, f"{handler} reissued a failure, and deals with none")
    handler.is_void = handler.returned = True
    if handler.parent is not None:
        deals_no_more(world, handler.parent, handler.id)
        if not (handler.parent.is_killed or handler.parent.again):
            search(world, handler.parent, handler.id)


def handler_ended(world: JournalWorld, handler: MessageRecord) -> None:
    """An exception handler has ended: the failure has been dealt with, unless it decided otherwise."""
    failing = handler.parent
    if failing is None:
        return
    deals_no_more(world, failing, handler.id)
    if failing.is_killed or failing.again:
        return
    failing.ended_handlers.append(handler.id)
    world.later.append(lambda: _check_recovered(world, failing))


def deals_no_more(world: JournalWorld, failing: MessageRecord, handler: int) -> None:
    """The exception handler no longer works on that failure."""
    failing.recovering = tuple(one for one in failing.recovering if one != handler)
    world.touched[failing] = None


def _check_recovered(world: JournalWorld, failing: MessageRecord) -> None:
    if failing.ended_handlers and not (failing.is_killed or failing.again):
        handler = world.name(failing.ended_handlers[0])
        world.broken(RECOVERED, failing.id, f"{handler} dealt with the failure of {failing}, which did not go on")
    failing.ended_handlers.clear()


def recovered(world: JournalWorld, fact: facts.Recovered) -> None:
    """A failure has been dealt with."""
    task = world.item(fact.task, "recovered")  # it may have ended with its exception handler
    if task is None:
        return
    if not task.ended_handlers and not task.is_stranger:
        world.broken(RECOVERED, task.id, f"{task} recovered, and no exception handler of it has ended")
    handler = task.ended_handlers.pop(0) if task.ended_handlers else 0
    if task.deciding == handler and handler:
        task.deciding, task.returned = 0, True
    task.failure = ""


def attached(world: JournalWorld, fact: facts.Attached) -> None:
    """An exception handler is attached."""
    if not world.new_number(fact.id):
        world.broken(NUMBERS, 0, f"attachment {{{fact.id}}} came after {world.name(world.newest)}")
    if fact.task != ROOT:
        world.task(fact.task, "got an exception handler")
    declared = world.classes.get(fact.handler)
    if declared is not None and not declared.handles_failures:
        world.broken(HANDLER, 0, f"{declared} {fact.handler} was attached as exception handler")
    world.attached[fact.id] = fact


def removed(world: JournalWorld, fact: facts.Removed) -> None:
    """An exception handler or wiretap is taken away."""
    tap = world.taps.pop(fact.id, None)
    if tap is not None:
        world.taps_before.get(tap.message, {}).pop(fact.id, None)
    elif world.attached.pop(fact.id, None) is None and world.is_whole:
        world.broken(HANDLER, 0, f"{{{fact.id}}} was removed, and is no exception handler or wiretap")
