"""The states of tasks, held against the tables of their life cycles."""

from collections.abc import Iterator

from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import LIFE
from tca_tools.check.world import JournalWorld
from tca_wire.errors import BadFormat
from tca_wire.journal import facts
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, Transition, read_life_cycle
from tca_wire.vocabulary import Party

UNKNOWN = -1
"""Of a serial number: what was declared before the journal begins decides how often the state has
changed.
"""


def declared(world: JournalWorld, fact: facts.FormatDefined) -> None:
    """A message is declared, perhaps with a table of its own."""
    try:
        world.cycles[fact.message] = read_life_cycle(fact.life_cycle)
    except BadFormat as error:
        world.broken(LIFE, 0, f"{fact.message} was declared, and {error}")


def begin(world: JournalWorld, task: MessageRecord) -> None:
    """A task is sent."""
    if not task.message_class.is_monitor:
        task.state = _cycle(world, task).initial


def end(world: JournalWorld, task: MessageRecord) -> None:
    """A task has ended."""
    if not task.message_class.is_monitor:
        cycle = _cycle(world, task)
        task.state = cycle.cancelled if task.is_killed else cycle.done


def go_on(world: JournalWorld, task: MessageRecord, module: str = "") -> None:
    """A task waits for a handler, or a *module* gets it: once more, or for the first time, which
    accepts it.
    """
    if not task.is_task or task.is_stranger:
        return
    if not world.is_whole and module not in world.handlers.get(task.message, {}):
        task.serial = UNKNOWN  # how its handler was declared is not known
    if task.serial == UNKNOWN:
        return
    cycle = _cycle(world, task)
    if task.is_begun and task.state != cycle.initial:
        task.state, task.serial, task.overtaken = cycle.initial, task.serial + 1, ()
    if module and task.state == cycle.initial and (task.message, module) not in world.accepting:
        task.state, task.serial = cycle.accepted.target, task.serial + 1


def changed(world: JournalWorld, task: MessageRecord, fact: facts.StateChanged) -> None:
    """Somebody takes a transition."""
    is_known = world.is_whole or task.message in world.cycles
    if task.is_stranger or task.message_class.is_monitor or task.serial == UNKNOWN or not is_known:
        task.state, task.serial = fact.state, fact.serial
        return
    cycle = _cycle(world, task)
    step = _step(cycle, task, fact)
    for wrong in _mistaken(cycle, task, fact, step):
        world.broken(LIFE, task, wrong)
    _follow(task, fact, step)


def _mistaken(
    cycle: LifeCycle, task: MessageRecord, fact: facts.StateChanged, step: Transition | None
) -> Iterator[str]:
    """What is wrong with a transition, which its table has as a *step*, if it has it."""
    if step is None:
        other = cycle.steps.get((task.state, fact.transition))
        whose = f", which is the {other.by}'s" if other else f": {cycle} has no such transition"
        yield f"was {task.state}, and a {fact.by} took '{fact.transition}'{whose}"
    elif fact.state != (task.state if step.effect is Effect.STOP else step.target):
        yield f"is {fact.state} after '{fact.transition}', which leads to {step.target}"
    due = task.serial + (step is None or step.effect is not Effect.STOP)
    if fact.serial != due:
        yield f"changed its state for time {fact.serial}, and it was time {due}"


def _step(cycle: LifeCycle, task: MessageRecord, fact: facts.StateChanged) -> Transition | None:
    """The row of the table: central may take those of both, and a server may have taken its own
    before it knew what clients ask for.
    """
    parties = (Party.CLIENT, Party.SERVER) if fact.by is Party.CENTRAL else (fact.by,)
    sources = [task.state, *task.overtaken] if fact.by is Party.SERVER else [task.state]
    found = (cycle.step(source, fact.transition, party) for source in sources for party in parties)
    return next((one for one in found if one is not None), None)


def _follow(task: MessageRecord, fact: facts.StateChanged, step: Transition | None) -> None:
    before, task.state, task.serial = task.state, fact.state, fact.serial
    effect = step.effect if step is not None else Effect.NONE
    if effect is Effect.NEW_GOAL:
        task.wanted = fact.body
    elif effect is Effect.TAKE_GOAL:
        task.body = task.wanted
    if fact.by is Party.CLIENT:
        task.overtaken += (before,)
    elif effect is not Effect.RESULT:
        task.overtaken = ()


def _cycle(world: JournalWorld, task: MessageRecord) -> LifeCycle:
    return world.cycles.get(task.message, GENERAL)
