"""Runs that go on for ever: what never happens in them, and who waits in them for ever.

There are finitely many states, so a run that goes on for ever goes round in a cycle among some of
them. A cycle counts if it is *fair*: nothing that can happen all the time, and must happen some
time, is left out of it for ever. A set of states that all lead to each other has a fair cycle
unless something can happen in each of its states and does so on no way inside it; then no part of
it has one either.

A property is *owed* in some states: the cycles are among those. What *waits* is followed from
state to state (Way.new_places): the cycles are those round which the same task, or script, waits for
the same thing.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from tca_tools.explore.play.play import Action, waiters
from tca_tools.explore.play.words import waiter_in_words
from tca_tools.explore.scenario.scenario import Scenario
from tca_tools.explore.search.states import SearchState, Violation, Way, replayed
from tca_tools.properties.algebra import NeverStuck, Property

Fair = tuple[str, str]
"""Something that happens some time if it can all the time: a script goes on, a module joins, time
passes.
"""


class _Node(NamedTuple):
    """A state, and where one follows what waits in it, which."""

    state: int
    waits: int = 0


class _Edge(NamedTuple):
    way: Way
    to: _Node


Graph = dict[_Node, list[_Edge]]


def judge(
    scenario: Scenario, properties: Iterable[Property], states: list[SearchState]
) -> Violation | None:
    """The first property that is not true of runs that never end, shown by one of them. *states*
    are all there are, nearest first.
    """
    places = {id(state): place for place, state in enumerate(states)}
    for number, one in enumerate(properties):
        is_stuck = isinstance(one, NeverStuck)
        cycle = _fair_cycle(
            _waiting_graph(states, places)
            if is_stuck
            else _owed_graph(states, places, number, one),
            states,
        )
        if cycle is None:
            continue
        start, ways = cycle
        why = "this can go on for ever, and it never happens"
        if is_stuck:
            play = replayed(scenario, states[start.state])
            why = f"this can go on for ever, and all the while:\n{waiter_in_words(play, waiters(play)[start.waits])}"
        return Violation(
            str(one), why, states[start.state].actions(), tuple(way.action for way in ways)
        )
    return None


def _owed_graph(
    states: list[SearchState], places: dict[int, int], number: int, one: Property
) -> Graph:
    """The states in which a property is owed, and the ways between them."""
    nodes = {
        _Node(place) for place, state in enumerate(states) if one.is_owed(state.memories[number])
    }
    return {
        node: [
            _Edge(way, to)
            for way in states[node.state].ways
            if (to := _Node(places[id(way.to)])) in nodes
        ]
        for node in nodes
    }


def _waiting_graph(states: list[SearchState], places: dict[int, int]) -> Graph:
    """The waiters in each state, and the ways after which they still wait."""
    return {
        _Node(place, one): [
            _Edge(way, _Node(places[id(way.to)], way.new_places[one]))
            for way in state.ways
            if way.new_places[one] >= 0
        ]
        for place, state in enumerate(states)
        if state.ways
        for one in range(len(state.ways[0].new_places))
    }


def _fair_cycle(graph: Graph, states: list[SearchState]) -> tuple[_Node, list[Way]] | None:
    """The nearest fair cycle: where it begins, and the ways round."""
    for part in sorted(_strongly_connected(graph), key=min):
        inside = {node: [step for step in graph[node] if step.to in part] for node in part}
        happening = {_fair(step.way.action) for steps in inside.values() for step in steps}
        always = set.intersection(*(_possible(states[node.state]) for node in part))
        if happening and not always - happening:
            return min(part), _way_round(inside, min(part), states)
    return None


def _fair(action: Action) -> Fair:
    return action.kind, action.name


def _possible(state: SearchState) -> set[Fair]:
    """The actions that can happen in a state, and must happen some time."""
    return {_fair(way.action) for way in state.ways if not way.action.is_optional}


def _strongly_connected(graph: Graph) -> list[set[_Node]]:
    """The largest sets of nodes that all lead to each other (Tarjan's algorithm, without
    recursion).
    """
    found: list[set[_Node]] = []
    number: dict[_Node, int] = {}
    low: dict[_Node, int] = {}
    stack: list[_Node] = []
    on_stack: set[_Node] = set()
    for root in graph:
        work: list[tuple[_Node, Iterator[_Edge]]] = [] if root in number else [(root, iter(()))]
        while work:
            node, steps = work.pop()
            if node not in number:
                number[node] = low[node] = len(number)
                stack.append(node)
                on_stack.add(node)
                steps = iter(graph[node])
            for step in steps:
                if step.to not in number:
                    work += (node, steps), (step.to, iter(()))
                    break
                if step.to in on_stack:
                    low[node] = min(low[node], low[step.to])
            else:
                if low[node] == number[node]:
                    found.append(part := set(stack[stack.index(node) :]))
                    del stack[-len(part) :]
                    on_stack -= part
                if work:
                    above = work[-1][0]
                    low[above] = min(low[above], low[node])
    return found


def _way_round(inside: Graph, start: _Node, states: list[SearchState]) -> list[Way]:
    """A fair way from *start* round to it again: a short one, if not always the shortest."""
    ways: list[Way] = []
    here, left_out = start, _possible(states[start.state])
    while left_out:
        for step in _path(
            inside,
            here,
            lambda step, out=left_out: bool(  # type: ignore[misc]
                out - _possible(states[step.to.state]) or _fair(step.way.action) in out
            ),
        ):
            ways.append(step.way)
            here = step.to
            left_out = (left_out & _possible(states[here.state])) - {_fair(step.way.action)}
    if here != start:
        ways += [step.way for step in _path(inside, here, lambda step: step.to == start)]
    return ways


def _path(inside: Graph, start: _Node, is_wanted: Callable[[_Edge], bool]) -> list[_Edge]:
    """The shortest way whose last step is one of those wanted."""
    reached_by: dict[_Node, tuple[_Node, _Edge]] = {}
    nodes = deque([start])
    while True:
        node = nodes.popleft()
        for step in inside[node]:
            if is_wanted(step):
                path = [step]
                while node != start:
                    node, before = reached_by[node]
                    path.append(before)
                return path[::-1]
            if step.to not in reached_by:
                reached_by[step.to] = node, step
                nodes.append(step.to)
