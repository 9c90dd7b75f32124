"""Kills, suspension and retries: what they do to a task and all under it."""

from tca_tools.check.failing import deals_no_more
from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import CAUGHT, KILLED, QUEUED, SUSPENDED
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.points import START_HANDLING
from tca_wire.vocabulary import Role


def killed(world: JournalWorld, fact: facts.Killed) -> None:
    """A task is killed."""
    item = world.task(fact.task, "was killed")
    if item is None:
        return
    if item.is_killed:
        world.broken(KILLED, item.id, f"{item} was killed a second time")
    if any(after <= 0 for after in item.searches):
        what = f"{item} failed ({item.failure}) and was killed: that was neither caught nor called unhandled"
        world.broken(CAUGHT, item.id, what)
    item.is_killed, item.is_suspended, item.returned = True, False, item.place is None
    failing = item.parent if item.role is Role.EXCEPTION and not item.is_void else None
    if failing is not None:
        item.is_void = True
        deals_no_more(world, failing, item.id)
    if failing is not None and not failing.again:
        failing.searches.append(item.id)
        world.later.append(lambda: _check_searched(world, item))
    world.later.append(lambda: check_below(world, item))


def _check_searched(world: JournalWorld, handler: MessageRecord) -> None:
    """A killed exception handler has decided nothing: the search goes on."""
    failing = handler.parent
    if failing is not None and handler.id in failing.searches and not (failing.is_killed or failing.again):
        world.broken(KILLED, handler.id, f"{handler} was killed, and nobody else was asked to deal with its failure")


def check_below(world: JournalWorld, item: MessageRecord) -> None:
    """Check what is under a killed task: only safety tasks and exception handlers go on."""
    if item.waits_at is not None:
        world.broken(QUEUED, item.id, f"{item} is killed, and waits for a handler")
    for child in item.children.values():
        if not child.is_killed and not child.role.survives and not child.is_over:
            world.broken(KILLED, child.id, f"{child} lives, and {item} above it is killed")


def suspended(world: JournalWorld, fact: facts.SuspendedOrResumed) -> None:
    """A task is suspended or resumed, with all under it."""
    item = world.task(fact.task, "was suspended or resumed")
    if item is None:
        return
    below, is_new = [item], False
    for one in below:  # grows while it is walked
        if one.is_suspended is not fact.is_suspended:
            one.is_suspended, is_new = fact.is_suspended, True
            world.touched[one] = None
        below += one.children.values()
    if not is_new and not (item.is_killed or item.is_orphan):
        world.broken(SUSPENDED, item.id, f"{item} was {'suspended' if fact.is_suspended else 'resumed'} already")


def retried(world: JournalWorld, fact: facts.Retried) -> None:
    """A task is to be handled again."""
    item = world.task(fact.task, "was retried")
    if item is None:
        return
    if item.is_killed:
        world.broken(KILLED, item.id, f"{item} was retried, and it is killed")
    item.failure, item.body = "", fact.body or item.body
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
            world.broken(KILLED, child.id, f"{child} lives, and {item} above it is retried")
