"""Check the states of tasks against their life cycles."""

from collections.abc import Iterator

from tca_tools.check.records import MessageRecord
from tca_tools.check.rules import LIFE
from tca_tools.check.world import JournalWorld
from tca_wire.errors import BadFormat
from tca_wire.journal import facts
from tca_wire.life_cycles import GENERAL, Effect, LifeCycle, Transition, read_life_cycle
from tca_wire.vocabulary import Outcome, Party

UNKNOWN = -1
"""The serial number of a task whose number of changes depends on facts before the journal."""


def declared(world: JournalWorld, fact: facts.FormatDefined) -> None:
    """Apply a declaration, which may contain a life cycle."""
    try:
        world.cycles[fact.message] = read_life_cycle(fact.life_cycle)
    except BadFormat as error:
        world.report(LIFE, 0, f"{fact.message} was declared, but {error}")


def sent(world: JournalWorld, task: MessageRecord) -> None:
    """Set the initial state of a task."""
    if not task.message_class.is_monitor:
        task.state = _cycle(world, task).initial


def ended(world: JournalWorld, task: MessageRecord) -> None:
    """Set the final state of a task."""
    if not task.message_class.is_monitor:
        outcome = Outcome.KILLED if task.is_killed else Outcome.DONE
        task.state = _cycle(world, task).end(task.state, outcome, task.chosen_end).target


def returned(world: JournalWorld, task: MessageRecord, fact: facts.Returned) -> None:
    """Check the transition by which a handler has completed a task."""
    cycle, task.chosen_end = _cycle(world, task), fact.transition
    is_known = world.is_whole and task.serial != UNKNOWN and not task.is_incomplete
    is_ended_otherwise = task.is_killed or task.is_retry_due or task.message_class.is_monitor
    if is_ended_otherwise or not is_known or (cycle == GENERAL and not fact.transition):
        return
    if cycle.completion([task.state, *task.overtaken], fact.transition) is None:
        how = f" by '{fact.transition}'" if fact.transition else ""
        what = (
            f"was {task.state} when its handler completed it{how}: {cycle} has no such transition"
        )
        world.report(LIFE, task, what)


def handler_changed(world: JournalWorld, task: MessageRecord, module: str = "") -> None:
    """Apply that a task waits for a handler, or was given to the handler of *module*.

    A task that was handled before returns to its initial state. The call of the handler accepts the
    task, unless the handler accepts tasks explicitly.
    """
    if not task.is_task or task.is_incomplete:
        return
    if not world.is_whole and module not in world.handlers.get(task.message, {}):
        task.serial = UNKNOWN  # the declaration of its handler is not known
    if task.serial == UNKNOWN:
        return
    cycle = _cycle(world, task)
    if task.is_begun and task.state != cycle.initial:
        task.state, task.serial, task.overtaken = cycle.initial, task.serial + 1, ()
    if module and task.state == cycle.initial and (task.message, module) not in world.accepting:
        task.state, task.serial = cycle.accepted.target, task.serial + 1


def changed(world: JournalWorld, task: MessageRecord, fact: facts.StateChanged) -> None:
    """Apply a transition."""
    is_known = world.is_whole or task.message in world.cycles
    if (
        task.is_incomplete
        or task.message_class.is_monitor
        or task.serial == UNKNOWN
        or not is_known
    ):
        task.state, task.serial = fact.state, fact.serial
        return
    cycle = _cycle(world, task)
    step = _step(cycle, task, fact)
    for wrong in _transition_errors(cycle, task, fact, step):
        world.report(LIFE, task, wrong)
    _follow(task, fact, step)


def _transition_errors(
    cycle: LifeCycle, task: MessageRecord, fact: facts.StateChanged, step: Transition | None
) -> Iterator[str]:
    """Yield the errors in a transition; *step* is its row in the table, if there is one."""
    if step is None:
        other = cycle.steps.get((task.state, fact.transition))
        whose = f", which is the {other.by}'s" if other else f": {cycle} has no such transition"
        yield f"was {task.state} when a {fact.by} took '{fact.transition}'{whose}"
    elif fact.state != (task.state if step.effect is Effect.STOP else step.target):
        yield f"is {fact.state} after '{fact.transition}', which leads to {step.target}"
    due = task.serial + (step is None or step.effect is not Effect.STOP)
    if fact.serial != due:
        yield f"has serial number {fact.serial} for a change of state, which must be {due}"


def _step(cycle: LifeCycle, task: MessageRecord, fact: facts.StateChanged) -> Transition | None:
    """Return the row of the table for a transition; None if the table has no such row.

    Central may take the transitions of both parties. A server may take a transition from an older
    state, because it has not received a client's request yet.
    """
    parties = (Party.CLIENT, Party.SERVER) if fact.by is Party.CENTRAL else (fact.by,)
    sources = [task.state, *task.overtaken] if fact.by is Party.SERVER else [task.state]
    found = (cycle.step(source, fact.transition, party) for source in sources for party in parties)
    return next((one for one in found if one is not None), None)


def _follow(task: MessageRecord, fact: facts.StateChanged, step: Transition | None) -> None:
    """Set the state that a transition leads to, and the goal that it requests or accepts."""
    before, task.state, task.serial = task.state, fact.state, fact.serial
    effect = step.effect if step is not None else Effect.NONE
    if effect is Effect.NEW_GOAL:
        task.requested_goal = fact.body
    elif effect is Effect.TAKE_GOAL:
        task.body = fact.body or task.requested_goal
    if fact.by is Party.CLIENT:
        task.overtaken += (before,)
    elif effect is not Effect.RESULT:
        task.overtaken = ()


def _cycle(world: JournalWorld, task: MessageRecord) -> LifeCycle:
    return world.cycles.get(task.message, GENERAL)
