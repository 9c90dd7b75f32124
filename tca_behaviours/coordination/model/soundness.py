"""What must be true of a machine before it may run."""

from collections import Counter
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from math import fsum

from tca_behaviours.coordination.model.activities import Agent
from tca_behaviours.coordination.model.automaton import arrows_of
from tca_behaviours.coordination.model.errors import UnsoundCoordination
from tca_behaviours.coordination.model.situation import Fact, Situation
from tca_behaviours.coordination.model.states import DONE, FAILED, AuthoredState, CompoundState
from tca_wire.coordination import ActivityKind
from tca_wire.text.measures import counted, listed

_ROUNDING = 1e-9


def check(states: list[AuthoredState], facts: Mapping[str, Fact]) -> None:
    """Raises UnsoundCoordination if a machine can't be run."""
    for state in states:
        _check_first(state, isinstance(state, CompoundState) and not state.children)
    for state in states:
        _check_events(state)
        _check_symbols(state)
        _check_agents(state)
    leaves = [state for state in states if not isinstance(state, CompoundState)]
    for leaf in leaves:
        _check_way_out(leaf)
        _check_constants(leaf)
    _check_ends(leaves)
    _check_reached(states)
    _check_capacities(leaves)
    _check_needs(leaves, facts)


def _check_first(state: AuthoredState, is_empty: bool) -> None:
    if is_empty:
        raise UnsoundCoordination(f"compound {state!r} holds no states: write them inside its with block")
    siblings = state.parent.children if state.parent is not None else []
    is_first = state.number == 0 or (siblings and siblings[0] is state)
    if is_first and state.kind is ActivityKind.FINAL:
        raise UnsoundCoordination(f"the final state {state!r} comes first, so nothing is done: write it after others")


def _check_events(state: AuthoredState) -> None:
    """Its arrows wait for events that can come: activities fail and are done, and compounds with an end are done."""
    events = {arrow.event for arrow in state.arrows}
    match state.kind:
        case ActivityKind.FINAL if events:
            raise UnsoundCoordination(f"the final state {state!r} has an arrow: write it to the compound around it")
        case ActivityKind.WAIT if events & {DONE, FAILED}:
            event = min(events & {DONE, FAILED})
            msg = f"{state!r} has no activity, so it is never {event}"
            raise UnsoundCoordination(f"{msg}: name the event that it waits for, .to(..., on=...)")
        case ActivityKind.COMPOUND:
            can_end = any(child.kind is ActivityKind.FINAL for child in state.children)
            if DONE in events and not can_end:
                raise UnsoundCoordination(f"compound {state!r} is never done: write a final state inside it")
            if can_end and not any(arrow.event == DONE and arrow.guard is None for arrow in state.arrows):
                msg = f"compound {state!r} can be done, and nothing leads on from there"
                raise UnsoundCoordination(f"{msg}: give it an arrow for 'done' without a guard")


def _check_symbols(state: AuthoredState) -> None:
    """One transition for each symbol (definition 1), and each of them can be taken."""
    seen: set[str] = set()
    for arrow in state.arrows:
        if arrow.symbol in seen:
            msg = f"{state!r} has two arrows for '{arrow.symbol}'"
            raise UnsoundCoordination(f"{msg}: give one a guard, or two guards of one name a guard_name=")
        if arrow.event in seen:
            msg = f"{state!r}: its arrow for '{arrow.symbol}' is never taken, as one for '{arrow.event}' comes before"
            raise UnsoundCoordination(f"{msg} it: write the one without a guard last")
        seen.add(arrow.symbol)


def _check_agents(state: AuthoredState) -> None:
    if state.activity is None:
        return
    used = Counter(agent for task in state.activity.tasks for agent in task.agents)
    for agent, times in used.items():
        if times > agent.tasks:
            msg = f"the activity of {state!r} needs agent '{agent.name}' for {times} tasks at once, and it takes"
            raise UnsoundCoordination(f"{msg} {agent.tasks}: put the tasks into states of their own")


