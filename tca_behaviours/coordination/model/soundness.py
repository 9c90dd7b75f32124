"""What must be true of a machine before it may run."""

from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from math import fsum

from tca_behaviours.coordination.model.activities import Agent
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.model.states import DONE, FAILED, AuthoredState
from tca_behaviours.statecharts.soundness import arrows_of, check_arrows, check_no_cycle
from tca_behaviours.statecharts.states import UnsoundMachine
from tca_wire.charts import StateKind
from tca_wire.text.measures import counted, listed

_ROUNDING = 1e-9


def check_machine(states: list[AuthoredState], facts: Mapping[str, Fact]) -> None:
    """Raises UnsoundMachine if a machine can't be run."""
    for state in states:
        _check_events(state)
    leaves = [state for state in states if state.kind is not StateKind.COMPOUND]
    _check_agents(leaves)
    for leaf in leaves:
        _check_way_out(leaf)
    _check_ends(leaves)
    check_arrows(states)
    _check_needs(leaves, facts)


def _check_events(state: AuthoredState) -> None:
    """Its arrows wait for events that can come: activities fail and are done, and compounds with an
    end are done.
    """
    events = {arrow.event for arrow in state.arrows}
    match state.kind:
        case StateKind.FINAL if state is next(state.containers()).children[0]:
            raise UnsoundMachine(
                f"the final state {state!r} comes first, so nothing is done: write it after others"
            )
        case StateKind.FINAL if events:
            raise UnsoundMachine(
                f"the final state {state!r} has an arrow: write it to the compound around it"
            )
        case StateKind.WAIT if events & {DONE, FAILED}:
            event = min(events & {DONE, FAILED})
            msg = f"{state!r} has no activity, so it is never {event}"
            raise UnsoundMachine(f"{msg}: name the event that it waits for, .to(..., on=...)")
        case StateKind.COMPOUND:
            can_end = any(child.kind is StateKind.FINAL for child in state.children)
            if DONE in events and not can_end:
                raise UnsoundMachine(
                    f"compound {state!r} is never done: write a final state inside it"
                )
            if can_end and not any(
                arrow.event == DONE and arrow.guard is None for arrow in state.arrows
            ):
                msg = f"compound {state!r} can be done, and nothing leads on from there"
                raise UnsoundMachine(f"{msg}: give it an arrow for 'done' without a guard")


def _check_agents(leaves: list[AuthoredState]) -> None:
    """Agents of one name are one agent, and no activity needs one too often."""
    known: dict[str, Agent] = {}
    for leaf in leaves:
        tasks = leaf.activity.tasks if leaf.activity is not None else ()
        for agent, times in Counter(agent for task in tasks for agent in task.agents).items():
            if known.setdefault(agent.name, agent) != agent:
                msg = (
                    f"agent '{agent.name}' takes {counted(known[agent.name].tasks, 'task')} at once"
                )
                raise UnsoundMachine(
                    f"{msg}, and in {leaf!r} {agent.tasks}: make one Agent and use it everywhere"
                )
            if times > agent.tasks:
                msg = f"the activity of {leaf!r} needs agent '{agent.name}' for {times} tasks at once, and it takes"
                raise UnsoundMachine(f"{msg} {agent.tasks}: put the tasks into states of their own")


def _check_way_out(leaf: AuthoredState) -> None:
    """Something leads on from it, and its constant likelihoods are 1 together at most."""
    arrows = arrows_of(leaf)
    if leaf.kind is not StateKind.FINAL and not arrows:
        raise UnsoundMachine(
            f"nothing leads on from {leaf!r}: write an arrow, or make it final(...)"
        )
    models = [(arrow.symbol, arrow.model) for arrow in arrows if arrow.model is not None]
    constants = {
        symbol: model.value(Situation(), "", "") or 0.0
        for symbol, model in models
        if model.is_constant
    }
    total = fsum(constants.values())
    if total > 1 + _ROUNDING:
        parts = listed([f"{value:g} for '{symbol}'" for symbol, value in constants.items()])
        raise UnsoundMachine(
            f"the likelihoods of {leaf!r} are {total:g} together: {parts}; they must be 1 at most"
        )


def _check_ends(leaves: list[AuthoredState]) -> None:
    """The end of a compound may lead to that of another, but not in a circle: nothing would be done
    for ever.
    """
    ends = [leaf for leaf in leaves if leaf.kind is StateKind.FINAL]
    check_no_cycle(
        {end: [to for arrow in arrows_of(end) if (to := arrow.target.leaf) in ends] for end in ends}
    )


def _check_needs(leaves: list[AuthoredState], facts: Mapping[str, Fact]) -> None:
    """Each fact that is needed can hold: at the start, or made by an activity whose own needs can
    be met.
    """
    blocked = {leaf: leaf.activity for leaf in leaves if leaf.activity is not None}
    makers: dict[tuple[str, Fact], AuthoredState] = {}
    for leaf, activity in blocked.items():
        for fact in activity.makes.items():
            makers.setdefault(fact, leaf)
    can_hold = set(facts.items())
    for leaf, activity in blocked.items():
        if lost := next(
            (
                fact
                for fact in activity.needs.items()
                if fact not in can_hold and fact not in makers
            ),
            None,
        ):
            msg = f"{leaf!r} needs {_fact(lost)}: no activity makes it so, and it does not hold at the start"
            raise UnsoundMachine(f"{msg}; give it in makes= of one, or in facts= of the machine")
    met = len(blocked) + 1
    while met > len(blocked):
        met = len(blocked)
        for leaf, activity in list(blocked.items()):
            if activity.needs.items() <= can_hold:
                can_hold |= blocked.pop(leaf).makes.items()
    if blocked:
        lacking = {
            leaf: next(fact for fact in activity.needs.items() if fact not in can_hold)
            for leaf, activity in blocked.items()
        }
        circle = _circle({leaf: makers[fact] for leaf, fact in lacking.items()})
        steps = [
            f"{leaf!r} needs {_fact(lacking[leaf])}, made by {maker!r}"
            for leaf, maker in pairwise(circle)
        ]
        raise UnsoundMachine(
            f"needs in a circle: {'; '.join(steps)}; let one of these facts hold at the start"
        )


def _circle(after: Mapping[AuthoredState, AuthoredState]) -> list[AuthoredState]:
    """States that come after one another, the first of them at the end again."""
    path = [next(iter(after))]
    while path.count(path[-1]) == 1:
        path.append(after[path[-1]])
    return path[path.index(path[-1]) :]


def _fact(fact: tuple[str, Fact]) -> str:
    return f"{fact[0]} = {fact[1]!r}"
