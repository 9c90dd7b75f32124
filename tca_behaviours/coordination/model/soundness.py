"""The checks of a machine before it may run."""

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
    """Raise UnsoundMachine if a machine can't be run."""
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
    """Check that the events of a state's arrows can occur.

    "done" and "failed" occur if the state has an activity. In a compound, "done" needs a final
    state inside.
    """
    events = {arrow.event for arrow in state.arrows}
    match state.kind:
        case StateKind.FINAL if state is next(state.containers()).children[0]:
            raise UnsoundMachine(
                f"the final state {state!r} comes first, so nothing is done: write it last"
            )
        case StateKind.FINAL if events:
            raise UnsoundMachine(
                f"the final state {state!r} has an arrow: give it to the compound around it"
            )
        case StateKind.WAIT if events & {DONE, FAILED}:
            event = min(events & {DONE, FAILED})
            raise UnsoundMachine(
                f"{state!r} has no activity, so it is never {event}: "
                "name the event that it waits for, .to(..., on=...)"
            )
        case StateKind.COMPOUND:
            can_end = any(child.kind is StateKind.FINAL for child in state.children)
            if DONE in events and not can_end:
                raise UnsoundMachine(
                    f"compound {state!r} is never done: write a final state inside it"
                )
            if can_end and not any(
                arrow.event == DONE and arrow.guard is None for arrow in state.arrows
            ):
                raise UnsoundMachine(
                    f"compound {state!r} can be done, but has no arrow for that: "
                    "give it an arrow for 'done' without a guard"
                )


def _check_agents(leaves: list[AuthoredState]) -> None:
    """Check that agents of one name are equal, and that no activity overloads an agent."""
    known: dict[str, Agent] = {}
    for leaf in leaves:
        tasks = leaf.activity.tasks if leaf.activity is not None else ()
        for agent, times in Counter(agent for task in tasks for agent in task.agents).items():
            if known.setdefault(agent.name, agent) != agent:
                capacity = counted(known[agent.name].tasks, "task")
                raise UnsoundMachine(
                    f"agent '{agent.name}' takes {capacity} at once, but {agent.tasks} "
                    f"in {leaf!r}: make one Agent and use it everywhere"
                )
            if times > agent.tasks:
                raise UnsoundMachine(
                    f"the activity of {leaf!r} needs agent '{agent.name}' for {times} tasks "
                    f"at once, but it takes {agent.tasks}: give each task a state of its own"
                )


def _check_way_out(leaf: AuthoredState) -> None:
    """Check that a leaf has an arrow, and that the sum of its constant likelihoods is at most 1."""
    arrows = arrows_of(leaf)
    if leaf.kind is not StateKind.FINAL and not arrows:
        raise UnsoundMachine(f"{leaf!r} has no arrow: add one, or make it final(...)")
    constants = {
        arrow.symbol: arrow.model.value(Situation(), "", "") or 0.0
        for arrow in arrows
        if arrow.model is not None and arrow.model.is_constant
    }
    total = fsum(constants.values())
    if total > 1 + _ROUNDING:
        parts = listed([f"{value:g} for '{symbol}'" for symbol, value in constants.items()])
        raise UnsoundMachine(
            f"the sum of the likelihoods of {leaf!r} is {total:g}: {parts}; it must be at most 1"
        )


def _check_ends(leaves: list[AuthoredState]) -> None:
    """Check that the ends of compounds do not lead to each other in a cycle that does nothing."""
    ends = [leaf for leaf in leaves if leaf.kind is StateKind.FINAL]
    check_no_cycle(
        {end: [to for arrow in arrows_of(end) if (to := arrow.target.leaf) in ends] for end in ends}
    )


def _check_needs(leaves: list[AuthoredState], facts: Mapping[str, Fact]) -> None:
    """Check that each needed fact can hold: at the start, or after an activity that can start."""
    blocked = {leaf: leaf.activity for leaf in leaves if leaf.activity is not None}
    makers: dict[tuple[str, Fact], AuthoredState] = {}
    for leaf, activity in blocked.items():
        for fact in activity.makes.items():
            makers.setdefault(fact, leaf)
    can_hold = set(facts.items())
    for leaf, activity in blocked.items():
        for fact in activity.needs.items():
            if fact not in can_hold and fact not in makers:
                raise UnsoundMachine(
                    f"{leaf!r} needs {_fact(fact)}, which no activity makes, and which does not"
                    " hold at the start: add it to makes= of an activity, or to facts= of the"
                    " machine"
                )
    while startable := [
        leaf for leaf, activity in blocked.items() if activity.needs.items() <= can_hold
    ]:
        for leaf in startable:
            can_hold |= blocked.pop(leaf).makes.items()
    if blocked:
        lacking = {
            leaf: next(fact for fact in activity.needs.items() if fact not in can_hold)
            for leaf, activity in blocked.items()
        }
        cycle = _cycle({leaf: makers[fact] for leaf, fact in lacking.items()})
        steps = [
            f"{leaf!r} needs {_fact(lacking[leaf])}, made by {maker!r}"
            for leaf, maker in pairwise(cycle)
        ]
        raise UnsoundMachine(
            f"the needs form a cycle: {'; '.join(steps)}; add one of these facts to facts="
        )


def _cycle(successors: Mapping[AuthoredState, AuthoredState]) -> list[AuthoredState]:
    """Return a cycle of states that follow each other. Its first state is also the last."""
    path = [next(iter(successors))]
    while path.count(path[-1]) == 1:
        path.append(successors[path[-1]])
    return path[path.index(path[-1]) :]


def _fact(fact: tuple[str, Fact]) -> str:
    return f"{fact[0]} = {fact[1]!r}"