def _check_capacities(leaves: list[AuthoredState]) -> None:
    """Agents of one name are one agent."""
    known: dict[str, Agent] = {}
    for leaf in leaves:
        for task in leaf.activity.tasks if leaf.activity is not None else ():
            for agent in task.agents:
                if known.setdefault(agent.name, agent) != agent:
                    msg = f"agent '{agent.name}' takes {counted(known[agent.name].tasks, 'task')} at once"
                    raise UnsoundCoordination(
                        f"{msg}, and in {leaf!r} {agent.tasks}: make one Agent and use it everywhere"
                    )


def _check_way_out(leaf: AuthoredState) -> None:
    if leaf.kind is not ActivityKind.FINAL and not arrows_of(leaf):
        raise UnsoundCoordination(f"nothing leads on from {leaf!r}: write an arrow, or make it final(...)")


def _check_constants(leaf: AuthoredState) -> None:
    models = [(arrow.symbol, arrow.model) for arrow in arrows_of(leaf) if arrow.model is not None]
    constants = {symbol: model.value(Situation(), "", "") or 0.0 for symbol, model in models if model.is_constant}
    total = fsum(constants.values())
    if total > 1 + _ROUNDING:
        parts = listed([f"{value:g} for '{symbol}'" for symbol, value in constants.items()])
        raise UnsoundCoordination(
            f"the likelihoods of {leaf!r} are {total:g} together: {parts}; they must be 1 at most"
        )


def _check_ends(leaves: list[AuthoredState]) -> None:
    """The end of a compound may lead to that of another, but not in a circle: nothing would be done for ever."""
    ends = [leaf for leaf in leaves if leaf.kind is ActivityKind.FINAL]
    after = {end: [to for arrow in arrows_of(end) if (to := arrow.target.leaf) in ends] for end in ends}
    try:
        TopologicalSorter(after).prepare()
    except CycleError as error:
        circle = listed([repr(state) for state in dict.fromkeys(error.args[1])])
        msg = (
            f"the arrows for 'done' of the compounds that end with {circle} lead in a circle, and nothing is done in it"
        )
        raise UnsoundCoordination(f"{msg}: let one of them lead to a state with an activity, or that waits") from None


def _check_reached(states: list[AuthoredState]) -> None:
    reached, todo = {states[0].leaf}, [states[0].leaf]
    while todo:
        new = {arrow.target.leaf for arrow in arrows_of(todo.pop())} - reached
        reached |= new
        todo += new
    entered = reached | {compound for leaf in reached for compound in leaf.around()}
    if lost := [state for state in states if state not in entered]:
        wrong = "are never reached: write an arrow to each, or remove them"
        if len(lost) == 1:
            wrong = "is never reached: write an arrow to it, or remove it"
        raise UnsoundCoordination(f"{listed([repr(state) for state in lost])} {wrong}")


def _check_needs(leaves: list[AuthoredState], facts: Mapping[str, Fact]) -> None:
    """Each fact that is needed can hold: at the start, or made by an activity whose own needs can be met."""
    blocked = {leaf: leaf.activity for leaf in leaves if leaf.activity is not None}
    makers: dict[tuple[str, Fact], AuthoredState] = {}
    for leaf, activity in blocked.items():
        for fact in activity.makes.items():
            makers.setdefault(fact, leaf)
    can_hold = set(facts.items())
    for leaf, activity in blocked.items():
        if lost := next((fact for fact in activity.needs.items() if fact not in can_hold and fact not in makers), None):
            msg = f"{leaf!r} needs {_fact(lost)}: no activity makes it so, and it does not hold at the start"
            raise UnsoundCoordination(f"{msg}; give it in makes= of one, or in facts= of the machine")
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
        steps = [f"{leaf!r} needs {_fact(lacking[leaf])}, made by {maker!r}" for leaf, maker in pairwise(circle)]
        raise UnsoundCoordination(f"needs in a circle: {'; '.join(steps)}; let one of these facts hold at the start")


def _circle(after: Mapping[AuthoredState, AuthoredState]) -> list[AuthoredState]:
    """States that come after one another, the first of them at the end again."""
    path = [next(iter(after))]
    while path.count(path[-1]) == 1:
        path.append(after[path[-1]])
    return path[path.index(path[-1]) :]


def _fact(fact: tuple[str, Fact]) -> str:
    return f"{fact[0]} = {fact[1]!r}"
