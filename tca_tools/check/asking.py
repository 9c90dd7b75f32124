"""Answers: senders of queries get theirs, and a handler that waits for a moment of a task goes on."""

from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import ANSWERED, WAITS
from tca_tools.check.world import JournalWorld
from tca_wire.journal import facts
from tca_wire.points import TaskId, describe_moments
from tca_wire.vocabulary import Role


def answered(world: JournalWorld, fact: facts.Answered) -> None:
    """The sender of a query gets its answer."""
    item = world.item(fact.id, "was answered")
    if item is None:
        return
    if item.is_answered:
        world.broken(ANSWERED, item.id, f"{item} was answered a second time")
    if item.is_dropped:
        world.broken(ANSWERED, item.id, f"{item} was answered, though nobody waited any more")
    if item.message_class.asks_one and not item.returned and not item.is_stranger:
        world.broken(ANSWERED, item.id, f"{item} was answered before it was handled")
    item.is_answered = True
    world.finish(item)


def awaited(world: JournalWorld, fact: facts.Awaited) -> None:
    """The sender of a query begins to wait; the answer must still be to come."""
    item = world.item(fact.id, "was waited for")
    if item is not None and (item.is_answered or item.is_dropped):
        world.broken(ANSWERED, item.id, f"{item} was waited for after its sender had got an answer, or given up")


def must_answer(world: JournalWorld, item: MessageRecord) -> None:
    """A query was handled, or failed: its sender is told with the same event."""
    item.returned = True
    if item.message_class.asks_one and item.role is not Role.CONDITION:
        world.later.append(lambda: _check_answered(world, item))
    elif item.message_class.asks_many and item.original is not None and not item.is_over:
        asked = item.original
        asked.copies -= 1
        if not asked.copies:
            world.later.append(lambda: _check_answered(world, asked))
    world.finish(item)


def _check_answered(world: JournalWorld, item: MessageRecord) -> None:
    if not (item.is_answered or item.is_dropped):
        world.broken(ANSWERED, item.id, f"{item} was handled, and {item.sender}, which waits, was not answered")


def wait_began(world: JournalWorld, fact: facts.WaitBegan) -> None:
    """A module waits for a moment of a task."""
    item = world.items.get(fact.task)
    if item is None or item.is_over:
        if fact.task not in world.over and world.item(fact.task, "was waited for") is None:
            return
        world.waits.setdefault((fact.module, fact.origin, fact.task), []).append(0)
        key = (fact.module, fact.origin, fact.task)
        world.later.append(lambda: _check_none(world, key))
        return
    world.waits.setdefault((fact.module, fact.origin, fact.task), []).append(fact.moment)
    item.waiters.append((fact.module, fact.origin, fact.moment))
    if item.reached & fact.moment:
        world.later.append(lambda: check_waits(world, item))


def wait_ended(world: JournalWorld, fact: facts.WaitEnded) -> None:
    """A wait for a moment is over: the moment is reached, or the module gave up."""
    key = (fact.module, fact.origin, fact.task)
    waits = world.waits.get(key, [])
    item = world.items.get(fact.task)
    if not waits:
        if world.is_whole or (world.first and fact.task >= world.first):
            what = f"'{fact.module}' waits no longer for {world.name(fact.task)}, for which it did not wait"
            world.broken(WAITS, fact.task, what)
        return
    run = next((moment for moment in waits if item is None or item.reached & moment), 0)
    if not run and item is not None and len(set(waits)) > 1:  # one was given up, and the fact does not say which
        item.waiters = [one for one in item.waiters if one[:2] != (fact.module, fact.origin)]
        waits[:] = [0] * len(waits)
    run = run or waits[0]
    waits.remove(run)
    if not waits:
        del world.waits[key]
    if item is not None and (fact.module, fact.origin, run) in item.waiters:
        item.waiters.remove((fact.module, fact.origin, run))


def check_waits(world: JournalWorld, item: MessageRecord) -> None:
    """Check that nobody waits for what is past."""
    for module, _, moment in item.waiters:
        if item.reached & moment:
            words = ", ".join(describe_moments(moment))
            world.broken(WAITS, item.id, f"'{module}' still waits for {words} of {item}, which is past")


def _check_none(world: JournalWorld, key: tuple[str, int, TaskId]) -> None:
    if world.waits.get(key):
        module, _, task = key
        world.broken(WAITS, task, f"'{module}' waits for {world.name(task)}, which is over")
